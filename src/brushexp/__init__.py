"""Paint pictures out of brush strokes by gradient descent, and study how well that works."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from brushexp.system.caches import settle_caches
from brushexp.system.runtime import keep_memory, let_threads_sleep

if TYPE_CHECKING:
    from brushexp.api.iteration import State, iterate
    from brushexp.api.loading import load
    from brushexp.api.painting import Painting, paint
    from brushexp.api.parts import create, list_plugins, render
    from brushexp.errors import UserError

__version__ = "0.2.0"  # the only place that states the version; pyproject.toml reads it

__all__ = ["Painting", "State", "UserError", "create", "iterate", "list_plugins", "load", "paint", "render"]
HOMES = {  # modules are loaded when one of these names is first used, because torch takes seconds to import
    "brushexp.api.painting": ("Painting", "paint"),
    "brushexp.api.parts": ("create", "list_plugins", "render"),
    "brushexp.api.iteration": ("State", "iterate"),
    "brushexp.api.loading": ("load",),
    "brushexp.errors": ("UserError",),
}
FUNCTIONS = "brushexp.functions"  # entry-point group of the functions that installed packages add

settle_caches()
let_threads_sleep()
keep_memory()


def __getattr__(name: str) -> Any:
    for module, names in HOMES.items():
        if name in names:
            return getattr(import_module(module), name)
    if not name.startswith("_") and (point := _published_functions().get(name)) is not None:
        return point.load()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, *_published_functions()]


def _published_functions() -> Any:
    """Return the entry points of the functions that installed packages publish, by function name."""
    from brushexp.system.published import entry_points_of  # noqa: PLC0415  (slow to import)

    return entry_points_of(FUNCTIONS)
