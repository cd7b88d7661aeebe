"""Find what installed packages publish as entry points."""

from functools import cache
from importlib.metadata import EntryPoint, EntryPoints, entry_points

CATALOGUES = "brushexp.catalogues"  # entry-point group: file extension -> function that reads a catalogue from bytes


def published(group: str) -> dict[str, EntryPoint]:
    """Map the names of an entry-point group such as ``brushexp.tasks`` to their entry points, importing nothing."""
    return {point.name: point for point in _installed().select(group=group)}


def catalogue_suffixes() -> tuple[str, ...]:
    """List the extensions of catalogue files, ``.h5`` first, including those of packages."""
    return ".h5", ".json", *(f".{name}" for name in published(CATALOGUES))


@cache
def _installed() -> EntryPoints:
    """Read the entry points of all installed distributions; cached, because it takes 50 ms."""
    return entry_points()  # type: ignore[return-value,unused-ignore]
