"""Register the plugins that ship with brushexp, the user's plugin files, and the plugins of installed packages."""

import importlib
import logging
import os
import pkgutil
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import ModuleType

from brushexp.errors import UserError
from brushexp.registry.families import CORE, FAMILIES, FOLDERS, SEARCH_PATH, USER_PACKAGE
from brushexp.registry.plugin import ENTRY_POINTS, Plugin, announce, import_or_explain, is_ours, withdraw
from brushexp.system.published import entry_points_of

log = logging.getLogger(__name__)
_broken: dict[str, str] = {}  # file of a user's plugins -> why it cannot be loaded


def load_plugins(directory: Path, *, warns: bool = True) -> list[str]:
    """Register the plugins of brushexp and of packages, import the user's files, and return those files' names.

    The user's files are ``directory/*.py`` and the files in the folders that ``BRUSHEXP_PLUGINS`` lists. A file that
    cannot be imported is skipped, with a warning if ``warns`` is set; `reasons_for_missing` gives the reasons again
    when a name is not found. Plugins of brushexp and of packages are imported when they are first needed.
    """
    for family in FAMILIES:
        _announce_core(family)
    for name, point in entry_points_of(ENTRY_POINTS).items():
        family, dot, member = name.partition(".")
        if not dot:
            raise UserError(f'entry point {name} of {ENTRY_POINTS} is not a member; write it as "loss.{name}" = ...')
        source = f"entry point {name} ({point.value})"
        announce(Plugin(family, member, point.module, source, point.load, is_ours(point.module)))
    return _import_files([*_plugin_files(directory)], warns)


def _announce_core(family: str) -> None:
    """Announce brushexp's own members of a family, one for each file in the family's folder."""
    package = importlib.import_module(f"{CORE}plugins.{FOLDERS[family]}")
    for module in pkgutil.iter_modules(package.__path__):
        if not module.name.startswith("_") and module.name != "base":
            path = f"{package.__name__}.{module.name}"
            announce(Plugin(family, module.name, path, path, partial(importlib.import_module, path), is_ours=True))


def _import_files(files: list[Path], warns: bool) -> list[str]:
    """Import the user's files, and return the names of those that could be imported."""
    package = sys.modules.setdefault(USER_PACKAGE, ModuleType(USER_PACKAGE, "Plugins of the user."))
    package.__path__ = sorted({str(path.parent) for path in files})  # workers import classes of configs from here
    importlib.invalidate_caches()
    _broken.clear()
    for path in files:
        module = f"{USER_PACKAGE}.{path.stem}"
        try:
            import_or_explain(partial(importlib.import_module, module), str(path))
        except UserError as error:
            withdraw(module)
            _broken[str(path)] = str(error)
            log.log(logging.WARNING if warns else logging.DEBUG, "%s; it is left out", error)
    return [path.stem for path in files if str(path) not in _broken]


def broken_files() -> dict[str, str]:
    """Return the user's files that could not be loaded, each mapped to the reason for the failure."""
    return dict(_broken)


def reasons_for_missing() -> str:
    """Return the reasons why user files failed to load, for messages about missing names, or "" if none failed."""
    return "".join(f". {reason}" for reason in _broken.values())


def _plugin_files(directory: Path) -> Iterator[Path]:
    """Yield the plugin files in a fixed order; raise a UserError for a missing folder or duplicate file names."""
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
