"""``brushexp.list_plugins`` and ``brushexp.create``: what can be chosen, and one of it built."""

from __future__ import annotations

from typing import Any

from brushexp.api.settings import load
from brushexp.errors import UserError
from brushexp.registry import FAMILIES, build_named, plugins


def list_plugins(family: str | None = None) -> dict[str, dict[str, str]]:
    """Family -> name -> what the plugin is, in one line; of one family or of all, those of the current folder too.

    >>> list(list_plugins("order")["order"])
    ['accuracy', 'area', 'fixed']
    """
    load()
    if family not in (None, *FAMILIES):
        raise UserError(f"there is no family {family}; choose one of {', '.join(FAMILIES)}")
    families = FAMILIES if family is None else [family]
    return {name: {plugin.name: plugin.summary for plugin in plugins(name)} for name in families}


def create(family: str, name: str, **options: Any) -> Any:
    """Build one plugin with options as its keys have them: a loss, a renderer, an exporter.

    Raises:
        UserError: which option does not fit, or what there is to choose.

    >>> create("loss", "mse", weight=2.0).weight
    2.0
    """
    list_plugins(family)
    return build_named(family, name, options)
