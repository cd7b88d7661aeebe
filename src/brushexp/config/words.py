"""Expand command-line shorthand into Hydra's grammar; an existing path is always taken literally.

photo.jpg, photos/    image=photo.jpg, image=photos/
train                 task=train
export outputs/x      task=export catalogue=outputs/x; other tasks take paths likewise
analyse photo.jpg     task=measure image=photo.jpg; ``measure`` replaces ``analyse`` for pictures
watercolour, finer    look=watercolour, detail=2
look=watercolor       look=watercolour
style=painting.jpg    style.image=painting.jpg
light=315,45          light={azimuth:315,elevation:45}
to=svg,json           to=[svg,json]; likewise for every key or family that takes several values, except ``loss``
resume=sweep          hydra.sweeper.resume=true
"""

import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from enum import Enum
from pathlib import Path
from typing import Any, get_args, get_origin

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import ChoiceSweep, Glob, Sweep
from hydra.errors import HydraException
from omegaconf import OmegaConf

from brushexp.config.compose import CHOSEN_GROUPS, quote
from brushexp.config.key_types import is_key, type_of_key
from brushexp.config.keys import groups_of, keys_of
from brushexp.config.tasks import TASKS, task_for
from brushexp.config.vocabulary import (
    is_path,
    meaning_of,
    members_alone,
    members_of_group,
    plain_name,
    spellings,
    switch_spelling,
)
from brushexp.errors import UserError, similar_words
from brushexp.pictures.load import samples
from brushexp.registry import MULTI_SELECT, plugins
from brushexp.system.caches import has_home
from brushexp.system.published import catalogue_suffixes
from brushexp.system.words import table_of_words

ALL_PIXELS = "working_resolution=null"  # default in sweeps, to keep them comparable with earlier sweeps
RESUME_SWEEP = "resume=sweep"
RESULTS = ("metrics.json", "report.html", "multirun.yaml")  # the folder of a run or sweep has one of these files
NO_FOLDERS = ("nan", "inf", "infinity", "null", "none", "true", "false")  # written by scripts for a missing name
NOT_LITERAL = re.compile(r"[\['\"{]|null$|\w+\(|\$\{")  # start of values that Hydra does not read as text


def expand_positional(
    word: str, task: str = "paint", beside: Mapping[str, str] | None = None, following: str = ""
) -> str:
    """Rewrite an argument as ``key=value``; a bare word is a task, a painter's word, or the path that a task takes.

    ``beside`` contains the command line's other keys, which may mean that the path belongs to another task. Error
    messages use the ``following`` bare word, which may belong to this one.
    """
    path = Path(word)
    if is_setting(word):
        return meaning_of(word) or word
    if word in TASKS:
        return f"task={word}"
    alone = TASKS[task].alone if task in TASKS else ""
    if alone not in ("", "image"):
        return f"{TASKS[task_for(task, {**(beside or {}), 'image': word})].alone}={word}"
    if not is_path(word) and (meant := meaning_of(word)):
        return meant
    is_picture = path.suffix or is_path(word) or word in samples()
    if path.suffix.lower() in catalogue_suffixes() or any((path / name).exists() for name in RESULTS):
        cure = f"brushexp view {word}, brushexp export {word}, or PICTURE catalogue={word} to continue from its strokes"
        raise UserError(f"{word} is a painting, a run or a sweep, not a picture; type {cure}")
    if is_picture and alone:
        return f"image={word}"
    if is_path(word) or word in samples():
        raise UserError(f"task={task} takes no path alone; type a key before it, KEY={word}")
    raise UserError(unknown_word(word, following))


def is_setting(word: str) -> bool:
    """Check whether an argument is ``key=value`` or ``~key`` rather than an existing path such as steps=3/x.jpg."""
    key, equal, value = word.partition("=")
    if not equal and (not word.startswith("~") or os.sep in word):
        return False
    if not is_path(word):
        return True
    return is_key(key.lstrip("+~")) and (is_path(value) or (os.sep not in word and not Path(word).suffix))


def in_two_words(word: str, following: str) -> str:
    """Explain that two words belong together, as in ``strokes 100`` and ``my photo.jpg``; return "" if they do not."""
    if following and is_path(both := f"{word} {following}"):
        return f"the name {both} has a space; type it in quotes: '{both}'"
    if following and is_key(word) and not (word in CHOSEN_GROUPS and is_path(following)):
        return f"{word} {following} needs an equals sign instead of the space; type {word}={following}"
    return ""


def key_without_value(word: str) -> str:
    """Explain what may follow the name of a key or group, also in the plural; return "" for other words."""
    group = word if word in CHOSEN_GROUPS else word.removesuffix("s")
    if group in CHOSEN_GROUPS:
        own = TASKS if group == "task" else members_of_group(group)
        names = ", ".join(sorted({*(plugin.name for plugin in plugins(group)), *own}))
        return f"{word} has no meaning alone; type {group}= and one of {names}"
    if not is_key(word):
        return ""
    key = keys_of(TASKS["paint"]).get(word)
    return f"{word} is a key; type {word}={example_of(word)}, without spaces" + (f" ({key.meaning})" if key else "")


def example_of(name: str) -> str:
    """Write a value that a user may want for a key of ``task=paint``, or "..." for other keys."""
    key = keys_of(TASKS["paint"]).get(name)
    return "..." if key is None else "true" if key.annotation is bool else as_typed(key.example())


def unknown_word(word: str, following: str = "") -> str:
    """Explain that a bare word has no meaning, and name similar words that have one, or the ``following`` value."""
    if message := in_two_words(word, following) or key_without_value(word):
        return message
    if word in ("-v", "-V"):
        return f"{word} is not a flag; type brushexp --version"
    if re.match("-.", word):
        return f"{word} is not a flag; --help lists the keys, which have no dashes"
    if meant := setting_in(word):
        return f"{word} is not a file, a task or key=value; type {meant}"
    known = [*TASKS, *members_alone(), *table_of_words("alone"), *samples()]
    ours = spellings("members").get(plain_name(word), "")
    near = [ours] if ours in known else []
    near += [f"{plugin.family}={plugin.name}" for plugin in plugins() if plugin.name == word]
    if os.sep not in word:  # otherwise a path, which resembles none of our words
        near += [name for name in similar_words(word, known) if "=" not in name]
    if not near and os.sep not in word:
        near = [f"{name}=" for name in similar_words(word, [*groups_of(TASKS["paint"]), *keys_of(TASKS["paint"])])]
    near += nearest_folders(word)
    meant = f"did you mean {' or '.join(dict.fromkeys(near))}? " if near else ""
    meant += "correct the path" if os.sep in word else "brushexp --help lists looks, tasks and keys"
    return f"{word} is not a file, a task or key=value; {meant}"


def nearest_folders(word: str) -> list[str]:
    """List up to three folders whose paths resemble a word."""
    parent, name = os.path.split(word.rstrip(os.sep))
    with suppress(OSError):
        beside = [entry.name for entry in os.scandir(os.path.expanduser(parent) or ".") if entry.is_dir()]
        return [os.path.join(parent, near, "") for near in similar_words(name, beside)]
    return []


def setting_in(word: str) -> str | None:
    """Guess the setting meant by a bare number or size, or by a key with a wrong sign; return None if it is unknown.

    >>> setting_in("1920x1080"), setting_in("30s"), setting_in("look:oil"), setting_in("version"), setting_in("moo")
    ('resolution=1920', 'seconds=30', 'look=oil', 'brushexp --version', None)
    """
    if word == "version":
        return "brushexp --version"
    if pair := re.fullmatch(r"([\w.]+):=?(.+)", word):
        return f"{pair[1]}={pair[2]}" if is_key(pair[1]) else None
    size = re.fullmatch(r"(\d+)(?:[x×](\d+))?(px|p|s|sec|k|cm|mm|in|dpi)?|(a[0-6])", word.lower())
    if not size:
        return spellings("instead").get(plain_name(word))
    number, other, unit, _ = size.groups()
    if number is None or unit in ("cm", "mm", "in", "dpi"):
        return spellings("instead")["print_size"]
    if unit in ("s", "sec"):
        return f"seconds={number}"
    pixels = max(int(number), int(other or 0)) * (1000 if unit == "k" else 1)
    return f"resolution={pixels}" + f" or strokes={pixels}" * (not other and unit in (None, "k"))


def expand_home(word: str) -> str:
    """Expand the home folder in ``output=~/x``, because some shells do not; keys for pictures expand it themselves."""
    key, _, value = word.partition("=")
    is_other = key in ("image", "pictures", "style", "style.image", "focus", "faces") or os.path.lexists(value)
    if is_other or not re.fullmatch(r"~(/.*)?", value):
        return word
    if not has_home():
        raise UserError(f"{word}: this user has no home folder; write the path in full, {key}=/...")
    return f"{key}={os.path.expanduser(value)}"


def expand_shorthand(word: str, sweep: bool = False, task: str = "") -> str:
    """Rewrite an argument in Hydra's grammar; in a ``sweep``, commas separate the values of different jobs.

    ``task`` is the task that the argument belongs to, or "" if it is not known yet.
    """
    if word == RESUME_SWEEP:
        return "hydra.sweeper.resume=true"
    name, equal, value = expand_positional(word).partition("=")
    name, value = respell(name, value)
    if re.fullmatch(r"\+{0,2}style|~style", name) and equal and (is_path(value) or not value.startswith("{")):
        name += ".image"
    if name == "light" and (angles := re.fullmatch(r"\[?([^\[\]{]*)\]?", value)):
        azimuth, comma, elevation = angles[1].partition(",")
        if not comma or "," in elevation:
            raise UserError(
                f"{word} is not an azimuth and an elevation, in degrees; try light=315,45, or light.depth=0 for none"
            )
        return f"light={{azimuth:{azimuth},elevation:{elevation}}}"
    refuse_deletion(name)
    key = name.lstrip("+")
    if key in CHOSEN_GROUPS:
        check_choice(key, value)
    if key == "resume" and not value:
        raise UserError("resume= is empty; give the folder of an interrupted run")
    return name + equal + (output_folder(value) if key == "output" else spell_value(key, value, sweep, task))


def output_folder(value: str) -> str:
    """Write the value of ``output`` in Hydra's grammar; raise a UserError for a folder that cannot be used."""
    if not value:
        raise UserError("output= is empty; type output=FOLDER, or output=. for the current folder")
    if value.strip().lstrip("+-").lower() in NO_FOLDERS and not os.path.lexists(value):
        raise UserError(f"output={value} is not a folder; type output=FOLDER, or output=./{value} if that is its name")
    if "${" in value and is_path(value):
        raise UserError(f"Hydra cannot write into output={value}, because its name contains ${{; choose another folder")
    if NOT_LITERAL.match(value) or "${" in value:
        return quote_text("output", value)
    return verbatim(value)  # a folder, even in a sweep: a comma is part of its name


def spell_value(key: str, value: str, sweep: bool, task: str) -> str:
    """Write the value of a key in Hydra's grammar, according to the type of the key."""
    kind, optional = type_of_key(key, task)
    if kind in (int, float, bool) and not value:
        raise UserError(f"{key}= is empty; type {key}={example_of(key)}, or drop it")
    if kind is str:
        return quote_text(key, value, sweep, optional)
    if kind in (int, float) and not value.startswith(("[", "=", ":")) and not is_readable(value):
        return quote(value)  # so that the message says which kind of number is needed
    if get_origin(kind) is list and value and (is_path(value) or not NOT_LITERAL.match(value)):
        parts: Sequence[str] = [value] if is_path(value) else value.split(",")
        parts = [quote_text(key, part) for part in parts] if get_args(kind) == (str,) else parts
        return ",".join(f"[{part}]" for part in parts) if sweep else f"[{','.join(parts)}]"
    if key in MULTI_SELECT and key != "loss" and not sweep and re.fullmatch(r"[\w,]+", value):
        return f"[{value}]"
    return value


def refuse_deletion(name: str) -> None:
    """Raise a UserError for an argument that deletes a key, such as ``~strokes``; only plugin groups can be deleted."""
    key = name.removeprefix("~")
    if key != name and key not in CHOSEN_GROUPS and is_key(key):
        raise UserError(f"{name} would delete a key that every run needs; drop it, or type {key}=...")


def respell(key: str, value: str) -> tuple[str, str]:
    """Correct the spelling of a key or of a group's members: look=watercolor, style.colours=content."""
    plain = key.lstrip("+~")
    if switch_spelling(plain) != plain and not is_key(plain) and is_key(switch_spelling(plain)):
        key = key.removesuffix(plain) + switch_spelling(plain)
    if plain in CHOSEN_GROUPS and switch_spelling(value) != value:
        known = {plugin.name for plugin in plugins(plain)} | members_of_group(plain)
        parts = re.split(r"([\[\],])", value)
        value = "".join(
            switch_spelling(part) if part not in known and switch_spelling(part) in known else part for part in parts
        )
    return key, value


def parse_value(value: str) -> Any:
    """Parse a value as Hydra does; raise a `HydraException` if Hydra's grammar does not allow it."""
    return OverridesParser.create().parse_override(f"key={value}").value()


def is_readable(value: str) -> bool:
    """Check whether Hydra's grammar allows a value."""
    try:
        parse_value(value)
    except HydraException:
        return False
    return True


def verbatim(text: str) -> str:
    """Write text so that Hydra reads it literally, with quotes if necessary."""
    try:
        return text if parse_value(text) == text and "${" not in text else quote(text)
    except HydraException:
        return quote(text)


def quote_text(key: str, value: str, sweep: bool = False, optional: bool = False) -> str:
    """Quote the value of a text key if Hydra would read it as a number or null, or if it names an existing file.

    Raises a UserError for a value that could mean either a file or null.
    """
    if is_path(value):
        if value == "null" and optional:
            raise UserError(f"{key}=null is ambiguous: a file has that name; type {key}=./null, or drop the word")
        return verbatim(value)
    parts = value.split(",")
    if sweep and len(parts) > 1 and (any(map(is_path, parts)) or not re.search(r"['\"\[({]", value)):
        return ",".join(quote_text(key, part, optional=optional) for part in parts)
    try:
        reading = parse_value(value)
    except HydraException:
        return quote(value)
    is_number = isinstance(reading, int | float) or (reading is None and not optional)
    return quote(value) if is_number else value


def check_choice(group: str, value: str) -> None:
    """Raise a UserError, which lists the plugins, for a value that cannot name plugins or presets."""
    try:
        choice = parse_value(value)
    except HydraException:
        return  # Hydra's grammar will say what is wrong
    choices = choice.list if isinstance(choice, ChoiceSweep) else [choice]
    if group in MULTI_SELECT:
        choices = [name for one in choices for name in (one if isinstance(one, list) else [one])]
    if not all(isinstance(name, str | dict | Sweep | Glob) for name in choices) or value == "''":
        names = ", ".join(plugin.name for plugin in plugins(group)) or "the names that --help lists"
        raise UserError(f"{group}={value} is not a name; choose one of {names}")


def as_typed(value: Any, *, is_part: bool = False) -> str:
    """Write a value as a user would type it, with quotes around strings in lists or mappings where necessary."""
    plain: Any = OmegaConf.to_container(value) if OmegaConf.is_config(value) else value
    plain = plain.item() if hasattr(plain, "item") else plain  # scalars of NumPy and PyTorch become Python's
    if plain is None or isinstance(plain, bool):
        return {None: "null", True: "true", False: "false"}[plain]
    if isinstance(plain, Mapping):
        return "{" + ",".join(f"{key}:{as_typed(item, is_part=True)}" for key, item in plain.items()) + "}"
    if isinstance(plain, list | tuple):
        return "[" + ",".join(as_typed(item, is_part=True) for item in plain) + "]"
    if isinstance(plain, str | os.PathLike):
        return verbatim(os.fspath(plain)) if is_part else os.fspath(plain)
    return plain.name if isinstance(plain, Enum) else str(plain)
