"""What stands around the tasks on the command line: plugins before, short forms written out, errors of one line."""

from __future__ import annotations

import os
import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hydra import compose, initialize_config_dir
from hydra._internal.utils import get_args_parser
from hydra.errors import CompactHydraException
from omegaconf.errors import OmegaConfBaseException

from brushexp.app.composition import offer
from brushexp.app.help import help_text
from brushexp.app.keys import keys_of
from brushexp.app.mistakes import explanation
from brushexp.app.schema import TASKS
from brushexp.errors import UserError
from brushexp.registry import MULTI_SELECT, load_plugins
from brushexp.system.runtime import end_on_signals, interrupted_code

UNKNOWN_LETTERS = r"[^\x20-\x7e]|[<>&;#!^`']"  # that Hydra's grammar of values does not take without quotes
LISTS = {name for schema in TASKS.values() for name, key in keys_of(schema).items() if key.is_list}
SUFFIXES = {"catalogue": (".h5", ".json"), "image": (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp", ".gif")}


def prepare(root: Path, arguments: list[str] = []) -> None:  # noqa: B006
    """Load the plugins of the program and of ``root/plugins``, and offer tasks and presets to Hydra."""
    load_plugins(root / "plugins")
    offer(folders_of(root, arguments))


def folders_of(root: Path, arguments: list[str]) -> list[Path]:
    """Where configs are: ``root/conf``, and the folder that ``--config-dir`` names."""
    own = get_args_parser().parse_known_args(arguments)[0].config_dir
    return [root / "conf"] if own is None else [root / "conf", Path(own)]


def asks_for_help(root: Path, arguments: list[str]) -> bool:
    """Print ``--help`` if the command line has it; Hydra's own takes seconds to list groups of configs."""
    typed, _ = get_args_parser().parse_known_args(arguments)
    if not typed.help:
        return False
    folders = folders_of(root, arguments)
    with initialize_config_dir(version_base="1.3", config_dir=str(root / "conf")):
        search = [f"hydra.searchpath=[{folder.resolve()}]" for folder in folders[1:]]
        cfg = compose("config", overrides=[*typed.overrides, *search])
    print(help_text(cfg, typed.overrides, folders))
    return True


def in_full(arguments: list[str]) -> list[str]:
    """The command line with its short forms written out.

    ``style=painting.jpg`` is ``style.image=painting.jpg``; ``light=315,45`` is ``to.relief.light=[315,45]``; and keys
    that take several values do without brackets: ``to=svg,json``, ``logger=csv,wandb``, ``ratios=0,0.5``. In a sweep
    commas separate the values of jobs, so ``data=a,b`` are two jobs with one data set each. Values with letters that
    Hydra does not take unquoted (umlauts, < & ') are quoted.

    Raises:
        UserError: if a word is no ``key=value``.
    """
    typed, after_flags = get_args_parser().parse_known_args(arguments)
    overrides = {*typed.overrides, *after_flags}
    found = []
    for argument in arguments:
        if argument.startswith("-") or argument not in overrides:
            found.append(argument)
            continue
        check_word(argument)
        full = re.sub(r"^(\+{0,2}|~)style=(?!\{)", r"\1style.image=", argument)
        full = re.sub(r"^light=\[?([^\[\]]*)\]?$", r"to.relief.light=[\1]", full)
        key, equal, value = full.partition("=")
        values = [_quoted(part) for part in (value.split(",") if typed.multirun or key in LISTS else [value])]
        if key in LISTS and value and not re.match(r"[\['\"{]|null$|\w+\(|\$\{", value):
            values = [f"[{part}]" for part in values] if typed.multirun else [f"[{','.join(values)}]"]
        elif key in MULTI_SELECT and key != "loss" and not typed.multirun and re.fullmatch(r"[\w,]+", value):
            values = [f"[{value}]"]
        found.append(key + equal + ",".join(values))
    return found


def check_word(word: str) -> None:
    """Refuse a word without ``=``, and say what it may have been meant for.

    Raises:
        UserError: with what to type instead.
    """
    if "=" in word or word.startswith("~"):
        return
    path = Path(word)
    key = next((key for key, suffixes in SUFFIXES.items() if path.suffix.lower() in suffixes), None)
    if path.is_dir():
        raise UserError(f"{word} is no key=value; to look at a run or sweep: task=view catalogue={word}")
    if word in TASKS:
        raise UserError(f"{word} is no key=value; type task={word}")
    if key == "catalogue":
        raise UserError(f"{word} is no key=value; to look at a painting: task=view catalogue={word}")
    if key == "image" or path.is_file():
        raise UserError(f"{word} is no key=value; to paint a picture: image={word}")
    raise UserError(f"{word} is no key=value, as image=photo.jpg is; --help lists the keys")


def _quoted(value: str) -> str:
    """A value as Hydra takes it, if it is plain text: no list, function, comma, quotes or escapes of its own."""
    if re.search(r"^['\[{]|^\w+\(|[\\\",]", value) or not re.search(UNKNOWN_LETTERS, value):
        return value
    return f'"{value}"'


@contextmanager
def explained(root: Path) -> Iterator[None]:
    """Turn what a user can mend into one line on stderr and an exit code; let bugs through with their traceback."""
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # Hydra then leaves exceptions to us
    warnings.filterwarnings("ignore", ".*LeafSpec.*", FutureWarning)  # Lightning calls a name that torch deprecates
    end_on_signals()
    try:
        yield
    except KeyboardInterrupt:
        sys.exit(interrupted_code())
    except BrokenPipeError:  # whoever read this has seen enough: --help | head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains once more at its end
        sys.exit(1)
    except (UserError, CompactHydraException, OmegaConfBaseException, OSError) as error:
        if isinstance(error, OSError) and not isinstance(error, CompactHydraException) and error.filename is None:
            raise
        print(f"brushexp: {explanation(error, root / 'conf', sys.argv[1:])}", file=sys.stderr)
        sys.exit(1)
