"""Announce, before the slow imports, what a command line will start, and answer requests that need no imports.

This module does not check the arguments; `brushexp.config.words` reports mistakes a moment later.
"""

import os
import sys
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from io import TextIOWrapper
from pathlib import Path

from brushexp import __version__
from brushexp.config.vocabulary import is_path, meaning_of, respell_task, spell_paths, switch_spelling, task_names
from brushexp.pictures.folders import is_several
from brushexp.system.heartbeat import heartbeat
from brushexp.system.words import table_of_words

ENDS = (".png", ".jpg")  # of samples
PAINTED = ("", "paint")  # tasks whose first line names the picture


def open_with(words: Sequence[str]) -> list[str]:
    """Answer ``--version`` or ``doctor`` and exit; otherwise announce, on a terminal, what will start.

    Returns the arguments with ``help`` rewritten as ``--help`` and with the program's own spelling of task names.
    """
    open_streams()
    if isinstance(sys.stdout, TextIOWrapper):  # tests may have replaced it
        sys.stdout.reconfigure(errors="backslashreplace")  # like stderr: the encoding may lack some characters
    words = [respell_task(spell_paths(word)) for word in words]
    if "--version" in words:
        print(f"brushexp {__version__}")
        sys.exit()
    try:
        os.getcwd()
    except OSError:
        sys.exit("brushexp: the current folder no longer exists; change to another folder with cd")
    if words[:1] == ["doctor"] and not is_path("doctor"):
        from brushexp.cli.doctor import examine  # noqa: PLC0415  (few people need it)

        sys.exit(examine() if len(words) == 1 else "brushexp: doctor takes no settings; type: brushexp doctor")
    if words[:1] == ["help"] and not is_path("help"):
        return [*words[1:], "--help"]
    if line := opening_line(words):
        if sys.stderr.isatty():
            print(line, file=sys.stderr, flush=True)
        heartbeat.start("preparing")
    return [*words]


def open_streams() -> None:
    """Redirect closed standard streams (``2>&-``) to the null device, so that no other file receives their output."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115  (until the end)


def opening_line(words: Sequence[str]) -> str:
    """Describe briefly what a command line will start; return "" for a help request or a missing file.

    >>> opening_line(["coffee", "look=ink", "strokes=300"])
    'painting coffee in ink'
    >>> opening_line(["--help"]), opening_line(["train"]), opening_line(["-m", "seed=1,2"])
    ('', 'starting: train', 'checking the jobs of a sweep')
    """
    flags = {word for word in words if word.startswith("-")}
    keys, alone = _separate([word for word in words if word not in flags])
    if flags - {"-m", "--multirun"}:
        return ""
    if "resume" in keys:
        return "continuing the sweep" if keys["resume"] == "sweep" else f"continuing {keys['resume']}"
    if flags or "experiment" in keys:
        return "checking the jobs of a sweep"
    named = keys.get("task") or next((word for word in alone if not is_path(word) and word in task_names()), "")
    return painting_line(keys, alone) if named in PAINTED else f"starting: {named}"


def painting_line(keys: Mapping[str, str], alone: Sequence[str]) -> str:
    """Describe which pictures will be painted and in which look; return "" if a picture does not exist."""
    pictures = [*alone, *(keys[key] for key in ("image", "pictures") if key in keys)] or ["astronaut"]
    if not all(is_path(one) or is_several(one) or is_sample(one) or "pictures" in keys for one in pictures):
        return ""
    look, words = keys.get("look", "oil"), table_of_words("look_in_words")
    way = words.get(look) or words.get(switch_spelling(look)) or f"with look={look}"
    style = keys.get("style", keys.get("style.image"))
    several = "the pictures of " if len(pictures) == 1 and is_several(pictures[0]) else ""
    return f"painting {several}{', '.join(pictures)} {way}" + (f", in the style of {style}" if style else "")


def is_sample(name: str) -> bool:
    """Check whether scikit-image or matplotlib ships a sample picture with this name."""
    found = find_spec("skimage")
    folders = [Path(folder, "data") for folder in (found.submodule_search_locations or () if found else ())]
    return name == "grace_hopper" or any((folder / f"{name}{end}").is_file() for folder in folders for end in ENDS)


def _separate(words: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """Separate ``key=value`` arguments from bare words; painters' words are expanded to key and value."""
    keys: dict[str, str] = {}
    alone = []
    for word in words:
        plain = word if is_path(word) else meaning_of(word) or word
        key, equal, value = plain.partition("=")
        if equal and not is_path(plain):
            keys[key.lstrip("+~")] = value
        else:
            alone.append(word)
    return keys, alone
