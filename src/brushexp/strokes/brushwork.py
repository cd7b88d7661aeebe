"""Brushwork: the sizes, bends and directions of the strokes of a painting, as a sample that others can be drawn from.

Sizes are in pitches, sqrt(pixels of the canvas / number of strokes): strokes so transferred cover a picture as densely
as they cover their own, whatever its size and their number. For strokes as large against the picture as the painting's,
paint with as many strokes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.strokes.bezier import curve_of, half_width_of, length_of
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.neighbours import NEIGHBOURS, nearest
from brushexp.strokes.prior import bend_of

OPTION = "style.brushwork"  # what an error tells a user to set, if nobody says otherwise
FAINTEST = 0.1  # opacity below which a stroke does not count
THINNEST = 0.02  # pitches: thickness below which a stroke does not count
FEWEST = 30  # strokes that count, for a brushwork
WINDOW = 6.4  # pitches: side of the window in which bends are measured, as of first strokes
FLOOR = 0.1  # pitches, or chords of bend: differences well below it are not seen in logarithms
NARROWEST = 0.1  # least spread of a measure that is taken for one: 10 % of size, 0.1 of agreement
JITTER = 0.1  # of the logarithm of area, when the larger strokes are given to the larger cells
MEASURES = ("length", "width", "curvature", "agreement")


@dataclass(frozen=True)
class Brushwork:
    """A sample of M strokes; row i of every tensor is one stroke.

    Attributes:
        length: (M,) arc length, pitches.
        width: (M,) thickness, pitches.
        bend: (M, 2) of the control point along and across the chord, as `bend_of`, not below 0 across (a stroke drawn
            from its other end has both signs turned).
        deviation: (M,) direction against the mean one of the neighbours, radians in [-pi/2, pi/2].
        measures: (4, M) what `measures_of` finds, each row ascending.
    """

    length: Tensor
    width: Tensor
    bend: Tensor
    deviation: Tensor
    measures: Tensor

    def __len__(self) -> int:
        return self.length.shape[0]

    def to(self, like: Tensor) -> Brushwork:
        """The same in the dtype and on the device of ``like``."""
        length, width, bend, deviation, measures = (
            value.to(like) for value in (self.length, self.width, self.bend, self.deviation, self.measures)
        )
        return Brushwork(length, width, bend, deviation, measures)


def load_brushwork(path: Path, option: str = OPTION) -> Brushwork:
    """The brushwork of a saved catalogue.

    Args:
        path: of the catalogue.
        option: what sets it, for messages.

    Raises:
        UserError: if it is no catalogue, or fewer than ``FEWEST`` of its strokes count.
    """
    from brushexp.strokes.storage import load_catalogue  # noqa: PLC0415  (slow to import)

    saved = load_catalogue(path, option)
    try:
        return brushwork_of(saved.strokes, saved.size)
    except UserError as error:
        raise UserError(f"{option}={path}: {error}") from error


@torch.no_grad()
def brushwork_of(strokes: Strokes, size: tuple[int, int]) -> Brushwork:
    """The brushwork of strokes on a canvas of ``size`` (height, width), of those that `counts`.

    Raises:
        UserError: if those are fewer than ``FEWEST``.
    """
    pitch = pitch_of(strokes, size)
    counted = strokes[counts(strokes, pitch)]
    if len(counted) < FEWEST:
        raise UserError(
            f"{len(counted)} of {len(strokes)} strokes can be seen, too few for a brushwork; "
            f"give a painting of {FEWEST} strokes or more"
        )
    bend = chord_bend(counted, pitch)
    turned = torch.where(bend[:, 1:] < 0, -bend, bend)
    heading = heading_of(counted)
    around = mean_heading(counted.position, counted, exclude_self=True)
    measures = measures_of(counted, pitch).sort(1).values
    return Brushwork(
        length=length_of(curve_of(counted)) / pitch,
        width=2 * half_width_of(counted) / pitch,
        bend=turned,
        deviation=0.5 * _angle(_turned_back(heading, around)),
        measures=measures,
    )


def pitch_of(strokes: Strokes, size: tuple[int, int]) -> float:
    """Typical distance between neighbouring strokes on a canvas of ``size``: sqrt(pixels / strokes)."""
    return math.sqrt(size[0] * size[1] / max(len(strokes), 1))


def counts(strokes: Strokes, pitch: float) -> Tensor:
    """Which strokes (N,) can be seen: opacity at least ``FAINTEST``, thickness at least ``THINNEST`` pitches.

    A stroke that others hide counts; which those are depends on the renderer.
    """
    return (strokes.opacity >= FAINTEST) & (2 * half_width_of(strokes) >= THINNEST * pitch)


def measures_of(strokes: Strokes, pitch: float) -> Tensor:
    """What is compared between paintings (4, N), differentiable and finite for any strokes.

    log(length + 0.1) and log(width + 0.1) in pitches; log(curvature + 0.1), curvature being the distance of the control
    point from the middle of the chord, in chords; and agreement: the mean of cos 2 (angle to a neighbour) over the
    nearest ``NEIGHBOURS`` strokes, weighted by their lengths, which is 1 where all are parallel and 0 in disorder.
    """
    curvature = (chord_bend(strokes, pitch).square().sum(1) + (0.01 * FLOOR) ** 2).sqrt()  # with a slope at 0
    sizes = torch.stack([length_of(curve_of(strokes)) / pitch, 2 * half_width_of(strokes) / pitch, curvature])
    around = mean_heading(strokes.position, strokes, exclude_self=True)
    agreement = (_unit(heading_of(strokes)) * around).sum(1)
    return torch.cat([(sizes + FLOOR).log(), agreement[None]])


def chord_bend(strokes: Strokes, pitch: float) -> Tensor:
    """`bend_of` strokes (N, 2), whatever their windows; a chord below a quarter of a pitch is taken to be so long."""
    side = (strokes.scale / (WINDOW * pitch))[:, None]
    points = {name: getattr(strokes, name) * side for name in ("start", "control", "end")}
    return bend_of(replace(strokes, **points))


def heading_of(strokes: Strokes) -> Tensor:
    """Doubled direction (N, 2) from end to end, as long as the chord in pixels: the same for both ways along it."""
    x, y = ((strokes.end - strokes.start) * (0.5 * strokes.scale)[:, None]).unbind(1)
    length = (x.square() + y.square() + torch.finfo(x.dtype).eps).sqrt()
    return torch.stack([x.square() - y.square(), 2 * x * y], dim=1) / length[:, None]


def mean_heading(points: Tensor, strokes: Strokes, *, exclude_self: bool = False) -> Tensor:
    """Doubled mean direction (Q, 2) of the strokes nearest to points (Q, 2), weighted by length; at most 1 long.

    With ``exclude_self`` the points are the strokes' own places, and none is a neighbour of itself.
    """
    heading = heading_of(strokes)
    near = nearest(points, strokes.position, NEIGHBOURS, exclude_self=exclude_self)
    if not near.shape[1]:
        return heading.new_zeros(len(points), 2)
    weight = (heading.square().sum(1, keepdim=True) + torch.finfo(heading.dtype).eps).sqrt()
    table = torch.cat([heading, weight], dim=1)
    total = (
        table.index_select(0, near.flatten()).reshape(*near.shape, 3).sum(1)
    )  # its slope is quicker than table[near]'s
    return total[:, :2] / total[:, 2:]


def transport_cost(values: Tensor, reference: Tensor) -> Tensor:
    """Squared 2-Wasserstein distances (R,) between two samples on the line, row by row: (R, N) and (R, M).

    The integral over u from 0 to 1 of the squared difference of both quantile functions, which are steps; exact for
    any N and M. The rows of ``reference`` are ascending.
    """
    n, m = values.shape[1], reference.shape[1]
    ends = torch.cat([torch.arange(1, n + 1) * m, torch.arange(1, m + 1) * n]).unique()  # of steps, in 1 / (n m)
    ends = ends.to(values.device)
    share = ends.diff(prepend=ends.new_zeros(1))
    begins = ends - share
    gap = values.sort(1).values[:, begins // m] - reference[:, begins // n]
    return (gap.square() * (share / (n * m)).to(gap)).sum(1)


def spread_of(reference: Brushwork) -> Tensor:
    """Standard deviation (4,) of each measure, at least ``NARROWEST``."""
    return reference.measures.std(1, correction=0).clamp_min(NARROWEST)


def distances(strokes: Strokes, size: tuple[int, int], reference: Brushwork) -> Tensor:
    """Squared 2-Wasserstein distance (4,) of each measure from the reference, in units of the reference's variance.

    0 if no stroke `counts`. Those that do not have no gradient.
    """
    pitch = pitch_of(strokes, size)
    seen = counts(strokes, pitch)
    counted = strokes if bool(seen.all()) else strokes[seen]
    if not len(counted):
        return torch.zeros(len(MEASURES)).to(strokes.width) + strokes.width.sum() * 0
    return transport_cost(measures_of(counted, pitch), reference.measures) / spread_of(reference).square()


@torch.no_grad()
def with_brushwork(
    strokes: Strokes, reference: Brushwork, size: tuple[int, int], generator: torch.Generator
) -> Strokes:
    """The same strokes, in place, colour and opacity, with the reference's lengths, widths, bends and directions.

    Each stroke is given those of one stroke of the reference together. All of the reference is used equally often, as
    far as the numbers allow; which of them are used once more is drawn. The larger ones go where ``strokes`` are
    larger, up to chance, so that detail keeps its small strokes. A stroke lies along the mean direction of the
    neighbouring ``strokes`` and deviates from it as its model deviates from its own neighbours; it bends to the side
    to which that direction turns along it.

    Args:
        strokes: N strokes.
        reference: the sample.
        size: height and width of the canvas, pixels.
        generator: of everything random.
    """
    if not len(strokes):
        return strokes
    pitch = pitch_of(strokes, size)
    row = _assigned(strokes, reference, generator)
    model = reference.to(strokes.width)
    flow = mean_heading(strokes.position, strokes)
    angle = 0.5 * _angle(flow) + model.deviation[row]
    along = torch.stack([angle.cos(), angle.sin()], dim=1)
    across = torch.stack([-along[:, 1], along[:, 0]], dim=1)
    bend = model.bend[row]
    unit = torch.stack([torch.zeros_like(bend), bend, torch.zeros_like(bend)], dim=1)  # along and across, in chords
    unit[:, 0, 0], unit[:, 2, 0] = 0.5, -0.5
    chord = pitch * model.length[row] / length_of(unit).clamp_min(1e-6)
    unit = unit - 0.5 * bend[:, None]  # the middle of the curve to the place of the stroke
    side = _side_of(strokes, along * (0.5 * chord)[:, None], across)
    axes = torch.stack([along, across * side[:, None]], dim=1)
    points = unit @ axes * (2 * chord / strokes.scale)[:, None, None]
    start, control, end = points.unbind(1)
    return replace(strokes, start=start, control=control, end=end, width=pitch * model.width[row] / strokes.scale)


def _assigned(strokes: Strokes, reference: Brushwork, generator: torch.Generator) -> Tensor:
    """Row (N,) of the reference that each stroke is given."""
    n, m = len(strokes), len(reference)
    rows = torch.cat([torch.arange(m).repeat(n // m), torch.randperm(m, generator=generator)[: n % m]])
    drawn = (reference.length + reference.width)[rows] * reference.width[rows]
    thickness = 2 * half_width_of(strokes)
    area = (length_of(curve_of(strokes)) + thickness) * thickness
    noise = torch.randn(2, n, generator=generator) * JITTER
    smallest_drawn = (drawn.double().cpu().clamp_min(1e-12).log() + noise[0]).argsort()
    smallest = (area.double().cpu().clamp_min(1e-12).log() + noise[1]).argsort()
    assigned = torch.empty(n, dtype=torch.long)
    assigned[smallest] = rows[smallest_drawn]
    return assigned.to(strokes.width.device)


def _side_of(strokes: Strokes, half: Tensor, across: Tensor) -> Tensor:
    """1 or -1 (N,): where the control point must lie for a curve to turn as the direction does along it.

    Seen along ``half``, half of the chord, a direction that turns towards ``across`` is followed by a curve whose
    control point lies on the other side.
    """
    before, after = (mean_heading(strokes.position + way, strokes) for way in (-half, half))
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return torch.where(turn > 0, -torch.ones_like(turn), torch.ones_like(turn))


def _turned_back(heading: Tensor, by: Tensor) -> Tensor:
    """Doubled directions (N, 2) as seen from others (N, 2)."""
    return torch.stack([(heading * by).sum(1), by[:, 0] * heading[:, 1] - by[:, 1] * heading[:, 0]], dim=1)


def _angle(heading: Tensor) -> Tensor:
    return torch.atan2(heading[:, 1], heading[:, 0])


def _unit(heading: Tensor) -> Tensor:
    eps = torch.finfo(heading.dtype).eps
    return heading / (heading.square().sum(1, keepdim=True) + eps).sqrt()
