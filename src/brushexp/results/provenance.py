"""Summarise in one line how runs differ in versions, commits, machines and plugin files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from brushexp.system.reading import shorten_value

if TYPE_CHECKING:
    from pandas import DataFrame

COMMIT_LETTERS = 7  # number of displayed characters of a commit
SHOWN = {  # part of a provenance -> its name, and the number of displayed characters of its values (None for all)
    ("brushexp", "version"): ("brushexp", None),
    ("brushexp", "commit"): ("commit of brushexp", COMMIT_LETTERS),
    ("brushexp", "changes"): ("uncommitted changes of brushexp", 0),
    ("project", "commit"): ("commit of the project", COMMIT_LETTERS),
    ("project", "changes"): ("uncommitted changes of the project", 0),
    ("python",): ("Python", None),
    ("torch",): ("PyTorch", None),
    ("numba",): ("Numba", None),
    ("processor",): ("processor", None),
    ("gpu",): ("GPU", None),
}


def remark_on_provenance(frame: DataFrame) -> str:
    """Describe how the runs in a frame differ in provenance; return "" if they do not, or if there are no records.

    A plugin file counts as a difference if two runs use different versions of it.
    """
    records = [one if isinstance(one, dict) else None for one in frame["run", "provenance"]]
    known = [one for one in records if one is not None]
    if not known:
        return ""
    parts = differing_parts(known)
    remarks = [f"These runs differ in {'; '.join(parts)}."] if parts else []
    if silent := len(records) - len(known):
        remarks.append(f"{silent} of {len(records)} runs have no record of their versions.")
    return " ".join(remarks)


def differing_parts(records: Sequence[Mapping[str, Any]]) -> list[str]:
    """List the parts in which provenance records differ, with their values: ``PyTorch (2.8.0, 2.9.0)``."""
    parts = [_difference([_at(one, path) for one in records], *shown) for path, shown in SHOWN.items()]
    return [*filter(None, parts)] + [f"plugin file {name}" for name in _changed_plugins(records)]


def _difference(values: Sequence[object], name: str, letters: int | None) -> str:
    """Return a component's name and values if the values differ, otherwise ""; ``letters`` = 0 omits the values."""
    texts = list(dict.fromkeys("none" if value is None else shorten_value(value)[:letters] for value in values))
    if len(set(map(str, values))) < 2:
        return ""
    return name if letters == 0 else f"{name} ({', '.join(texts)})"


def _at(record: Mapping[str, Any], path: Sequence[str]) -> object:
    value: Any = record
    for key in path:
        value = value.get(key) if isinstance(value, dict) else None
    return value


def _changed_plugins(records: Sequence[Mapping[str, Any]]) -> list[str]:
    """List the plugin files that differ between runs."""
    digests: dict[str, set[str]] = {}
    for record in records:
        plugins = record.get("plugins")
        for name, digest in plugins.items() if isinstance(plugins, dict) else ():
            digests.setdefault(shorten_value(name), set()).add(str(digest))
    return [name for name, versions in digests.items() if len(versions) > 1]
