"""What installed packages publish, by entry points."""

from functools import cache
from importlib.metadata import EntryPoint, EntryPoints, entry_points


def published(group: str) -> dict[str, EntryPoint]:
    """Map the names of an entry-point group, ``brushexp.tasks``, to what they stand for; nothing is imported yet."""
    return {point.name: point for point in _installed().select(group=group)}


@cache
def _installed() -> EntryPoints:
    """Read the entry points of all installed distributions once: it takes some 50 ms."""
    return entry_points()  # type: ignore[return-value,unused-ignore]
