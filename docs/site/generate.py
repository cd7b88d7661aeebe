"""Generate pages for mkdocs from the program itself: plugins from the registry, and tasks from their schemas."""

from __future__ import annotations

import enum
import inspect
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from textwrap import shorten
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from omegaconf import MISSING

from brushexp import contracts
from brushexp.bounds import Bounds, Rule
from brushexp.config.compose import presets_of
from brushexp.config.keys import Key, groups_of, keys_of
from brushexp.config.publish import prepare
from brushexp.config.schema import Task
from brushexp.config.tasks import TASKS
from brushexp.config.words import as_typed
from brushexp.registry import FAMILIES, MULTI_SELECT, Plugin, plugins
from brushexp.registry.options import options_of, plain_type
from brushexp.system.words import SHIPPED

ROOT = Path(__file__).parents[2]
WORDS = {int: "whole number", float: "number", bool: "true or false", str: "text"}


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add the pages of all plugin families and decisions to the navigation (mkdocs hook)."""
    parts = {name: pages for part in config.nav or [] for name, pages in part.items()}
    decisions = sorted((ROOT / "docs" / "decisions").glob("[0-9]*.md"))
    _chapter(parts["Reference"], "Plugins").extend({family: f"plugins/{family}.md"} for family in FAMILIES)
    _chapter(parts["Development"], "Decisions").extend(
        {path.stem[4:].replace("-", " "): f"decisions/{path.name}"} for path in decisions
    )
    return config


def _chapter(part: list[dict[str, Any]], name: str) -> list[dict[str, str]]:
    """Return the pages of the chapter ``name`` in one part of the site."""
    return next(chapter[name] for chapter in part if name in chapter)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages to the site (mkdocs hook)."""
    prepare(ROOT)
    pages = {"plugins.md": families_page(), "tasks.md": tasks_page(), "contracts.md": contracts_page()}
    pages |= {f"plugins/{family}.md": family_page(family) for family in FAMILIES}
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


def families_page() -> str:
    """Generate the page that lists all families, with one line per plugin."""
    parts = [
        "# Plugins",
        "Made from the registry when this site is built. Choose one with `family=name`, set its options with "
        "`family.option=value` (of a family of which several can be chosen: `family.name.option=value`). "
        "Yours is one file in `plugins/`: [tutorial](tutorial.md).",
    ]
    for family, meaning in FAMILIES.items():
        rows = [f"| [`{plugin.name}`](plugins/{family}.md) | {_cell(plugin.summary)} |" for plugin in plugins(family)]
        table = "\n".join([f"| `{family}=` | |", "|---|---|", *rows])
        parts += [f"## [{family}](plugins/{family}.md)", _sentence(meaning), table]
    return "\n\n".join(parts) + "\n"


def family_page(family: str) -> str:
    """Generate the page of a family: its plugins with their options, and its presets."""
    several = f" Several at once: `'{family}=[a,b]'`." if family in MULTI_SELECT else ""
    parts = [f"# {family}", f"*{_sentence(FAMILIES[family])}*{several}", *map(_plugin, plugins(family))]
    presets = sorted(presets_of(SHIPPED / family).items())
    if presets:
        rows = [f"| `{family}={name}` | {_cell(comment)} |" for name, comment in presets]
        parts.append("\n".join(["## Presets", "", "| preset | what it is |", "|---|---|", *rows]))
    return "\n\n".join(parts) + "\n"


def tasks_page() -> str:
    """Generate the page of tasks: what each task does, its keys with types and defaults, and its plugin families."""
    parts = [
        "# Tasks",
        "Made from the schemas of the tasks when this site is built. `brushexp task=name key=value ...`; "
        "`task=paint` is the default and need not be typed. Add `--help` for the same on the terminal.",
        "## Keys of every task",
        _keys(keys_of(Task)),
    ]
    for name, schema in TASKS.items():
        own = {key: value for key, value in keys_of(schema).items() if key not in keys_of(Task)}
        families = ", ".join(f"`{group}`" for group in groups_of(schema))
        parts += [f"## {name}", inspect.getdoc(schema) or "", _keys(own)]
        parts += [f"Chosen with `family=name`: {families}."] if families else []
    return "\n\n".join(parts) + "\n"


def contracts_page() -> str:
    """Generate the page that lists, module by module, what plugins and packages may import."""
    modules = [
        contracts,
        *(import_module(found.name) for found in iter_modules(contracts.__path__, f"{contracts.__name__}.")),
    ]
    parts = ["# Contracts", "Made from `brushexp.contracts` when this site is built.", inspect.getdoc(contracts) or ""]
    for module in modules:
        rows = [f"| `{name}` | {_cell(_about(getattr(module, name)))} |" for name in module.__all__]
        about = "" if module is contracts else inspect.getdoc(module) or ""
        parts += [f"## {module.__name__}", about, "\n".join(["| name | |", "|---|---|", *rows])]
    return "\n\n".join(part for part in parts if part) + "\n"


def _about(thing: object) -> str:
    """Return the first line of an object's docstring, or the value of a constant."""
    if inspect.isroutine(thing) or inspect.isclass(thing) or inspect.ismodule(thing):
        return (inspect.getdoc(thing) or "").partition("\n")[0]
    return f"`{shorten(str(thing), 60)}`"


def _keys(keys: dict[str, Key]) -> str:
    """Format keys as a Markdown table."""
    rows = [
        f"| `{key.name}` | {_kind(key.annotation, key.bounds)} | `{as_typed(key.default)}` | {_cell(key.meaning)} |"
        for key in keys.values()
    ]
    return "\n".join(["| key | type | default | |", "|---|---|---|---|", *rows])


def _plugin(plugin: Plugin) -> str:
    """Format the name, docstring and options of one plugin."""
    parts = [
        f"## `{plugin.family}={plugin.name}`",
        (inspect.getdoc(plugin.cls) or "").partition("\nArgs:\n")[0].strip(),
    ]
    if plugin.facts:
        parts.append(" · ".join(f"{name}: *{value}*" for name, value in plugin.facts.items()))
    if ROOT / "plugins" in Path(inspect.getfile(plugin.cls)).parents:
        parts.append("*An example plugin, in `plugins/`.*")
    rows = []
    for name, annotation, value in options_of(plugin.cls):
        default = "must be given" if value == MISSING else f"`{as_typed(value)}`"
        kind = _kind(plain_type(annotation), plugin.bounds.get(name))
        rows.append(f"| `{name}` | {_cell(kind)} | {default} | {_cell(plugin.meanings[name])} |")
    if rows:
        parts.append("\n".join(["| option | type | default | |", "|---|---|---|---|", *rows]))
    return "\n\n".join(part for part in parts if part)


def _kind(annotation: Any, bounds: Bounds | Rule | None = None) -> str:
    """Describe a type and its bounds in words."""
    if isinstance(bounds, Bounds):
        return str(bounds) if bounds.names else f"{_kind(annotation)}, {bounds}"
    if get_origin(annotation) in (UnionType, Union):
        return " or ".join(_kind(part) for part in get_args(annotation) if part is not NoneType) + " or null"
    if get_origin(annotation) is list:
        return f"list of {_kind(get_args(annotation)[0])}"
    if isinstance(annotation, type) and issubclass(annotation, enum.Enum):
        return f"one of {', '.join(annotation.__members__)}"
    return WORDS.get(annotation, getattr(annotation, "__name__", str(annotation)))


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
