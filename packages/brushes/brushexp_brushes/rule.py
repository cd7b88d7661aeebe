"""What the keys that name brushes hold; nothing here is slow to import."""

from brushexp.bounds import Rule


def _check(path: str, option: str) -> None:
    from brushexp_brushes.marks import read_marks  # noqa: PLC0415  (it imports torch)

    read_marks([path])


BRUSH = Rule(_check)
