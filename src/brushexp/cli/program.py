"""Run the program with the user's command-line arguments and report errors."""

import logging
import os
import re
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import get_origin

import hydra
from hydra.errors import CompactHydraException
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from brushexp.cli.help import help_text, words_and_topic
from brushexp.cli.many_pictures import expand_pictures
from brushexp.compat.hidden_packages import REMARKS
from brushexp.compat.hydra import parse_arguments, shared_store, skip_sweep_check
from brushexp.config.changes import expand_changes
from brushexp.config.compose import CHOSEN_GROUPS, compose_config, folders_of, search_path, without_folder
from brushexp.config.key_types import is_key, type_of_key
from brushexp.config.keys import keys_of
from brushexp.config.mistakes import explanation
from brushexp.config.publish import prepare
from brushexp.config.schema import Task
from brushexp.config.stands_for import spell_out
from brushexp.config.tasks import TASKS, add_task
from brushexp.config.vocabulary import is_path
from brushexp.config.words import (
    ALL_PIXELS,
    RESUME_SWEEP,
    expand_home,
    expand_positional,
    expand_shorthand,
    respell,
)
from brushexp.errors import UserError
from brushexp.registry import MULTI_SELECT
from brushexp.system.heartbeat import heartbeat
from brushexp.system.runtime import end_on_signals, interrupted_code
from brushexp.system.words import table_of_words

RESOLUTIONS = ("resolution=", "working_resolution=")

_prepared: set[int] = set()  # ids of processes that have loaded the plugins
_start = [time.monotonic()]  # start time of the program


@hydra.main(version_base="1.3", config_path="pkg://brushexp.conf", config_name="config")
def job(cfg: DictConfig) -> dict[str, object] | float:
    """Run a config's task and return its metrics or objective; the worker processes of a parallel sweep start here."""
    if os.getpid() not in _prepared:
        prepare(Path(), warns=False)
        _prepared.add(os.getpid())
    from brushexp.runs.runner import run_task  # noqa: PLC0415  (Lightning takes seconds to import; --help should not)

    return run_task(cfg, _start[0])


def run(start: float) -> None:
    """Run the program with the arguments in `sys.argv`; ``start`` is its launch time, as given by `time.monotonic`."""
    _start[0] = start
    typed_words = sys.argv[1:]
    with reporting_errors([word for word in typed_words if not word.startswith("--help=")]):
        words, topic = words_and_topic(typed_words)
        prepare(Path(), words)  # before Hydra composes, which reads the choices
        _prepared.add(os.getpid())
        words, folders = settings_first(expand_arguments(words)), folders_of(Path(), words)
        typed = parse_arguments(words)[0]
        if typed.help:  # Hydra's own help takes seconds to list the config groups
            settings = [word for word in typed.overrides if not word.endswith("=")]  # renderer= asks for its members
            heartbeat.end()
            print(help_text(compose_config(settings, folders), typed.overrides, folders, topic))
        else:
            sys.argv[1:] = search_path(folders) + without_folder(words)
            with shared_store(), skip_sweep_check(words):
                job()


def settings_first(words: Sequence[str]) -> list[str]:
    """Move flags after all settings, because Hydra accepts settings only as one contiguous block."""
    typed, after_flags = parse_arguments(words)
    return sorted(words, key=lambda word: word not in (*typed.overrides, *after_flags))


def expand_arguments(arguments: list[str]) -> list[str]:
    """Expand the shorthand in a command line (`brushexp.config.words`), and turn several pictures into a sweep.

    Raises a UserError that names an argument if it is not ``key=value`` or has an invalid value.
    """
    arguments = drop_implied([expand_home(word) for word in arguments])
    typed, after_flags = parse_arguments(arguments)
    refuse_flags(arguments, after_flags)
    overrides = {*typed.overrides, *after_flags}
    task = next((word.removeprefix("task=") for word in arguments if word.removeprefix("task=") in TASKS), "paint")
    beside = dict(word.split("=", 1) for word in overrides if "=" in word)
    words = [
        expand_positional(word, task, beside, following) if word in overrides else word
        for word, following in zip(arguments, following_words(arguments), strict=True)
    ]
    check_duplicates(arguments, words, TASKS[task].alone)
    flags = {word for word, argument in zip(words, arguments, strict=True) if argument not in overrides}
    words = join_paths(spell_out(words), TASKS[task])
    whole = expand_changes(add_task(resume_in_own_folder(words)), sweep=typed.multirun)
    ours = {*whole} - flags
    plain = expand_pictures(whole, typed.multirun)
    has_study = any(word.startswith("experiment=") for word in plain)
    task = "" if has_study else next((word[5:] for word in reversed(plain) if word.startswith("task=")), "paint")
    if typed.multirun and task == "paint" and not any(word.startswith(RESOLUTIONS) for word in plain):
        plain = [*plain, ALL_PIXELS]
    return [expand_shorthand(word, typed.multirun, task) if word in ours else word for word in plain]


def following_words(words: Sequence[str]) -> list[str]:
    """Return, for each word, the next one if it may be the word's value, otherwise "".

    >>> following_words(["strokes", "=", "100", "--help", "look=ink"])
    ['100', '100', '', '', '']
    """
    following = []
    for k in range(1, len(words) + 1):
        word = next((word for word in words[k:] if word != "="), "").removeprefix("=")
        following.append("" if "=" in word or word.startswith("-") else word)
    return following


def refuse_flags(words: Sequence[str], unknown: Sequence[str]) -> None:
    """Raise a UserError for unknown flags in a command line; it explains that keys have no dashes."""
    for word, following in zip(words, following_words(words), strict=True):
        name, equal, value = word.lstrip("-").partition("=")
        if word in unknown and re.match("--|-.+=", word):
            cure = f"type {name}={value or following or '...'}, without dashes" if equal or is_key(name) else ""
            cure = f"type ./{word} for the file of that name" if is_path(word) else cure
            raise UserError(f"{word} is not a flag; {cure or '--help lists the keys, which have no dashes'}")


def drop_implied(words: Sequence[str]) -> list[str]:
    """Drop arguments implied by a more specific one, such as strokes=auto next to worth=fine."""
    general = table_of_words("general")
    return [word for word in words if word not in general or not any(one.startswith(general[word]) for one in words)]


def check_duplicates(typed: Sequence[str], meant: Sequence[str], alone: str) -> None:
    """Raise a UserError if two words set a key differently, such as finer and bolder, or if a group is chosen twice.

    Of two plain values of a key, such as ``steps=30 steps=40``, the last one counts, as always in Hydra. Pictures, sets
    of pictures and the paths of a task, whose key is ``alone``, may be repeated.
    """
    first: dict[str, tuple[str, str]] = {}
    for word, setting in zip(typed, meant, strict=True):
        key, equal, value = setting.partition("=")
        key, value = respell(key, value)
        if not equal or key in (alone, "image", "pictures") or word.startswith("-"):
            continue
        other, before = first.setdefault(key, (word, value))
        is_typed = {other.partition("=")[0], word.partition("=")[0]} == {key}
        if before == value or (is_typed and key not in CHOSEN_GROUPS):
            continue
        if is_typed:
            raise UserError(f"{key} is given twice: {before} and {value}; keep one{both_of(key, before, value)}")
        raise UserError(f"{other} and {word} both set {key}; keep one{both_of(key, before, value)}")


def both_of(key: str, first: str, second: str) -> str:
    """Say how to use both values of a key, as a list or in a sweep; return "" if they are not single values.

    >>> both_of("look", "ink", "oil"), both_of("loss", "mse", "l1"), both_of("look", "ink,oil", "even")
    (', or try both: -m look=ink,oil', ", or type both: 'loss=[mse,l1]'", '')
    """
    kind = type_of_key(key)[0]
    if "," in first + second or not is_key(key.lstrip("+")):
        return ""
    if key.lstrip("+") in MULTI_SELECT or get_origin(kind) is list:
        return f", or type both: '{key}=[{first},{second}]'"
    return f", or try both: -m {key}={first},{second}"


def join_paths(words: Sequence[str], schema: type[Task]) -> list[str]:
    """Join bare paths if the task takes a list of paths; raise a UserError for several paths if it takes only one."""
    begin = f"{schema.alone}="
    several = [word.removeprefix(begin) for word in words if word.startswith(begin)]
    if schema.alone in ("", "image") or len(several) < 2:
        return [*words]
    if keys_of(schema)[schema.alone].annotation != list[str]:
        raise UserError(f"{begin} takes one path, not {len(several)}: {', '.join(several)}; type one of them")
    first = next(k for k, word in enumerate(words) if word.startswith(begin))
    others = [word for word in words[first:] if not word.startswith(begin)]
    return [*words[:first], begin + ",".join(several), *others]


def resume_in_own_folder(words: Sequence[str]) -> list[str]:
    """Set ``output`` to the folder of the resumed run unless the user names another folder."""
    resumed = [word.removeprefix("resume=") for word in words if word.startswith("resume=") and word != RESUME_SWEEP]
    if not resumed or any(word.startswith("output=") for word in words):
        return [*words]
    return [*words, f"output={resumed[-1]}"]


@contextmanager
def reporting_errors(words: Sequence[str]) -> Iterator[None]:
    """Report errors that a user can fix as one line on stderr with an exit code; bugs keep their traceback."""
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # otherwise Hydra handles exceptions
    warnings.filterwarnings("ignore", REMARKS)
    logging.raiseExceptions = False  # no tracebacks from the log on a full disk
    end_on_signals()
    try:
        yield
    except KeyboardInterrupt:
        heartbeat.end()
        sys.exit(interrupted_code())
    except BrokenPipeError:  # the reader is gone, as in --help | head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # otherwise Python reports it again at exit
        sys.exit(1)
    except (UserError, CompactHydraException, OmegaConfBaseException, OSError) as error:
        if isinstance(error, OSError) and error.errno is None and not isinstance(error, CompactHydraException):
            raise
        try:
            message = explanation(error, folders_of(Path(), words), sys.argv[1:])
        except UserError as wrong:  # in the user's own folder of configs
            message = str(wrong)
        heartbeat.end()
        print(f"brushexp: {message}", file=sys.stderr)
        sys.exit(1)
