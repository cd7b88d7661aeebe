"""The words that a painter types beside keys, and other spellings of ours; nothing here is slow to import."""

import os
import re
import tomllib
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).parents[1]
SHIPPED = PACKAGE / "conf"
TASK_POINTS = "brushexp.tasks"  # entry-point group: name of a task -> its class
WORDS = {  # what a painter types -> what it means
    "finer": "detail=2",
    "bolder": "detail=0.25",
    "abstract": "abstraction=0.7",
    **{f"{key}={no}": "frames=0" for key in ("timelapse", "film") for no in ("none", "null", "no", "false")},
}
SPELLINGS = Path(__file__).with_name("spellings.toml")
CHANGES = Path(__file__).with_name("changes.toml")
ALONE = ("look", "quality")  # groups whose members may stand alone: watercolour is look=watercolour


@cache
def spellings(table: str) -> dict[str, str]:
    """Read what others say for ``keys``, ``members`` or what is typed ``instead``, and what we say."""
    tables = tomllib.loads(SPELLINGS.read_text(encoding="utf-8"))
    return {theirs: ours for ours, others in tables[table].items() for theirs in others}


@cache
def words_of_changes(table: str) -> dict[str, Any]:
    """Read a table of the words for options of changes: which ``stands_for`` which, and what it ``brings``."""
    return dict(tomllib.loads(CHANGES.read_text(encoding="utf-8"))[table])


def in_words(message: str) -> str:
    """Replace options of changes in a message by the words that stand for them.

    >>> in_words("change.guides.lines=a.png is not there")
    'guides=a.png is not there'
    """
    for word, option in words_of_changes("stands_for").items():
        message = re.sub(rf"\b{re.escape(option)}\b", word, message)
    for word, options in words_of_changes("tunes").items():
        message = re.sub(rf"\b({'|'.join(map(re.escape, options))})\b", word, message)
    return message


def members_alone() -> dict[str, str]:
    """Map each look and each quality, those that ship and those of ``conf/``, to what it means as a word alone."""
    return {name: f"{group}={name}" for group in ALONE for name in members_of_group(group)}


def meaning_of(word: str) -> str | None:
    """Return what a painter's word means, as key=value; None for other words.

    >>> meaning_of("finer"), meaning_of("watercolor"), meaning_of("photo.jpg")
    ('detail=2', 'look=watercolour', None)
    """
    known = WORDS | members_alone()
    return known.get(word) or known.get(respelt(word))


def members_of_group(group: str) -> set[str]:
    """List the presets of a group, those that ship and those of ``conf/``."""
    return {path.stem for root in (SHIPPED, Path("conf")) for path in (root / group).glob("*.yaml")}


def respelt(text: str) -> str:
    """Spell colour, grey, optimiser and analyse the other way, British or American.

    >>> respelt("watercolor"), respelt("style.colours"), respelt("grey")
    ('watercolour', 'style.colors', 'gray')
    >>> respelt("optimiser"), respelt("renderer.normalization"), respelt("analyze"), respelt("noise")
    ('optimizer', 'renderer.normalisation', 'analyse', 'noise')
    """
    pairs = {"colour": "color", "color": "colour", "grey": "gray", "gray": "grey"}
    pairs |= {"is": "iz", "iz": "is", "lys": "lyz", "lyz": "lys"}
    return re.sub("colour|color|grey|gray|i[sz](?=er|ation)|ly[sz](?=e)", lambda found: pairs[found[0]], text)


def as_task(word: str) -> str:
    """Spell a word of a command line as we do if it then is a task.

    >>> as_task("analyze"), as_task("task=analyze"), as_task("optimiser")
    ('analyse', 'task=analyse', 'optimiser')
    """
    spelt = respelt(word)
    return spelt if spelt != word and spelt.removeprefix("task=") in task_names() and not is_path(word) else word


def task_names() -> set[str]:
    """List the tasks by their names, without their classes."""
    own = {path.stem for path in (PACKAGE / "tasks").glob("[a-z]*.py")}
    return own | {point.name for point in entry_points(group=TASK_POINTS)}


def is_path(text: str) -> bool:
    """Whether a text is the path of a file or folder that exists."""
    return bool(text) and os.path.exists(os.path.expanduser(text))


def plain_name(name: str) -> str:
    """Write a name as the tables here have it.

    >>> plain_name("Brush-Size"), plain_name("colours")
    ('brush_size', 'colors')
    """
    name = re.sub("[- ]", "_", name.lower())
    return name if name in spellings("keys") or name in spellings("instead") else respelt(name)
