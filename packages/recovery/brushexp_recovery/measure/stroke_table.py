"""Tabulate recovered strokes with their measures and the outlines of their visible parts."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.strokes import curve_of
from brushexp.contracts.strokes import measures as ruler
from brushexp_recovery.curves.bezier import points_on
from brushexp_recovery.measure.contours import outlines_of
from brushexp_recovery.measure.measures import measure_strokes
from brushexp_recovery.raster.labels import count_pixels

Array = NDArray[Any]

NARROW = 6.0  # width in pixels below which strokes are hard to find
LEAST_COVERED = 0.3  # share of a photograph below which strokes say little about the whole
# A picture does not look like paint if its median confidence is below HARDLY, below UNSURE with more than SOME_GROUND
# of it bare, or below SURE with more than MOST_GROUND of it bare.
HARDLY, UNSURE, SURE = 0.1, 0.2, 0.5
SOME_GROUND, MOST_GROUND = 0.15, 0.6
UNITS = {
    "x": "px",
    "y": "px",
    "length": "px",
    "width": "px",
    "area": "px^2",
    "curvature": "deg",
    "direction": "deg clockwise",
    "seen": "px",
}
PIXEL_POWERS = {"length": 1, "width": 1, "area": 2}  # powers of the columns that are also given in millimetres
LINE_POINTS = 7  # number of points that represent the curve of a stroke
COLORS = ("red", "green", "blue")


@dataclass(frozen=True)
class StrokeTable:
    """N strokes recovered from a photograph, bottom to top."""

    columns: dict[str, Array]  # (N,) each; see `tabulate_strokes`
    color: Array  # (N, 3) sRGB in [0, 1]
    lines: Array  # (N, LINE_POINTS, 2) places x, y along the middle of each stroke, in pixels
    outlines: list[Array]  # (P, 2) places x, y of each stroke, in pixels
    size: tuple[int, int]  # height and width of the photograph
    mm: float | None  # millimetres per pixel
    ground: float | None = None  # share of the photograph that looks like bare ground; None if unknown

    def __len__(self) -> int:
        return len(self.color)


def tabulate_strokes(recovered: Any, mm: float | None = None) -> StrokeTable:
    """Measure the strokes recovered from a photograph.

    Columns: ``stroke``, the stroke's number in the catalogue and in the labels; ``order``, 0 for the bottom stroke;
    ``confidence``, 0 to 1; ``x`` and ``y`` of the middle, in pixels from the left and the top; ``length`` from tip to
    tip, ``width`` and ``area`` in pixels; ``elongatedness`` (length / width); ``straightness``; ``curvature``;
    ``direction`` in degrees, 0 to 180, clockwise from horizontal, so that a stroke at 45 descends to the right;
    ``seen``, the number of visible pixels.
    """
    saved, labels = recovered.saved, np.asarray(recovered.labels)
    bottom_up = saved.depth.argsort()
    strokes = saved.strokes[bottom_up]
    curve = curve_of(strokes).double()
    centre, number = ruler.centre_of(curve).numpy(), bottom_up.numpy()
    columns = {
        "stroke": number,
        "order": np.arange(len(number)),
        "confidence": np.asarray(recovered.confidence, float)[number],
        "x": centre[:, 0],
        "y": centre[:, 1],
        **measure_strokes(curve, (strokes.width * strokes.scale).double().numpy()),
        "seen": count_pixels(labels, len(number))[number],
    }
    outlines = outlines_of(labels, len(number))
    return StrokeTable(
        columns=columns,
        color=strokes.color.numpy(),
        lines=points_on(curve.numpy(), LINE_POINTS),
        outlines=[outlines[k] for k in number],
        size=labels.shape,
        mm=mm,
        ground=None if recovered.ground is None else float(recovered.ground.mean()),
    )


def covered_share(table: StrokeTable) -> float:
    """Compute the fraction of the photograph that strokes cover."""
    return float(table.columns["seen"].sum()) / (table.size[0] * table.size[1])


def describe_rest(table: StrokeTable) -> str:
    """Describe the part of the photograph in which no strokes were found."""
    if table.ground is None:
        return "the rest is bare ground, or paint in which no stroke can be told apart"
    unread = max(1 - covered_share(table) - table.ground, 0)
    return (
        f"{100 * table.ground:.0f} % looks like bare ground, and {100 * unread:.0f} % like paint in which no stroke "
        "can be told apart"
    )


def doubt_of_paint(table: StrokeTable) -> str | None:
    """Explain why a picture does not look like paint, or return None if it does."""
    median, ground = float(np.median(table.columns["confidence"])) if len(table) else 0.0, table.ground or 0.0
    if len(table) == 0:
        reason = "no strokes were found"
    elif median < HARDLY or (median < UNSURE and ground > SOME_GROUND):
        reason = f"half of the strokes found have a confidence of {median:.2f} or less"
    elif median < SURE and ground > MOST_GROUND:
        reason = f"{100 * ground:.0f} % of it looks bare"
    else:
        return None
    return f"this does not look like paint: {reason}"


def remark_on(table: StrokeTable) -> str | None:
    """Explain why recovered strokes may be misleading and what to do about it, or return None if nothing is amiss."""
    if (doubt := doubt_of_paint(table)) is not None:
        return (
            f"{doubt}; if it is a painting, give a sharper or larger photograph, in which strokes are at least 6 "
            "pixels wide"
        )
    if (width := float(np.median(table.columns["width"]))) < NARROW:
        return (
            f"half of the strokes found are narrower than {width:.1f} pixels: they may be canvas or grain, and finer "
            "ones are missed; give a larger photograph, or type scale=1 to keep its size"
        )
    if (covered := covered_share(table)) < LEAST_COVERED:
        return (
            f"strokes were found on only {100 * covered:.0f} % of the photograph: {describe_rest(table)}; figures "
            "describe the strokes found, so compare them with the photograph in strokes.html"
        )
    return None


def columns_with_units(table: StrokeTable) -> dict[str, Array]:
    """Append units to column names; add lengths, widths and areas in millimetres if the scale is known."""
    named = {}
    for name, column in table.columns.items():
        unit = UNITS.get(name)
        named[f"{name} [{unit}]" if unit else name] = column
        if table.mm is not None and name in PIXEL_POWERS:
            named[f"{name} [{UNITS[name].replace('px', 'mm')}]"] = column * table.mm ** PIXEL_POWERS[name]
    return named | dict(zip(COLORS, table.color.T, strict=True))
