"""What stands around the tasks on the command line: plugins before, errors that can be read after."""

from __future__ import annotations

import os
import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

from hydra.errors import CompactHydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.app.checks import NESTED, schemas
from brushexp.errors import UserError
from brushexp.registry import FAMILIES, MULTI_SELECT, load_plugins, plugins

ODD = r"[^\x20-\x7e]|[<>&;#!^`']"  # letters that Hydra's grammar of values does not know
HYDRAS = "# @package _global_\n"  # first line of a config whose keys belong to the task


def prepare(root: Path) -> None:
    """Load the plugins of the program and of ``root/plugins``, and let ``--help`` list them."""
    load_plugins(root / "plugins")
    OmegaConf.register_new_resolver("plugins", lambda: catalogue_of_plugins(root / "conf"), replace=True)
    OmegaConf.register_new_resolver(
        "presets", lambda group: "\n".join(_lines(_presets(root / "conf" / group))), replace=True
    )


def catalogue_of_plugins(conf: Path) -> str:
    """Every plugin and preset of every family, one line each."""
    lines = []
    for family, meaning in FAMILIES.items():
        lines.append(f"{family}: {meaning}")
        rows = {plugin.name: plugin.summary for plugin in plugins(family)} | _presets(conf / family)
        lines += _lines(rows)
    return "\n".join(lines)


def _lines(rows: dict[str, str]) -> list[str]:
    """Names and what is said about them, by name."""
    return [f"    {name:<18}{summary}" for name, summary in sorted(rows.items())]


def _presets(folder: Path) -> dict[str, str]:
    """Name -> first comment line, after the one that Hydra reads, of each preset in a folder of configs."""
    texts = {path.stem: path.read_text(encoding="utf-8") for path in folder.glob("*.yaml")}
    return {name: text.removeprefix(HYDRAS).partition("\n")[0].lstrip("# ") for name, text in texts.items()}


def in_full(arguments: list[str]) -> list[str]:
    """The command line with its short forms written out.

    ``style=painting.jpg`` is ``style.image=painting.jpg``; ``light=315,45`` is ``to.relief.light=[315,45]``; and
    outside of a sweep ``to=svg,json`` is ``to=[svg,json]``, and ``logger=csv,wandb`` likewise. Values with letters that
    Hydra does not take unquoted (umlauts, < & ') are quoted.
    """
    sweep = any(re.fullmatch(r"--multirun|-[a-zA-Z]*m[a-zA-Z]*", argument) for argument in arguments)
    found = []
    for argument in arguments:
        full = re.sub(r"^(\+{0,2}|~)style=(?!\{)", r"\1style.image=", argument)
        full = re.sub(r"^light=\[?([^\[\]]*)\]?$", r"to.relief.light=[\1]", full)
        full = full if sweep else re.sub(r"^(to|logger)=([\w,]+)$", r"\1=[\2]", full)
        key, equal, value = full.partition("=")
        values = value.split(",") if sweep else [value]
        found.append(argument if key.startswith("-") else key + equal + ",".join(map(_quoted, values)))
    return found


def _quoted(value: str) -> str:
    """A value as Hydra takes it, if it is plain text: no list, function, comma, quotes or escapes of its own."""
    if re.search(r"^['\[{]|^\w+\(|[\\\",]", value) or not re.search(ODD, value):
        return value
    return f'"{value}"'


@contextmanager
def explained() -> Iterator[None]:
    """Turn what a user can mend into one line on stderr and an exit code; let bugs through with their traceback."""
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # Hydra then leaves exceptions to us
    warnings.filterwarnings("ignore", ".*LeafSpec.*", FutureWarning)  # Lightning calls a name that torch deprecates
    try:
        yield
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:  # whoever read this has seen enough: --help | head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains once more at its end
        sys.exit(1)
    except (UserError, CompactHydraException, OmegaConfBaseException, OSError) as error:
        if isinstance(error, OSError) and not isinstance(error, CompactHydraException) and error.filename is None:
            raise
        print(f"brushexp: {explanation(error)}", file=sys.stderr)
        sys.exit(1)


def explanation(error: BaseException) -> str:
    """What is wrong, in the words of the program."""
    if isinstance(error, OSError) and not isinstance(error, CompactHydraException):
        return f"cannot use {error.filename}: {error.strerror}; choose another place with output=..."
    text = " ".join(str(error).partition("Config search path")[0].split())
    if text.startswith("LexerNoViableAltException: "):
        typed = text.removeprefix("LexerNoViableAltException: ").partition(" ^ See ")[0]
        return f"{typed} has letters that must stand in quotes; put it into both kinds: 'catalogue=\"a, b.h5\"'"
    missing = re.search(r"Could not (?:find|load) '(\w+)/", text)
    if missing and missing[1] in FAMILIES and "Available options" not in text:
        text = f"{text.rstrip('.;')}; choose from: {', '.join(plugin.name for plugin in plugins(missing[1]))}"
    if isinstance(error, CompactHydraException) and isinstance(error.__cause__, OmegaConfBaseException):
        text += f": {' '.join(str(error.__cause__).split())}"
    single = re.search(r"override ([\w.@/]+)=(.*?): Invalid value assigned: \w+ is not a ListConfig", text)
    if single:
        text = f"{single[1]} takes a list; write '{single[1]}=[{single[2]}]'"
    option = re.search(r"Key '\w+' not in '(\w+)'", text)
    if option:
        names = [f.name for p in plugins() if p.config.__name__ == option[1] for f in fields(p.config)]
        text += f"; its options: {', '.join(name for name in names if name != '_target_') or 'none'}"
    elif (tuned := re.search(r"is not in struct full_key: (\w+)\.(\w+)", text)) and tuned[1] in MULTI_SELECT:
        text = f"{tuned[1]}.{tuned[2]} is tuned but not chosen; "
        if tuned[2] in {plugin.name for plugin in plugins(tuned[1])}:
            text += f"add {tuned[2]} to the list, '{tuned[1]}=[{tuned[2]},...]', or drop the keys below it"
        else:
            text += f"there are: {', '.join(plugin.name for plugin in plugins(tuned[1]))}"
    elif "is not in struct" in text:
        above = re.search(r"full_key: (\w+)\.\w+ ", text)
        if above and above[1] in NESTED:
            keys = {field.name for field in fields(NESTED[above[1]])}
        else:
            keys = {field.name for schema in schemas() for field in fields(schema)} | set(FAMILIES)
        text += f"; the keys are {', '.join(sorted(keys))}"
    return text
