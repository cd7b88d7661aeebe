"""Every recovered stroke as a row of figures, and the outline of where it is seen."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp.strokes import measures as ruler
from brushexp.strokes.bezier import curve_of
from brushexp_recovery.measure import table_of
from brushexp_recovery.raster.labels import count_pixels

Array = NDArray[Any]

SIMPLE = 0.45  # pixels by which an outline may be simplified
NARROW = 6.0  # pixels: width below which strokes are hard to find
FEW = 0.3  # share of a photograph that strokes cover, below which little is said of the whole
POINTS = {"length": 1, "width": 1, "area": 2}  # powers of pixels in columns that have millimetres too


@dataclass(frozen=True)
class Rows:
    """N strokes of a photograph, bottom to top."""

    columns: dict[str, Array]  # (N,) each: see `rows_of`
    color: Array  # (N, 3) sRGB in [0, 1]
    outlines: list[Array]  # (P, 2) places x, y of each, pixels
    size: tuple[int, int]  # height and width of the photograph
    mm: float | None  # millimetres of a pixel

    def __len__(self) -> int:
        return len(self.color)


def rows_of(found: Any, mm: float | None = None) -> Rows:
    """Measure what was recovered from a photograph.

    Columns: ``stroke`` its number in the catalogue and in the labels, ``order`` 0 for the bottom one, ``confidence``
    0 to 1, ``x`` and ``y`` of the middle, pixels from the left and the top, ``length`` (of the curve, without round
    ends), ``width``, ``area`` in pixels, ``elongatedness``, ``straightness``, ``curvature`` and ``direction`` in
    degrees, 0 to 180, clockwise from level: 45 falls to the right; ``seen``, its pixels that are seen.
    """
    saved, labels = found.saved, np.asarray(found.labels)
    up = saved.depth.argsort()
    strokes = saved.strokes[up]
    curve = curve_of(strokes).double()
    table = table_of(curve, (strokes.width * strokes.scale).double().numpy())
    centre, number = ruler.centre_of(curve).numpy(), up.numpy()
    confidence, seen = np.asarray(found.confidence, float)[number], count_pixels(labels, len(number))[number]
    columns = {"stroke": number, "order": np.arange(len(number)), "confidence": confidence}
    columns |= {"x": centre[:, 0], "y": centre[:, 1], **table, "seen": seen}
    outlines = outlines_of(labels, curve)
    return Rows(columns, strokes.color.numpy(), [outlines[k] for k in number], labels.shape, mm)


def remark_on(rows: Rows) -> str | None:
    """Say what is doubtful about recovered strokes and what to do about it; None if they are many and wide enough."""
    if len(rows) == 0:
        return (
            "no strokes were found: the photograph may be too small, blurred, or of no painting; give a sharper or "
            "larger one in which strokes are 6 pixels wide or wider"
        )
    if (width := float(np.median(rows.columns["width"]))) < NARROW:
        return (
            f"half of the strokes found are narrower than {width:.1f} pixels: they may be canvas or grain, and finer "
            "ones are missed; give a larger photograph, or scale=1 to look at it as it is"
        )
    covered = float(rows.columns["seen"].sum()) / (rows.size[0] * rows.size[1])
    if covered < FEW:
        return (
            f"strokes were found on {100 * covered:.0f} % of the photograph only: the rest could not be read, so "
            "figures speak of those found, not of the whole painting; look at strokes.html"
        )
    return None


def outlines_of(labels: Array, curve: torch.Tensor) -> list[Array]:
    """Trace the largest visible part (P, 2) of each of N strokes; that of one that is not seen has no points."""
    from scipy.ndimage import find_objects  # noqa: PLC0415  (slow to import)
    from skimage.measure import approximate_polygon, find_contours  # noqa: PLC0415

    boxes = find_objects(labels + 1, max_label=len(curve))
    outlines = []
    for number, box in enumerate(boxes):
        if box is None:
            outlines.append(np.empty((0, 2)))
            continue
        mask = np.pad(labels[box] == number, 1).astype(float)
        longest = max(find_contours(mask, 0.5), key=len)
        corner = np.array([box[1].start, box[0].start]) - 0.5  # of pixel centres, less the padding
        outlines.append(approximate_polygon(longest, SIMPLE)[:, ::-1] + corner)
    return outlines


def table_with_units(rows: Rows) -> dict[str, Array]:
    """Name columns with their units; lengths, widths and areas in millimetres too, if there is a scale."""
    units = {"x": "px", "y": "px", "length": "px", "width": "px", "area": "px^2", "curvature": "deg", "seen": "px"}
    table = {}
    for name, column in rows.columns.items():
        unit = "deg clockwise" if name == "direction" else units.get(name)
        table[f"{name} [{unit}]" if unit else name] = column
        if rows.mm is not None and name in POINTS:
            table[f"{name} [{units[name].replace('px', 'mm')}]"] = column * rows.mm ** POINTS[name]
    for k, channel in enumerate(("red", "green", "blue")):
        table[channel] = rows.color[:, k]
    return table
