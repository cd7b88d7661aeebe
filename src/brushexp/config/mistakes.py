"""Explain Hydra and OmegaConf errors: what is wrong, and what to type instead."""

import math
import os
import re
from collections.abc import Sequence
from dataclasses import fields
from enum import EnumType
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

from hydra.errors import CompactHydraException
from omegaconf import MISSING, DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.bounds import Bounds
from brushexp.config.check import cure_for, listing_of, meant_by, unknown_key, unknown_option
from brushexp.config.compose import CHOSEN_GROUPS, compose_config, files_of
from brushexp.config.key_types import type_of_key
from brushexp.config.keys import groups_of, keys_of
from brushexp.config.tasks import TASKS, add_task
from brushexp.config.vocabulary import with_words_of_changes
from brushexp.config.words import as_typed
from brushexp.registry import MULTI_SELECT, loaded_plugins, plugins
from brushexp.registry.loading import reasons_for_missing

LIGHTNINGS = "; a plugin can wrap any other callback of Lightning, see docs/tutorial.md"
NONE = ("none", "no", "off", "false")  # spellings of an empty list
DECIMAL_COMMA = re.compile(r"([+-]?(?:\d+|\d{1,3}(?:\.\d{3})+))(,\d+(?:e[+-]?\d+)?)?")  # a number with a decimal comma
UNSET = (*NONE, "all", "auto", "automatic", "default", "max", "unlimited", "never", "random")  # spellings of null
SCALES = {
    **dict.fromkeys(["", "px", "pixels", "db", "s", "sec"], 1),
    "k": 1000,
    "m": 60,
    "min": 60,
    "mins": 60,
    "minutes": 60,
    "h": 3600,
    "%": 0.01,
}  # units after a number
KINDS = {int: "a whole number", float: "a number", bool: "true or false", str: "text", dict: "{name: value}"}


def explanation(error: BaseException, folders: Sequence[Path], arguments: Sequence[str]) -> str:
    """Explain in one line an error raised by Hydra, OmegaConf or the program, and say what to type instead."""
    if isinstance(error, OSError) and not isinstance(error, CompactHydraException):
        return f"cannot use {error.filename or 'the disk'}: {error.strerror}; choose another place with output=..."
    text = " ".join(str(error).partition("Config search path")[0].split())
    if isinstance(error, CompactHydraException) and isinstance(error.__cause__, OmegaConfBaseException):
        text += f": {' '.join(str(error.__cause__).split())}"
    if match := re.search(r"interpolation '\$\{look\}_\$\{(\w+)\}'", text):
        return f"no {match[1]} is chosen; choose one of {', '.join(choices(match[1], folders))}"
    if match := re.search(r"interpolation '\$\{look\}_(\w+)'", text):
        family = next((word.partition("=")[0].lstrip("+") for word in arguments if word.startswith("+")), "loss")
        return f"+{family}={match[1]} has no list to add to; type the whole list, {family}=[...,{match[1]}]"
    message = translate(text, task_of(arguments, folders), folders, arguments)
    return with_words_of_changes(message) if message else explain_unparsed(error) or text


def translate(text: str, task: str, folders: Sequence[Path], arguments: Sequence[str] = ()) -> str | None:
    """Translate a Hydra or OmegaConf error message for a task; return None for an unknown message."""
    if message := explain_grammar_error(text):
        return message
    if match := re.search(r"Could not (?:find|load) '(\w+)/([^']*)'", text):
        names = choices(match[1], folders)
        more = LIGHTNINGS if match[1] == "callbacks" else ""
        near = cure_for(match[2], names, listing_of(match[1]))
        near = f"type {match[1]}=[] for none" if match[1] in MULTI_SELECT and match[2] in NONE else near
        return f"{match[1]}={match[2]} does not exist; {near}{more}{reasons_for_missing()}" if names else None
    if match := re.search(r"Could not override '([\w.@/]+)'.*No match in the defaults list", text):
        formats = [re.sub(r"[][]", "", word) for word in arguments if word.startswith("to=")]
        if match[1] != "to" or not formats or not TASKS[task].painted:
            return group_of_others(match[1], task)
        return formats_of_finished(formats[-1], TASKS[task].painted, choices("to", folders))
    if match := re.search(r"Key '(\w+)' not in '(\w+)'", text):
        found = [plugin for plugin in loaded_plugins() if plugin.config.__name__ == match[2]]
        return unknown_option(match[1], found[0], arguments) if found else None
    match = re.search(r"Key '[^']*' is not in struct full_key: (\S+)", text)
    return unknown_key(match[1], task) if match else wrong_type(text, task)


def group_of_others(group: str, task: str) -> str:
    """Explain that a task does not have a config group, and name the groups that it has and the tasks that have it."""
    owners = [f"task={name}" for name, schema in TASKS.items() if group in groups_of(schema)]
    more = f". {group} is one of {', '.join(owners)}" if owners else ""
    return f"task={task} has no {group}; it has {', '.join(groups_of(TASKS[task])) or 'no plugins'}{more}"


def formats_of_finished(typed: str, painted: str, formats: Sequence[str]) -> str:
    """Explain that ``to=`` is for finished paintings; for a format that does not exist, list those that do.

    >>> formats_of_finished("to=pdff", "FOLDER", ["pdf", "png"])
    'to=pdff does not exist; did you mean pdf? There are pdf, png; after painting, type: brushexp export FOLDER to=pdf'
    """
    names = typed.removeprefix("to=").split(",")
    meant = {name: [name] if name in formats else meant_by(name, formats) for name in names}
    cure = f"after painting, type: brushexp export {painted} to="
    if {*names} <= {*formats}:
        return f"{typed} is for finished paintings; drop {typed}, and {cure}{','.join(names)}"
    known = ",".join(near[0] for near in meant.values() if near)
    asked = f"did you mean {known}? There are" if known else "there are"
    return f"{typed} does not exist; {asked} {', '.join(sorted(formats))}; {cure}{known or 'png'}"


def explain_grammar_error(text: str) -> str | None:
    """Translate an error message about an argument that cannot be parsed; return None for other messages."""
    if match := re.match(r"LexerNoViableAltException: (.*?) \^ See |Ambiguous value for argument '(.*?)' ", text):
        return explain_quoting(match[1]) if match[1] else several(match[2])
    if match := re.search(r"Sweep parameters '(.*)' requires --multirun", text):
        return several(match[1])
    if match := re.search(r"Could not delete (from config\. )?'([\w./@]+)'", text):
        empty = f"{match[2]}=[]" if match[2] in MULTI_SELECT else f"another {match[2]}=..."
        return f"~{match[2]} deletes nothing; {'there is no such key, so drop it' if match[1] else f'type {empty}'}"
    if "${" in os.getcwd() and re.search(r"Interpolation key|'\$\{'|<EOF>", text):
        return f"Hydra cannot write into {os.getcwd()}, because its name contains ${{; change to another folder"
    if match := re.search(r"Interpolation key '(\w+)' not found", text):
        cure = f"${{hydra:runtime.choices.{match[1]}}}" if match[1] in CHOSEN_GROUPS else "the name of a key"
        return f"${{{match[1]}}} does not name a key; type {cure} instead"
    return None


def explain_unparsed(error: BaseException) -> str | None:
    """Explain an argument that Hydra's parser rejects without explanation; return None for other errors."""
    word = getattr(error, "override", None)
    if word and (twice := re.fullmatch(r"([\w.]+)=[=:](.*)", word)):
        return f"{word} has one sign too many; type {twice[1]}={twice[2]}"
    return f"{word} cannot be parsed; a list is key=[a,b], a text with such characters key='\"...\"'" if word else None


def explain_quoting(word: str) -> str:
    """Explain how to quote an argument that contains special characters in Hydra's grammar."""
    key = word.partition("=")[0]
    return f"{word} has characters that need quotes; type both kinds: '{key}=\"...\"'"


def several(word: str) -> str:
    """Explain how to enter several values, or a number with a decimal comma or thousands separators."""
    key, _, value = word.partition("=")
    if (takes_fractions(key) or "x" in value) and (meant := with_decimal_points(value)):
        thousands = f" or {key}={value.replace(',', '')}" if re.fullmatch(r"[1-9]\d{0,2},\d{3}", value) else ""
        return f"{word} are several values; type {key}={meant}{thousands}, or add -m for a sweep"
    if key == "background" and re.fullmatch(r"\d{1,3}(,\d{1,3}){2}", value):
        color = bytes(min(int(part), 255) for part in value.split(",")).hex()
        return f"{word} are several values; type {key}='#{color}'"
    if re.fullmatch(r"\d{1,3}(,\d{3})+", value):
        return f"{word} is read as several values; type {key}={value.replace(',', '')}, or add -m for a sweep"
    if key in MULTI_SELECT:
        return f"{word} are several values; type '{key}=[{value}]' for all of them, or add -m for a sweep"
    return f"{word} are several values; add -m for a sweep"


def takes_fractions(key: str) -> bool:
    """Check whether a key, or an option of a plugin or preset, accepts fractions.

    >>> [takes_fractions(key) for key in ("psnr", "+loss.mine.weight", "optimizer.units.width", "strokes", "image")]
    [True, True, True, False, False]
    """
    name = key.lstrip("+~")
    family, _, option = name.partition(".")
    of_presets = [f"{plugin.path}.{option.partition('.')[2]}" for plugin in plugins() if plugin.family == family]
    kinds = [type_of_key(one)[0] for one in (name, name.rpartition(".")[0], *of_presets)]
    return any(kind is float or float in get_args(kind) for kind in kinds)


def with_decimal_points(value: str) -> str | None:
    """Replace decimal commas with points in a number or a size such as 29,7x21; return None for other values.

    >>> [with_decimal_points(value) for value in ("30,5", "1.000,5", "-1,5e-3", "29,7x21")]
    ['30.5', '1000.5', '-1.5e-3', '29.7x21']
    >>> with_decimal_points("30.5"), with_decimal_points("1,2,3"), with_decimal_points("a,5")
    (None, None, None)
    """
    parts = [DECIMAL_COMMA.fullmatch(part) for part in value.split("x")]
    sides = [part for part in parts if part]
    if len(sides) < len(parts) or len(sides) > 2 or not any(side[2] for side in sides):
        return None
    return "x".join(side[1].replace(".", "") + (side[2] or "").replace(",", ".") for side in sides)


def task_of(arguments: Sequence[str], folders: Sequence[Path]) -> str:
    """Determine the task that a command line or its experiment names."""
    words = [word for word in add_task(arguments) if re.fullmatch(r"(task|experiment)=\w+", word)]
    if not any(word.startswith("experiment=") for word in words):
        typed = [word.removeprefix("task=") for word in words]
        return next((name for name in reversed(typed) if name in TASKS), "paint")
    try:
        return str(compose_config(words, folders).task)
    except (CompactHydraException, OmegaConfBaseException):
        return "paint"


def choices(group: str, folders: Sequence[Path]) -> list[str]:
    """List the names that can be chosen in a config group."""
    names = [plugin.name for plugin in plugins(group)]
    presets = [name for folder in folders for name in files_of(folder, group)]
    return names + presets + (list(TASKS) if group == "task" else [])


def wrong_type(text: str, task: str) -> str | None:
    """Explain that a value has the wrong type for a key or option; return None for other errors."""
    typed = re.search(r"full_key: ([^\s\[]+)", text)
    if typed is None or (declared := declaration_of(path := typed[1], task)) is None:
        return None
    annotation, usual, meaning = declared
    value = re.search(r"override [\w.@/]+=(.*?): (?=[A-Z])|Value '(.*?)' ", text)
    example = "..." if usual == MISSING else as_typed(usual)
    if re.search(r"is not Optional|Incompatible value 'None'", text):
        wrong = f"{path}=null, but {path} must have a value"
    else:
        given = (value[1] or value[2]) if value else "..."
        wrong = f"{path}={given} is not {in_words(annotation)}"
        example = guess_value(given, strip_null(annotation), meaning) or example
        if (first := re.match(r"\[([^][{}:,]+),", given)) and "[" not in in_words(annotation):
            wrong, example = f"{wrong}: only one value is allowed", first[1]
    return f"{wrong}; try {path}={example}" + f" ({meaning})" * bool(meaning)


def guess_value(value: str, kind: Any, meaning: str) -> str | None:
    """Guess the value meant by a number with a unit, a size, a word for none, or text in place of a list.

    Returns None if there is no guess.

    >>> guess_value("512px", int, ""), guess_value("1920x1080", int, ""), guess_value("2min", float, "")
    ('512', '1920', '120')
    >>> guess_value("all", int, "cores; null = all"), guess_value("none", int, "frames; 0 = none")
    ('null', '0')
    >>> guess_value("many", int, ""), guess_value("20cm", int, "longer side of the picture in pixels")
    (None, None)
    >>> guess_value("1e3", int, ""), guess_value("50%", int, ""), guess_value("1:30", float, "seconds of optimisation")
    ('1000', None, '90')
    >>> guess_value("mask.png", list[str], "parts to measure"), guess_value("[a: 1]", list[str], "")
    ('[mask.png]', None)
    """
    if kind not in (int, float):
        return f"[{value}]" if get_args(kind) == (str,) and value[:1] != "[" else None
    value = value.strip("'\"").lower()
    value = (with_decimal_points(value) or value) if kind is float else value
    if value in UNSET:
        return next((choice for choice in ("0", "null") if f"{choice} = " in meaning), None)
    if (time := re.fullmatch(r"(\d+):(\d\d)", value)) and meaning.startswith("seconds"):
        return str(60 * int(time[1]) + int(time[2]))
    if kind is int and (sides := re.fullmatch(r"(\d+) ?[x×*:] ?(\d+)", value)):
        return str(max(int(side) for side in sides.groups()))
    if not (match := re.fullmatch(r"(\d+(?:\.\d+)?(?:e\d+)?) ?([a-z%]*)", value)) or match[2] not in SCALES:
        return None
    number = float(match[1]) * SCALES[match[2]]
    return f"{number:g}" if kind is float else str(round(number)) if number >= 1 and math.isfinite(number) else None


def declaration_of(path: str, task: str) -> tuple[Any, Any, str] | None:
    """Look up the type, an example and the description of a key or plugin option; return None if it does not exist."""
    if (key := keys_of(TASKS[task]).get(path)) is not None:
        return key.annotation, key.example(), key.meaning
    above, _, option = path.rpartition(".")
    candidates = plugins(above.partition(".")[0])
    owners = [plugin for plugin in candidates if plugin.path == above and option in plugin.meanings]
    if not owners:
        return None
    (kind,) = (item.type for item in fields(owners[0].config) if item.name == option)
    node: DictConfig = OmegaConf.structured(owners[0].config)
    default = MISSING if OmegaConf.is_missing(node, option) else node[option]
    bounds = owners[0].bounds[option]
    return kind, bounds.example(default) if isinstance(bounds, Bounds) else default, ""


def strip_null(annotation: Any) -> Any:
    """Return the type that remains when null is removed from an optional type."""
    if isinstance(annotation, UnionType) or get_origin(annotation) is Union:
        return next(part for part in get_args(annotation) if part is not NoneType)
    return annotation


def in_words(annotation: Any) -> str:
    """Describe in words the values that a type allows."""
    parts = get_args(annotation)
    if (plain := strip_null(annotation)) is not annotation:
        return in_words(plain)
    if isinstance(annotation, EnumType):
        return f"one of {', '.join(annotation.__members__)}"
    if get_origin(annotation) in (list, tuple):
        return f"[{in_words(parts[0])},...]"
    return KINDS[get_origin(annotation) or annotation]
