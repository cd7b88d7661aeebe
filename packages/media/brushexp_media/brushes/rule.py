"""Validate keys that name brushes, without slow imports."""

from brushexp.contracts import Rule, UserError


def _check(path: str, option: str) -> None:
    from brushexp_media.brushes.marks import read_marks  # noqa: PLC0415  (it imports torch)

    try:
        read_marks([path])
    except UserError as error:
        raise UserError(f"{option}: {error}") from error


BRUSH = Rule(_check)
