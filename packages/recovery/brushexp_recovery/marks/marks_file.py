"""Read JSON files of marks: strokes drawn over a picture by a person, and recovered strokes left unchanged."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts import UserError
from brushexp.contracts.files import check_format_version, explaining, json_of, read_text

Array = NDArray[Any]

MARKS_FORMAT, MARKS_VERSION = "brushexp marks", 1
MARKS_SUFFIX = ".json"
CURE = 'give marks as the page of strokes saves them: {"strokes": [{"points": [[x, y], ...], "width": 12}]}'
LARGEST_FILE = 2**27  # bytes
LARGEST_PLACE = 1e6  # largest coordinate in pixels; no picture is wider


@dataclass(frozen=True)
class Mark:
    """A stroke drawn by a person, or recovered and left unchanged, in pixels (x to the right, y down)."""

    name: str
    points: Array  # (P, 2) points along the middle
    width: Array  # (P,) width at each point
    outlines: tuple[Array, ...] = ()  # (Q, 2) each; they enclose the region; without them, it is the line
    by: Literal["hand", "recovery"] = "hand"


@dataclass(frozen=True)
class Marks:
    """The marks of one picture."""

    strokes: list[Mark]
    deleted: list[Mark]  # recovered strokes that the person has deleted
    size: tuple[int, int] | None  # height and width of the picture, if stated in the file
    image: Path | None  # picture, if the file names one that exists
    complete: bool | tuple[float, float, float, float]  # part with all strokes marked: left, top, width, height


def is_marks(path: Path) -> bool:
    """Check whether a JSON file contains marks rather than a catalogue."""
    if path.suffix.lower() != MARKS_SUFFIX or not path.is_file():
        return False
    values = _values_of(path)
    strokes = values.get("strokes")
    if not isinstance(strokes, list):
        return False
    return values.get("format") == MARKS_FORMAT or any("points" in one for one in strokes if isinstance(one, dict))


def read_marks(path: Path) -> Marks:
    """Read marks from a file; raise a UserError that describes any fault."""
    values = _values_of(path)
    with explaining(path, CURE):
        check_format_version(values.get("version", MARKS_VERSION), MARKS_VERSION)
        parts = values.get("strokes"), values.get("deleted", [])
        if not all(isinstance(part, list) for part in parts):
            raise UserError(f"strokes and deleted must be lists; {CURE}")
        strokes, deleted = (
            [_mark_from(one, f"{word} {number}") for number, one in enumerate(part, start=1)]
            for part, word in zip(parts, ("stroke", "deleted stroke"), strict=True)
        )
        size = None if values.get("size") is None else _size_from(values["size"])
        complete = _complete_from(values.get("complete", False))
    image = path.parent / values["image"] if isinstance(values.get("image"), str) else None
    return Marks(strokes, deleted, size, image if image is not None and image.is_file() else None, complete)


def _values_of(path: Path) -> dict[str, Any]:
    """Read a JSON file as a mapping; return an empty mapping if it contains anything else."""
    text = read_text(path, CURE, LARGEST_FILE)
    with explaining(path, CURE):
        values = json_of(text)
    return values if isinstance(values, dict) else {}


def _mark_from(values: Any, place: str) -> Mark:
    """Convert the JSON values of one mark; error messages name the mark by ``place``."""
    if not isinstance(values, dict):
        raise UserError(f"{place} is {type(values).__name__}, not a stroke with points and width")
    name = str(values.get("name", place))
    points = _places_from(values.get("points"), f"points of {name}", 1)
    width = np.atleast_1d(_numbers_from(values.get("width"), f"width of {name}"))
    if width.ndim != 1 or len(width) not in (1, len(points)) or not (width > 0).all():
        raise UserError(f"width of {name} must be one number above 0, or one for each of its {len(points)} points")
    outlines = values.get("outlines", [])
    if not isinstance(outlines, list):
        raise UserError(f"outlines of {name} must be a list")
    return Mark(
        name,
        points,
        np.broadcast_to(width, len(points)),
        tuple(_places_from(outline, f"outlines of {name}", 3) for outline in outlines),
        "recovery" if values.get("by") == "recovery" else "hand",
    )


def _places_from(values: Any, what: str, least: int) -> Array:
    """Convert JSON values to points (P, 2); there must be at least ``least`` of them."""
    places = _numbers_from(values, what)
    if places.ndim != 2 or places.shape[1] != 2 or len(places) < least:
        raise UserError(f"{what} must be at least {least} pairs [x, y]")
    return places


def _numbers_from(values: Any, what: str) -> Array:
    """Convert JSON values to an array of finite numbers."""
    try:
        numbers = np.array(values, float)
    except (TypeError, ValueError):
        raise UserError(f"{what} must be numbers") from None
    if not (np.isfinite(numbers) & (np.abs(numbers) <= LARGEST_PLACE)).all():
        raise UserError(f"{what} must be finite and within {LARGEST_PLACE:.0f} pixels")
    return numbers


def _size_from(values: Any) -> tuple[int, int]:
    """Convert a width and a height to (height, width)."""
    size = _numbers_from(values, "size")
    if size.shape != (2,) or not (size >= 1).all():
        raise UserError("size must be the width and the height of the picture in pixels")
    return int(size[1]), int(size[0])


def _complete_from(values: Any) -> bool | tuple[float, float, float, float]:
    """Convert the area in which all strokes are marked: True for the whole picture, False for none, or a rectangle."""
    if isinstance(values, bool):
        return values
    rectangle = _numbers_from(values, "complete")
    if rectangle.shape != (4,):
        raise UserError("complete must be true, false or [left, top, width, height]")
    left, top, width, height = rectangle.tolist()
    return left, top, width, height
