"""Measure strokes for `task=analyse`, `style.brushwork` and the losses.

All measures are differentiable, and their values and gradients are finite for any strokes. Curves are given by their
control points (N, 3, 2) in pixels. Directions are doubled, (cos 2 theta, sin 2 theta), so that a stroke has the same
direction from either end (Batschelet, 1981).

The names follow Li, Yao, Hendriks and Wang, "Rhythmic brushstrokes distinguish van Gogh from his contemporaries" (IEEE
TPAMI 34(6), 2012), who measure regions of pixels. Three definitions differ from this source. Straightness is chord
over arc length, because the correlation of x and y is undefined for a horizontal stroke. Homogeneity compares the
breadth of a stroke with that of its neighbours, because breadth is constant along a stroke. Neighbours are the
``NEIGHBOURS`` nearest strokes (Kotovenko et al., 2021) instead of all strokes within 200 pixels, so that paintings of
different sizes are comparable.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from brushexp.strokes.bezier import half_width_of
from brushexp.strokes.catalogue import Strokes

NEIGHBOURS = 10  # number of nearest strokes that a stroke is compared with
POINT_LENGTH = 0.1  # pixels; a much shorter curve is a point, and smoothly loses curvature and direction
LEG_SOFTENING = 1e-4  # fraction of the curve below which a leg does not count as a turn
ISOTROPY_SOFTENING = 1e-3  # a curve with nearly equal spread in all directions smoothly loses its direction
MIN_OPACITY = 0.1  # opacity below which strokes do not count
MIN_WIDTH_PITCHES = 0.02  # smallest thickness, in pitches, of strokes that count
LI, BATSCHELET = "Li et al., 2012", "Batschelet, 1981"


@dataclass(frozen=True)
class Measure:
    """The name, definition and display range of a measure. Angles are stored in radians and shown in degrees."""

    name: str
    meaning: str
    source: str = ""  # author and year; "" for plain geometry
    unit: str = ""  # displayed unit; "" for a share or a plain number
    high: float = math.inf  # upper end of its displayed range; the lower end is 0
    power: int = 0  # power of pixels: 1 for a length, 2 for an area
    axial: bool = False  # whether it is a direction, with a period of half a turn


MEASURES = {
    "length": Measure("length", "arc length of the curve, without the round ends", LI, "px", power=1),
    "width": Measure("width", "full thickness (broadness)", LI, "px", power=1),
    "area": Measure(
        "area", "length x width + pi/4 width^2, including hidden parts and parts beyond the canvas", LI, "px^2", power=2
    ),
    "elongatedness": Measure("elongatedness", "length / width", LI),
    "straightness": Measure("straightness", "distance of the ends / length; 1 is straight", BATSCHELET, high=1.0),
    "curvature": Measure(
        "curvature", "total curvature, the turn of the stroke from end to end; a half circle turns by 180°",
        "Milnor, 1950", "°", 180.0,
    ),
    "orientation": Measure(
        "orientation", "principal axis of the curve, clockwise; 0° is level, 45° falls to the right", LI, "°", 180.0,
        axial=True,
    ),
    "coherence": Measure(
        "coherence",
        f"length of the mean of (cos 2θ, sin 2θ) over a stroke and its {NEIGHBOURS} nearest; 1 is parallel",
        BATSCHELET, high=1.0,
    ),
    "homogeneity": Measure(
        "homogeneity of breadth",
        f"mean / (mean + standard deviation) of the widths of a stroke and its {NEIGHBOURS} nearest", LI, high=1.0,
    ),
}  # fmt: skip


def area_of(length: Tensor, width: Tensor) -> Tensor:
    """Compute the area (N,) of strokes with round ends from their lengths and widths."""
    return length * width + 0.25 * math.pi * width.square()


def straightness_of(curve: Tensor, length: Tensor) -> Tensor:
    """Compute the ratio (N,) of chord to arc length, in [0, 1]; 0 for a point."""
    chord = (curve[:, 2] - curve[:, 0]).square().sum(1)
    tiny = torch.finfo(curve.dtype).tiny
    return ((chord + tiny).sqrt() / length.clamp_min(POINT_LENGTH**2)).clamp_max(1)


def curvature_of(curve: Tensor) -> Tensor:
    """Compute the total curvature (N,), the angle between the two legs in radians, in [0, pi]; 0 for a point."""
    (x, y), (u, v) = (leg.unbind(1) for leg in _unit_legs(curve))
    return torch.atan2((x * v - y * u).abs(), x * u + y * v + LEG_SOFTENING)


def centre_of(curve: Tensor) -> Tensor:
    """Compute the centres (N, 2) of curves as the means of their control points."""
    return curve.mean(1)


def direction_of(curve: Tensor) -> Tensor:
    """Compute the doubled direction (N, 2) of each curve's principal axis; its length is 1, or less for points.

    If the legs a and b are complex numbers and t is uniform, the second moment of B(t) about its mean is
    (4 a^2 + 7 a b + 4 b^2) / 45; squaring doubles angles.
    """
    (x, y), (u, v) = (leg.unbind(1) for leg in _unit_legs(curve))
    real = 4 * (x * x - y * y + u * u - v * v) + 7 * (x * u - y * v)
    imaginary = 8 * (x * y + u * v) + 7 * (x * v + y * u)
    doubled = torch.stack([real, imaginary], dim=1) / 45
    return doubled / (doubled.square().sum(1, keepdim=True) + ISOTROPY_SOFTENING**2).sqrt()


def _unit_legs(curve: Tensor) -> tuple[Tensor, Tensor]:
    """Divide both legs (N, 2) by the square root of the sum of their squared lengths."""
    start, control, end = curve.unbind(1)
    first, last = control - start, end - control
    size = (first.square().sum(1) + last.square().sum(1) + POINT_LENGTH**2).sqrt()[:, None]
    return first / size, last / size


@torch.no_grad()
def nearest_strokes(points: Tensor, centres: Tensor, k: int = NEIGHBOURS, *, exclude_self: bool) -> Tensor:
    """Find the indices (Q, k) of the k ``centres`` (N, 2) nearest to each of ``points`` (Q, 2), or all if fewer exist.

    With ``exclude_self``, ``points`` must be ``centres``, and no point is its own neighbour.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415  (slow to import)

    k = min(k, len(centres) - exclude_self)
    if k < 1:
        return torch.empty(len(points), 0, dtype=torch.long, device=points.device)
    places, around = (x.detach().cpu().double().numpy() for x in (points, centres))  # NumPy has no bfloat16
    index = torch.from_numpy(cKDTree(around).query(places, k=k + exclude_self, workers=torch.get_num_threads())[1])
    index = index.reshape(len(points), k + exclude_self).to(points.device)
    if exclude_self:  # if strokes coincide, the stroke itself may not come first or even be included
        own = index == torch.arange(len(points), device=points.device)[:, None]
        index = index[:, 1:] if own[:, 0].all() else index.gather(1, own.long().argsort(dim=1, stable=True))[:, :k]
    return index


def neighbours_of(strokes: Strokes, shape: Tensor, k: int = NEIGHBOURS) -> Tensor:
    """Find the indices (N, k) of the k strokes nearest to each stroke, by the centres of curves (`bezier.shape_of`)."""
    centre = strokes.position + centre_of(shape)
    return nearest_strokes(centre, centre, k, exclude_self=True)


def with_self(near: Tensor) -> Tensor:
    """Prepend each stroke's own index to the indices of its neighbours: (N, k) becomes (N, 1 + k)."""
    return torch.cat([torch.arange(len(near), device=near.device)[:, None], near], dim=1)


def mean_direction(direction: Tensor, near: Tensor) -> Tensor:
    """Average the doubled directions of the strokes ``near`` (Q, k), except points; means (Q, 2) have length <= 1."""
    weight = (direction.square().sum(1, keepdim=True) + torch.finfo(direction.dtype).eps).sqrt()
    # The gradient of `index_select` is faster than that of [].
    table = torch.cat([direction, weight], dim=1).index_select(0, near.flatten())
    total = table.reshape(*near.shape, 3).sum(1)
    return total[:, :2] / total[:, 2:].clamp_min(torch.finfo(direction.dtype).tiny)


def coherence_of(direction: Tensor, near: Tensor) -> Tensor:
    """Compute the length (N,) of the mean of n nearby directions: 1 if parallel, about sqrt(pi / 4 n) if random."""
    mean = mean_direction(direction, with_self(near))
    return (mean.square().sum(1) + torch.finfo(mean.dtype).eps ** 2).sqrt()


def homogeneity_of(width: Tensor, near: Tensor) -> Tensor:
    """Compute mean / (mean + standard deviation) of the widths of each stroke and its neighbours; return (N,)."""
    own = with_self(near)
    around = width.index_select(0, own.flatten()).reshape(own.shape)
    tiny = torch.finfo(width.dtype).tiny ** 0.5
    mean = around.mean(1, keepdim=True) + tiny
    spread = ((around - mean).square().mean(1) + tiny**2).sqrt()
    return mean[:, 0] / (mean[:, 0] + spread)


def pitch_of(strokes: Strokes, size: tuple[int, int]) -> float:
    """Compute the typical distance between neighbouring strokes: sqrt(pixels / strokes)."""
    return math.sqrt(size[0] * size[1] / max(len(strokes), 1))


def is_visible(strokes: Strokes, pitch: float) -> Tensor:
    """Return a mask (N,) of strokes opaque and thick enough to be visible, even if other strokes hide them."""
    return (strokes.opacity >= MIN_OPACITY) & (2 * half_width_of(strokes) >= MIN_WIDTH_PITCHES * pitch)
