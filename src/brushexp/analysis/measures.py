"""What art historians measure of a brushstroke, for every stroke of a catalogue.

The vocabulary is that of Li, Yao, Hendriks and Wang, "Rhythmic brushstrokes distinguish van Gogh from his
contemporaries" (IEEE TPAMI 34(6), 2012). They measure regions of pixels that were cut out of scans, with their
skeletons and outlines; a stroke of ours is a curve with one thickness, so that most of it is exact. ``MEASURES`` has a
line for each measure; where we differ:

- straightness is chord over arc length. Theirs, the correlation of x and y along the skeleton, depends on how the
  canvas lies: it is not defined for a horizontal stroke.
- curvature is new: how far a stroke turns.
- homogeneity of breadth compares a stroke with those around it. Theirs compares the breadth along one stroke, which is
  constant here.
- what is around a stroke reaches ``RADIUS`` pitches, not 200 pixels, so that paintings of different sizes compare; the
  pitch is sqrt(pixels of the canvas / strokes). Near the edge of the canvas there are fewer neighbours, as there.
- elongatedness, number of neighbours and number of aligned neighbours are theirs; what counts as aligned is ``ALIKE``.
- visible is new: their strokes were seen to begin with.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from brushexp.analysis.surroundings import surroundings_of
from brushexp.analysis.visible import visible_share
from brushexp.strokes.bezier import curve_of, half_width_of, length_of, point_at
from brushexp.strokes.brushwork import pitch_of
from brushexp.strokes.catalogue import Strokes

Array = NDArray[np.float64]

RADIUS = 4.0  # pitches: of the neighbourhood; some 50 strokes
ALIKE = math.radians(20)  # directions that differ by less are alike
PARTS = 16  # pieces of a curve: so many places are looked at, and hairpins are measured to a thousandth
SHORTEST = 1e-6  # pixels: what is shorter is a dot, without a direction


@dataclass(frozen=True)
class Measure:
    """How one measure is shown.

    Attributes:
        name: in words.
        meaning: its definition.
        unit: in which it is shown; "" for a share or a number. Angles are kept in radians.
        power: of pixels in it: 1 for a length, 2 for an area.
        axial: whether it is a direction, which comes round after half a turn.
    """

    name: str
    meaning: str
    unit: str = ""
    power: int = 0
    axial: bool = False


MEASURES = {
    "length": Measure("length", "arc length of the curve, without the round ends", "px", 1),
    "width": Measure("width", "full thickness (Li et al.: broadness)", "px", 1),
    "area": Measure("area", "length x width + pi/4 width^2, hidden parts and those beyond the canvas too", "px^2", 2),
    "elongatedness": Measure("elongatedness", "length / width"),
    "straightness": Measure("straightness", "distance of the ends / length; 1 is straight"),
    "curvature": Measure("curvature", "how far the stroke turns from end to end; a half circle turns by 180°", "°"),
    "orientation": Measure(
        "orientation", "principal axis of the curve; 0° lies level, 45° falls to the right", "°", axial=True
    ),
    "visible": Measure("visible share", "of the stroke's paint on the canvas, what no later stroke hides"),
    "neighbours": Measure("neighbours", "strokes whose centres are within the radius"),
    "aligned": Measure("aligned neighbours", f"of these, those that differ by {math.degrees(ALIKE):.0f}° or less"),
    "deviation": Measure("spread of directions", "angular deviation sqrt((1 - coherence) / 2) around a stroke", "°"),
    "coherence": Measure(
        "coherence", "length of the mean of (cos 2θ, sin 2θ) over a stroke and its neighbours; 1 is parallel"
    ),
    "homogeneity": Measure(
        "homogeneity of breadth", "mean / (mean + standard deviation) of the widths of a stroke and its neighbours"
    ),
}


@dataclass(frozen=True)
class Measures:
    """The measures of N strokes in the order of the catalogue, (N,) float64; NaN where one is not defined.

    Attributes:
        x: centre of the curve, pixels from the left.
        y: centre of the curve, pixels from the top.
        length: pixels; 0 for a dot.
        width: pixels.
        area: square pixels.
        elongatedness: NaN for a stroke of no width.
        straightness: in [0, 1]; NaN for a dot.
        curvature: integral of |curvature| along the stroke, radians in [0, pi].
        orientation: radians in [0, pi), from the x axis towards y, which points down: clockwise as it is seen;
            NaN for a dot.
        visible: in [0, 1]; 0 for a stroke that lies beyond the canvas.
        neighbours: without the stroke itself.
        aligned: without the stroke itself.
        deviation: radians in [0, 1 / sqrt(2)]; NaN as coherence.
        coherence: in [0, 1]; NaN without neighbours. Of n strokes in disorder it is about sqrt(pi / 4 n), and not 0.
        homogeneity: in (0, 1]; NaN without neighbours.
        radius: of the neighbourhood, pixels.
    """

    x: Array
    y: Array
    length: Array
    width: Array
    area: Array
    elongatedness: Array
    straightness: Array
    curvature: Array
    orientation: Array
    visible: Array
    neighbours: Array
    aligned: Array
    deviation: Array
    coherence: Array
    homogeneity: Array
    radius: float

    def __len__(self) -> int:
        return len(self.x)

    def items(self) -> Iterator[tuple[str, Array]]:
        """Names and arrays, x and y among them."""
        return ((field.name, getattr(self, field.name)) for field in fields(self) if field.name != "radius")


@torch.no_grad()
def measures_of(strokes: Strokes, depth: Tensor, size: tuple[int, int], radius: float | None = None) -> Measures:
    """Measure every stroke.

    Args:
        strokes: N strokes, all of which count as neighbours of each other; see `strokes.brushwork.counts`.
        depth: (N,) ranks, 0 is the bottom stroke.
        size: height and width of the canvas, pixels.
        radius: of the neighbourhood, pixels; None means ``RADIUS`` pitches.
    """
    radius = RADIUS * pitch_of(strokes, size) if radius is None else radius
    fine = strokes.map(Tensor.double)
    curve, width = curve_of(fine), 2 * half_width_of(fine)
    pieces = pieces_of(curve)
    lengths, places = length_of(pieces), point_at(pieces, curve.new_tensor(0.5))
    total = lengths.sum(1)
    dot = total < SHORTEST
    share = (lengths / total[:, None])[..., None]
    centre = (share * places).sum(1)
    chord = (curve[:, 2] - curve[:, 0]).norm(dim=1)
    angle = torch.where(dot, torch.nan, _principal_axis(places - centre[:, None], share))
    length = torch.where(dot, 0.0, total)
    around = surroundings_of(centre.numpy(), angle.numpy(), width.numpy(), radius, ALIKE)
    found = {
        "x": centre[:, 0],
        "y": centre[:, 1],
        "length": length,
        "width": width,
        "area": length * width + 0.25 * math.pi * width.square(),
        "elongatedness": torch.where(width > 0, length / width, torch.nan),
        "straightness": torch.where(dot, torch.nan, (chord / total).clamp_max(1)),
        "curvature": torch.where(dot, 0.0, turning_of(curve)),
        "orientation": angle,
        "visible": visible_share(strokes, depth, size),
    }
    return Measures(**{name: value.double().numpy() for name, value in found.items()}, **around, radius=radius)


def pieces_of(curve: Tensor) -> Tensor:
    """The same curves (N, 3, 2) as ``PARTS`` pieces each, one after the other (N, PARTS, 3, 2)."""
    ends = torch.linspace(0, 1, PARTS + 1, dtype=curve.dtype)
    first, last = ends[:-1], ends[1:]
    controls = [_blossom(u, v) for u, v in ((first, first), (first, last), (last, last))]
    return torch.einsum("pij,njk->npik", torch.stack(controls, dim=1), curve)


def _blossom(u: Tensor, v: Tensor) -> Tensor:
    """Weights (..., 3) of control points whose sum is the polar form of a curve at u and v (...)."""
    return torch.stack([(1 - u) * (1 - v), u + v - 2 * u * v, u * v], dim=-1)


def turning_of(curve: Tensor) -> Tensor:
    """Total curvature (N,) of curves (N, 3, 2): the angle between both legs, as a parabola turns one way only."""
    start, control, end = curve.unbind(1)
    first, last = control - start, end - control
    cross = first[:, 0] * last[:, 1] - first[:, 1] * last[:, 0]
    return torch.atan2(cross.abs(), (first * last).sum(1))


def _principal_axis(offset: Tensor, share: Tensor) -> Tensor:
    """Direction (N,) in [0, pi) in which points (N, P, 2), seen from their centre, spread most; share is (N, P, 1)."""
    x, y = offset.unbind(2)
    doubled = torch.stack([x.square() - y.square(), 2 * x * y], dim=2)
    cos, sin = (share * doubled).sum(1).unbind(1)
    angle = 0.5 * torch.atan2(sin, cos) % math.pi
    return torch.where(angle < math.pi, angle, 0.0)  # of a tiny negative angle rounding makes pi
