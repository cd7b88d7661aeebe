"""Pages that are made of the program itself, for mkdocs: every plugin from the registry, every task from its config."""

from __future__ import annotations

import enum
import inspect
import types
import typing
from pathlib import Path

from docstring_parser import DocstringStyle, parse
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from omegaconf import MISSING

from brushexp.app.command_line import prepare
from brushexp.registry import FAMILIES, MULTI_SELECT, Plugin, plugins

ROOT = Path(__file__).parents[2]
HEAD = "# @package _global_\n"  # first line of a config whose keys belong to the task


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages; mkdocs calls it."""
    prepare(ROOT)
    for name, text in (("plugins.md", plugins_page()), ("tasks.md", tasks_page())):
        files.append(File.generated(config, name, content=text))
    return files


def plugins_page() -> str:
    """Every plugin with its options, family by family."""
    parts = [
        "# Plugins",
        "Made from the registry when this site is built. Choose one with `family=name`, set its options with "
        "`family.option=value` (of a family of which several can be chosen: `family.name.option=value`). "
        "Yours is one file in `plugins/`: [tutorial](tutorial.md).",
    ]
    for family, meaning in FAMILIES.items():
        several = f" Several at once: `'{family}=[a,b]'`." if family in MULTI_SELECT else ""
        parts += [f"## {family}", f"*{_sentence(meaning)}*{several}"]
        parts += [_plugin(plugin) for plugin in plugins(family)]
        presets = sorted((ROOT / "conf" / family).glob("*.yaml"))
        if presets:
            rows = [f"| `{family}={path.stem}` | {_comment(path)} |" for path in presets]
            parts.append("\n".join(["Presets, in `conf/`:", "", "| preset | what it is |", "|---|---|", *rows]))
    return "\n\n".join(parts) + "\n"


def tasks_page() -> str:
    """Every task: what it does, and its keys with their defaults, as the config says them."""
    shared = (ROOT / "conf" / "config.yaml").read_text(encoding="utf-8")
    parts = [
        "# Tasks",
        "Made from `conf/task/` when this site is built. `python run.py task=name key=value ...`; "
        "`task=paint` is the default and need not be typed. Add `--help` for the same on the terminal.",
        "## Keys of every task",
        _yaml(shared.partition("\nhydra:")[0].partition("\n\n")[2]),
    ]
    names = [path.stem for path in sorted((ROOT / "conf" / "task").glob("*.yaml"))]
    for name in ["paint", *(name for name in names if name != "paint")]:
        text = (ROOT / "conf" / "task" / f"{name}.yaml").read_text(encoding="utf-8").removeprefix(HEAD)
        summary, _, keys = text.partition("\n")
        parts += [f"## {name}", summary.lstrip("# "), _yaml(keys)]
    return "\n\n".join(parts) + "\n"


def _plugin(plugin: Plugin) -> str:
    """Name, docstring and options of one plugin."""
    parsed = parse(inspect.getdoc(plugin.cls) or "", DocstringStyle.GOOGLE)
    said = {entry.arg_name: " ".join((entry.description or "").split()) for entry in parsed.params}
    parts = [f"### `{plugin.family}={plugin.name}`", parsed.description or ""]
    if plugin.facts:
        parts.append(" · ".join(f"{name}: *{value}*" for name, value in plugin.facts.items()))
    if ROOT / "plugins" in Path(inspect.getfile(plugin.cls)).parents:
        parts.append("*An example plugin, in `plugins/`.*")
    rows = []
    for parameter in inspect.signature(plugin.cls, eval_str=True).parameters.values():
        if parameter.kind is parameter.KEYWORD_ONLY:
            default = "must be given" if parameter.default is parameter.empty else f"`{_value(parameter.default)}`"
            about = said.get(parameter.name, "")
            rows.append(f"| `{parameter.name}` | {_type(parameter.annotation)} | {default} | {_cell(about)} |")
    if rows:
        parts.append("\n".join(["| option | type | default | |", "|---|---|---|---|", *rows]))
    return "\n\n".join(part for part in parts if part)


def _type(annotation: object) -> str:
    """A type as people read it."""
    origin, parts = typing.get_origin(annotation), typing.get_args(annotation)
    if origin in (types.UnionType, typing.Union):
        return " or ".join(_type(part) for part in parts)
    if annotation is type(None):
        return "null"
    if isinstance(annotation, type) and issubclass(annotation, enum.Enum):
        return ", ".join(f"`{member.name}`" for member in annotation)
    if origin is not None:
        return f"{getattr(origin, '__name__', origin)} of {', '.join(_type(part) for part in parts)}"
    name = getattr(annotation, "__name__", str(annotation))
    return {"str": "text", "bool": "true, false"}.get(name, name)


def _value(default: object) -> str:
    """A default as it would be typed."""
    if default is None or default == MISSING:
        return "null"
    if isinstance(default, bool):
        return str(default).lower()
    return default.name if isinstance(default, enum.Enum) else str(default)


def _comment(path: Path) -> str:
    """First comment of a preset."""
    return path.read_text(encoding="utf-8").removeprefix(HEAD).partition("\n")[0].lstrip("# ")


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _yaml(text: str) -> str:
    return f"```yaml\n{text.strip()}\n```"
