"""Import the plugins that ship, those in folders, and those that packages publish."""

import importlib
import os
import pkgutil
import sys
from collections.abc import Callable, Iterator
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from brushexp.errors import UserError
from brushexp.plugin_errors import OURS
from brushexp.registry import FAMILIES, PACKAGES, SEARCH_PATH

USER_PACKAGE = "brushexp_plugins"  # the import name of all files found in plugin folders
ENTRY_POINTS = "brushexp.plugins"  # entry-point group of published plugins


def load_plugins(directory: Path) -> list[str]:
    """Import the built-in families, ``directory/*.py``, the folders in ``BRUSHEXP_PLUGINS`` and the entry points.

    If any of them fails to import, a UserError names the file and the line.
    """
    for family in FAMILIES:
        members = importlib.import_module(f"{OURS}plugins.{PACKAGES[family]}")
        for module in pkgutil.iter_modules(members.__path__, f"{members.__name__}."):
            if not module.name.rpartition(".")[2].startswith("_"):
                importlib.import_module(module.name)
    files = list(_plugin_files(directory))
    package = sys.modules.setdefault(USER_PACKAGE, ModuleType(USER_PACKAGE, "Plugins of the user."))
    package.__path__ = sorted({str(path.parent) for path in files})  # workers import the classes of configs from there
    importlib.invalidate_caches()
    for path in files:
        import_or_explain(partial(importlib.import_module, f"{USER_PACKAGE}.{path.stem}"), str(path))
    for point in entry_points(group=ENTRY_POINTS):
        import_or_explain(point.load, f"entry point {point.name} ({point.value})")
    return [path.stem for path in files]


def _plugin_files(directory: Path) -> Iterator[Path]:
    """List the plugin files in a fixed order; refuse two files of one name."""
    extra = [Path(part) for part in os.environ.get(SEARCH_PATH, "").split(os.pathsep) if part]
    for folder in extra:
        if not folder.is_dir():
            raise UserError(f"{SEARCH_PATH} names {folder}, which is not a folder; correct or unset it")
    paths: dict[str, Path] = {}
    for folder in dict.fromkeys(path.resolve() for path in [directory, *extra]):
        for path in sorted(folder.glob("*.py")):
            if path.stem.startswith("_"):
                continue
            if path.stem in paths:
                raise UserError(f"plugin files {paths[path.stem]} and {path} have the same name; rename one")
            paths[path.stem] = path
            yield path


def import_or_explain(load: Callable[[], Any], source: str) -> Any:
    """Load a plugin; a UserError says which ``source`` cannot be loaded, and why."""
    try:
        return load()
    except UserError as error:
        raise UserError(f"plugin {source}: {error}") from error
    except SyntaxError as error:
        raise UserError(f"plugin {source}, line {error.lineno}: {error.msg}; correct it or move it away") from error
    except (Exception, SystemExit) as error:
        reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise UserError(f"plugin {source} cannot be loaded: {reason}; correct it or move it away") from error
