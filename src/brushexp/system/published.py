"""Find the entry points that installed packages publish."""

from functools import cache
from importlib.metadata import EntryPoint, EntryPoints, entry_points

CATALOGUES = "brushexp.catalogues"  # entry-point group: file extension -> function that reads a catalogue from bytes


def entry_points_of(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group, such as ``brushexp.tasks``, by name, without importing them."""
    return {point.name: point for point in _all_entry_points().select(group=group)}


def catalogue_suffixes() -> tuple[str, ...]:
    """List the extensions of catalogue files, ``.h5`` first, including extensions from installed packages."""
    return ".h5", ".json", *(f".{name}" for name in entry_points_of(CATALOGUES))


@cache
def _all_entry_points() -> EntryPoints:
    """Read the entry points of all installed distributions; cached, because reading takes 50 ms."""
    return entry_points()  # type: ignore[return-value,unused-ignore]
