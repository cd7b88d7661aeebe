"""What stands around the tasks on the command line: plugins before, short forms written out, errors of one line."""

import logging
import os
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_origin

from hydra._internal.utils import get_args_parser
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import ChoiceSweep, Sweep
from hydra.errors import CompactHydraException, HydraException
from omegaconf.errors import OmegaConfBaseException

from brushexp.cli.help import help_text
from brushexp.cli.many_pictures import as_sweep
from brushexp.cli.mistakes import explanation
from brushexp.config.composition import offer
from brushexp.config.configs import chosen_groups, composed, folders_of, quoted
from brushexp.config.keys import keys_of
from brushexp.config.tasks import TASKS, load_tasks, suited
from brushexp.errors import UserError
from brushexp.pictures.folders import PICTURES
from brushexp.pictures.load import samples
from brushexp.plugin_loading import load_plugins
from brushexp.registry import MULTI_SELECT, plugins
from brushexp.system.runtime import end_on_signals, interrupted_code

RESUME_SWEEP = "resume=sweep"
CATALOGUES = (".h5", ".json")
RESULTS = ("metrics.json", "report.html", "multirun.yaml")  # what a folder of a run or sweep has one of


def prepare(root: Path, arguments: Sequence[str] = ()) -> None:
    """Load the plugins of the program and of ``root/plugins``, and offer tasks and presets to Hydra."""
    load_tasks()
    load_plugins(root / "plugins")
    offer(folders_of(root, arguments))


def asks_for_help(arguments: Sequence[str]) -> bool:
    """Print ``--help`` if the command line has it; Hydra's own takes seconds to list groups of configs."""
    typed, _ = get_args_parser().parse_known_args(arguments)
    if not typed.help:
        return False
    folders = folders_of(Path(), arguments)
    print(help_text(composed(typed.overrides, folders), typed.overrides, folders))
    return True


def in_full(arguments: list[str]) -> list[str]:
    """The command line with its short forms written out, and its texts as Hydra takes them.

    A word alone is a task or a picture: ``train``, ``photo.jpg``, ``photos/``; several pictures are a sweep.
    ``resume=sweep`` is an option of the sweeper, ``style=painting.jpg`` is ``style.image=painting.jpg``,
    ``light=315,45`` an azimuth and an elevation; and keys that take several values do without brackets:
    ``to=svg,json``, ``logger=csv,wandb``, ``ratios=0,0.5``. In a sweep commas separate the values of jobs, so
    ``data=a,b`` are two jobs with one data set each. A UserError says which word is no ``key=value``, or has no value
    that could be meant.
    """
    typed, after_flags = get_args_parser().parse_known_args(arguments)
    overrides = {*typed.overrides, *after_flags}
    words = [meant(word) if word in overrides else word for word in arguments]
    typed_words = {word for word, argument in zip(words, arguments, strict=True) if argument in overrides}
    plain = as_sweep(suited(words), typed.multirun)
    return [written_out(word, typed.multirun) if word in typed_words else word for word in plain]


def written_out(word: str, sweep: bool) -> str:
    """One word of `in_full`; in a ``sweep`` commas separate the values of jobs."""
    if word == RESUME_SWEEP:
        return "hydra.sweeper.resume=true"
    full = re.sub(r"^(\+{0,2}|~)style=(?!\{)", r"\1style.image=", meant(word))
    if lamp := re.fullmatch(r"light=\[?([^\[\]{]*)\]?", full):
        angles = lamp[1].split(",")
        if len(angles) != 2:
            raise UserError(f"{word} is not an azimuth and an elevation, in degrees; try light=315,45")
        full = f"light={{azimuth:{angles[0]},elevation:{angles[1]}}}"
    name, equal, value = full.partition("=")
    key = name.lstrip("+")
    kind, optional = kinds_of_keys().get(key, (None, False))
    if key in chosen_groups():
        check_choice(key, value)
    if kind is str:
        value = in_quotes(key, value, sweep, optional)
    elif get_origin(kind) is list and value and not re.match(r"[\['\"{]|null$|\w+\(|\$\{", value):
        parts = [value] if os.path.exists(value) else value.split(",")
        if get_args(kind) == (str,):
            parts = [in_quotes(key, part) for part in parts]
        value = ",".join(f"[{part}]" for part in parts) if sweep else f"[{','.join(parts)}]"
    elif key in MULTI_SELECT and key != "loss" and not sweep and re.fullmatch(r"[\w,]+", value):
        value = f"[{value}]"
    return name + equal + value


@cache
def kinds_of_keys() -> dict[str, tuple[Any, bool]]:
    """Of every key of a task and option of a plugin, by what is typed: its type, and whether it may be null."""
    found = [(name, key.annotation) for schema in TASKS.values() for name, key in keys_of(schema).items()]
    found += [(f"{plugin.path}.{item.name}", item.type) for plugin in plugins() for item in fields(plugin.config)]
    optional = {name for name, kind in found if NoneType in get_args(kind)}  # of one of the tasks that have this key
    return {name: (without_none(kind), name in optional) for name, kind in found}


def without_none(kind: Any) -> Any:
    """The type of a key that may be null, as one that may not."""
    parts = get_args(kind)
    return next(part for part in parts if part is not NoneType) if NoneType in parts else kind


def parsed(value: str) -> Any:
    """What Hydra makes of a typed value; a `HydraException` if its grammar does not have it."""
    return OverridesParser.create().parse_override(f"key={value}").value()


def in_quotes(key: str, value: str, sweep: bool = False, optional: bool = False) -> str:
    """The value of a key that takes a text, in quotes where Hydra would read something else into it.

    Its own syntax (quotes, lists, sweeps) is left to it, unless a file has this name; what may mean a file or nothing
    is refused (UserError).
    """
    if value and os.path.exists(os.path.expanduser(value)):
        if value == "null" and optional:
            raise UserError(f"{key}=null is none, but a file has this name; type {key}=./null, or drop the word")
        return verbatim(value)
    parts = value.split(",")
    if sweep and len(parts) > 1 and (any(map(os.path.exists, parts)) or not re.search(r"['\"\[({]", value)):
        return ",".join(in_quotes(key, part, optional=optional) for part in parts)
    try:
        found = parsed(value)
    except HydraException:
        return quoted(value)
    is_number = isinstance(found, int | float) or (found is None and not optional)
    return quoted(value) if is_number else value


def verbatim(value: str) -> str:
    """A text as it is typed for Hydra to read just that: in quotes if it needs them."""
    return quoted(value) if unlike(value) else value


def unlike(value: str) -> bool:
    """Whether Hydra reads a text as something else."""
    try:
        return bool(parsed(value) != value) or "${" in value
    except HydraException:
        return True


def check_choice(group: str, value: str) -> None:
    """Refuse what can be no name of a plugin or preset, nor a list of names; the UserError names the plugins."""
    try:
        found = parsed(value)
    except HydraException:
        return  # the grammar says what is wrong
    found = found.list if isinstance(found, ChoiceSweep) else [found]
    single = group not in MULTI_SELECT
    names = found if single else [name for one in found for name in (one if isinstance(one, list) else [one])]
    if not all(isinstance(name, str | dict | Sweep) for name in names) or value == "''":
        choices = ", ".join(plugin.name for plugin in plugins(group)) or "those that --help lists"
        raise UserError(f"{group}={value} is no name; choose one of {choices}")


def meant(word: str) -> str:
    """A word as ``key=value``: one alone is a task, or a picture or folder of pictures; a UserError if it is none."""
    if "=" in word or word.startswith("~"):
        return word
    path = Path(word)
    if word in TASKS:
        return f"task={word}"
    if path.suffix.lower() in CATALOGUES or any((path / name).exists() for name in RESULTS):
        raise UserError(f"{word} is no key=value; to look at a painting, run or sweep: task=view catalogue={word}")
    suits = any(task.suits({"image": word}) for task in TASKS.values())
    if suits or path.suffix.lower() in PICTURES or path.exists() or word in samples():
        return f"image={word}"
    raise UserError(f"{word} is no key=value, as image=photo.jpg is; --help lists the keys")


@contextmanager
def explained(words: Sequence[str]) -> Iterator[None]:
    """Turn what a user can mend, of the ``words`` that were typed, into one line on stderr and an exit code.

    Bugs go through with their traceback.
    """
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # Hydra then leaves exceptions to us
    warnings.filterwarnings("ignore", ".*LeafSpec.*", FutureWarning)  # Lightning calls a name that torch deprecates
    logging.raiseExceptions = False  # a log that cannot be written, on a full disk, is no reason for tracebacks
    end_on_signals()
    try:
        yield
    except KeyboardInterrupt:
        sys.exit(interrupted_code())
    except BrokenPipeError:  # whoever read this has seen enough: --help | head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains once more at its end
        sys.exit(1)
    except (UserError, CompactHydraException, OmegaConfBaseException, OSError) as error:
        if isinstance(error, OSError) and error.errno is None and not isinstance(error, CompactHydraException):
            raise
        try:
            told = explanation(error, folders_of(Path(), words), sys.argv[1:])
        except UserError as wrong:  # in the user's own folder of configs
            told = str(wrong)
        print(f"brushexp: {told}", file=sys.stderr)
        sys.exit(1)
