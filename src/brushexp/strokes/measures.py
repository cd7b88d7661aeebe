"""Define the measures of strokes for `task=analyse`, `style.brushwork` and the losses.

All measures are differentiable, and finite with finite gradients for any strokes. Curves are (N, 3, 2) control points
in pixels. Directions are doubled: (cos 2 theta, sin 2 theta), which is the same for both senses along a stroke
(Batschelet, 1981).

Names follow Li, Yao, Hendriks and Wang, "Rhythmic brushstrokes distinguish van Gogh from his contemporaries" (IEEE
TPAMI 34(6), 2012), who measure regions of pixels. Differs from the source: straightness is chord over arc length,
because the correlation of x and y is undefined for a horizontal stroke; homogeneity compares a stroke's breadth with
its neighbours', because along one stroke it is constant; neighbours are the ``NEIGHBOURS`` nearest strokes (Kotovenko
et al., 2021) instead of those within 200 pixels, so that paintings of different sizes are comparable.
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
    """The name and definition of a measure. Angles are stored in radians and shown in degrees."""

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
    """Compute the ratio (N,) of the distance between the ends to the arc length, in [0, 1]; 0 for a point."""
    chord = (curve[:, 2] - curve[:, 0]).square().sum(1)
    tiny = torch.finfo(curve.dtype).tiny
    return ((chord + tiny).sqrt() / length.clamp_min(POINT_LENGTH**2)).clamp_max(1)


def curvature_of(curve: Tensor) -> Tensor:
    """Compute the total curvature (N,), in radians in [0, pi], as the angle between the two legs; 0 for a point."""
    (x, y), (u, v) = (leg.unbind(1) for leg in _unit_legs(curve))
    return torch.atan2((x * v - y * u).abs(), x * u + y * v + LEG_SOFTENING)


def centre_of(curve: Tensor) -> Tensor:
    """Compute the centre (N, 2) of curves, the mean of their control points."""
    return curve.mean(1)


def direction_of(curve: Tensor) -> Tensor:
    """Compute the doubled direction (N, 2) of the principal axis of curves, with length 1, or less for points.

    The second moment of B(t) about its mean, for uniform t, is (4 a^2 + 7 a b + 4 b^2) / 45, for legs a and b as
    complex numbers; squaring doubles angles.
    """
    (x, y), (u, v) = (leg.unbind(1) for leg in _unit_legs(curve))
    real = 4 * (x * x - y * y + u * u - v * v) + 7 * (x * u - y * v)
    imaginary = 8 * (x * y + u * v) + 7 * (x * v + y * u)
    doubled = torch.stack([real, imaginary], dim=1) / 45
    return doubled / (doubled.square().sum(1, keepdim=True) + ISOTROPY_SOFTENING**2).sqrt()


def _unit_legs(curve: Tensor) -> tuple[Tensor, Tensor]:
    """Compute both legs (N, 2) in units of the root of the sum of their squared lengths."""
    start, control, end = curve.unbind(1)
    first, last = control - start, end - control
    size = (first.square().sum(1) + last.square().sum(1) + POINT_LENGTH**2).sqrt()[:, None]
    return first / size, last / size


@torch.no_grad()
def nearest_strokes(points: Tensor, centres: Tensor, k: int = NEIGHBOURS, *, exclude_self: bool) -> Tensor:
    """Find indices (Q, k) of the k ``centres`` (N, 2) nearest to ``points`` (Q, 2), or of all if there are fewer.

    With ``exclude_self``, the points are the centres, and no point is its own neighbour.
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
    """Find indices (N, k) of the strokes whose curves (`bezier.shape_of`) have the nearest centres."""
    centre = strokes.position + centre_of(shape)
    return nearest_strokes(centre, centre, k, exclude_self=True)


def with_self(near: Tensor) -> Tensor:
    """Prepend each stroke's own index to the indices of its neighbours: (N, k) becomes (N, 1 + k)."""
    return torch.cat([torch.arange(len(near), device=near.device)[:, None], near], dim=1)


def mean_direction(direction: Tensor, near: Tensor) -> Tensor:
    """Average the doubled directions of strokes ``near`` (Q, k) to (Q, 2), of length at most 1, ignoring points."""
    weight = (direction.square().sum(1, keepdim=True) + torch.finfo(direction.dtype).eps).sqrt()
    # The gradient of `index_select` is faster than that of [].
    table = torch.cat([direction, weight], dim=1).index_select(0, near.flatten())
    total = table.reshape(*near.shape, 3).sum(1)
    return total[:, :2] / total[:, 2:].clamp_min(torch.finfo(direction.dtype).tiny)


def coherence_of(direction: Tensor, near: Tensor) -> Tensor:
    """Compute the length (N,) of the mean direction around strokes: 1 if parallel, about sqrt(pi / 4 n) if random."""
    mean = mean_direction(direction, with_self(near))
    return (mean.square().sum(1) + torch.finfo(mean.dtype).eps ** 2).sqrt()


def homogeneity_of(width: Tensor, near: Tensor) -> Tensor:
    """Compute mean / (mean + standard deviation) (N,) of the widths of each stroke and its neighbours."""
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
    """Return which strokes (N,) are opaque and thick enough to be visible, whether or not others hide them."""
    return (strokes.opacity >= MIN_OPACITY) & (2 * half_width_of(strokes) >= MIN_WIDTH_PITCHES * pitch)
