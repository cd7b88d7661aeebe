"""What installed packages publish, by entry points."""

from functools import cache
from importlib.metadata import EntryPoint, EntryPoints, entry_points

CATALOGUES = "brushexp.catalogues"  # entry points: ending of a file -> function that reads a catalogue from its bytes


def published(group: str) -> dict[str, EntryPoint]:
    """Map the names of an entry-point group, ``brushexp.tasks``, to what they stand for; nothing is imported yet."""
    return {point.name: point for point in _installed().select(group=group)}


def catalogue_suffixes() -> tuple[str, ...]:
    """List the endings of files of strokes, ``.h5`` first: shipped ones and those of packages."""
    return ".h5", ".json", *(f".{name}" for name in published(CATALOGUES))


@cache
def _installed() -> EntryPoints:
    """Read the entry points of all installed distributions once: it takes some 50 ms."""
    return entry_points()  # type: ignore[return-value,unused-ignore]
