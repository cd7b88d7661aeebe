"""Transfer brushwork by a loss on lengths, widths, curvatures and directions, and by reshaping the initial strokes.

Sizes are in pitches, sqrt(number of pixels / number of strokes), so that strokes cover the new picture as densely as
they cover the reference painting.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.plugins.loss.base import BrushworkLoss, PaintedView
from brushexp.registry import register
from brushexp.strokes import measures as ruler
from brushexp.strokes.bezier import half_width_of, length_of, shape_of
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.measures import is_visible, pitch_of
from brushexp.strokes.prior import control_offset
from brushexp.system.precision import at_least_single

OPTION = "style.brushwork"  # key that errors name by default
MIN_STROKES = 30  # minimum number of visible strokes of a brushwork
SHORTEST_CHORD_PITCHES = 0.25  # shorter chords count as this long when the place of the control point is measured
LOG_OFFSET_PITCHES = 0.1  # size differences well below this vanish in the logarithms
MIN_SPREAD = 0.1  # smallest standard deviation of a measure: 10 % of size, 0.1 rad of curvature, 0.1 of coherence
AREA_JITTER = 0.1  # noise of log area in the assignment of larger strokes to larger cells
MATCHED = ("length", "width", "curvature", "coherence")  # measures that `distances` compares


@register("loss", "brushwork")
class BrushworkTransfer(BrushworkLoss):
    """Optimal transport distance from a reference painting in stroke length, width, curvature and coherence.

    For each of these four measures (``strokes.measures``, reported by `task=analyse`), the squared 2-Wasserstein
    distance between the distributions in the two paintings is computed, in units of the variance in the reference; the
    loss is the sum of the four. Coherence is 1 where a stroke and its neighbours are parallel. All strokes are used at
    every step; strokes too faint or too thin to be visible are ignored and get no gradient. ``style.brushwork`` adds
    this loss and shapes the initial strokes accordingly.

    Args:
        weight: factor in the sum of losses. For a reference of long, nearly straight strokes, ``style.brushwork`` with
            the default reduced distances of 1.4 (length), 0.3 (width), 1.8 (curvature) and 0.7 (coherence) standard
            deviations to at most 0.06; the PSNR was 0.9 dB lower.
        catalogue: catalogue.h5 of the reference painting; null for a loss of 0.
    """

    weight = 0.001
    looks_at = "strokes"

    def __init__(self, option: str = "loss.brushwork.catalogue", *, catalogue: str | None = None) -> None:
        super().__init__()
        self.reference = None if catalogue is None else load_brushwork(Path(catalogue), option)

    def forward(self, view: PaintedView) -> Tensor:
        if self.reference is None:
            return view.strokes.width.sum() * 0
        strokes = view.strokes.map(at_least_single)
        self.reference = self.reference.to(strokes.width)
        size = (view.whole_target.shape[1], view.whole_target.shape[2])
        return distances(strokes, size, self.reference).sum()

    def arrange(self, strokes: Strokes, size: tuple[int, int], generator: torch.Generator) -> Strokes:
        return strokes if self.reference is None else with_brushwork(strokes, self.reference, size, generator)


@dataclass(frozen=True)
class Brushwork:
    """Brushwork of M strokes; row i of every tensor except the last describes stroke i."""

    length: Tensor  # (M,) arc length, pitches
    width: Tensor  # (M,) thickness, pitches
    bend: Tensor  # (M, 2) control point along and across (never below 0) the chord: `prior.control_offset`
    deviation: Tensor  # (M,) direction of the chord relative to the neighbours' mean, radians in [-pi/2, pi/2]
    measures: Tensor  # (4, M) results of `measures_to_match`, each row ascending

    def __len__(self) -> int:
        return self.length.shape[0]

    def to(self, like: Tensor) -> "Brushwork":
        """Convert the tensors to the dtype and the device of ``like``."""
        return Brushwork(**{name: value.to(like) for name, value in vars(self).items()})


def load_brushwork(path: Path, option: str = OPTION) -> Brushwork:
    """Measure the brushwork in a saved catalogue; ``option`` is the path's key, which messages name."""
    from brushexp.strokes.storage import load_catalogue  # noqa: PLC0415  (slow to import)

    saved = load_catalogue(path, option)
    try:
        return brushwork_of(saved.strokes, saved.size)
    except UserError as error:
        raise UserError(f"{option}={path}: {error}") from error


@torch.no_grad()
def brushwork_of(strokes: Strokes, size: tuple[int, int]) -> Brushwork:
    """Measure the visible strokes on a canvas of ``size`` (H, W); raise a UserError for fewer than `MIN_STROKES`."""
    pitch = pitch_of(strokes, size)
    counted = strokes[is_visible(strokes, pitch)]
    if len(counted) < MIN_STROKES:
        cure = f"give a painting of {MIN_STROKES} strokes or more"
        raise UserError(
            f"only {len(counted)} of {len(strokes)} strokes are visible, too few to measure brushwork; {cure}"
        )
    shape = shape_of(counted)
    bend = control_offset(shape, SHORTEST_CHORD_PITCHES * pitch)
    around = torch.view_as_complex(ruler.mean_direction(ruler.direction_of(shape), ruler.neighbours_of(counted, shape)))
    chord = torch.stack([shape[:, 0], 0.5 * (shape[:, 0] + shape[:, 2]), shape[:, 2]], dim=1)
    return Brushwork(
        length=length_of(shape) / pitch,
        width=2 * half_width_of(counted) / pitch,
        bend=torch.where(bend[:, 1:] < 0, -bend, bend),
        deviation=0.5 * (torch.view_as_complex(ruler.direction_of(chord)) * around.conj()).angle(),
        measures=measures_to_match(counted, pitch).sort(1).values,
    )


def measures_to_match(strokes: Strokes, pitch: float) -> Tensor:
    """Compute the measures `MATCHED` (4, N): logs of length + 0.1 and width + 0.1 (pitches), curvature, coherence."""
    shape = shape_of(strokes)
    sizes = torch.stack([length_of(shape), 2 * half_width_of(strokes)]) / pitch
    coherence = ruler.coherence_of(ruler.direction_of(shape), ruler.neighbours_of(strokes, shape))
    return torch.cat([(sizes + LOG_OFFSET_PITCHES).log(), torch.stack([ruler.curvature_of(shape), coherence])])


def transport_cost(values: Tensor, reference: Tensor) -> Tensor:
    """Compute exact squared 2-Wasserstein distances (R,) between samples (R, N) and sorted samples (R, M)."""
    n, m = values.shape[1], reference.shape[1]
    ends = torch.cat([torch.arange(1, n + 1) * m, torch.arange(1, m + 1) * n]).unique()  # steps end here, in 1 / (n m)
    ends = ends.to(values.device)
    share = ends.diff(prepend=ends.new_zeros(1))
    begins = ends - share
    gap = values.sort(1).values[:, begins // m] - reference[:, begins // n]
    return (gap.square() * (share / (n * m)).to(gap)).sum(1)


def distances(strokes: Strokes, size: tuple[int, int], reference: Brushwork) -> Tensor:
    """Compute the squared 2-Wasserstein distance (4,) in each of `MATCHED`, in units of the reference's variance."""
    pitch = pitch_of(strokes, size)
    visible = is_visible(strokes, pitch)
    counted = strokes if bool(visible.all()) else strokes[visible]
    if not len(counted):
        return torch.zeros(len(MATCHED)).to(strokes.width) + strokes.width.sum() * 0
    spread = reference.measures.std(1, correction=0).clamp_min(MIN_SPREAD)
    return transport_cost(measures_to_match(counted, pitch), reference.measures) / spread.square()


@torch.no_grad()
def with_brushwork(
    strokes: Strokes, reference: Brushwork, size: tuple[int, int], generator: torch.Generator
) -> Strokes:
    """Give strokes the lengths, widths, bends and directions of a reference; keep position, colour and opacity.

    Each stroke gets the shape of one reference stroke, and all reference strokes are used equally often, as far as
    possible. Larger shapes are assigned to larger ``strokes``. Directions are relative to the mean direction of the
    neighbouring strokes, and each stroke bends towards the side to which this mean direction turns along the stroke.
    """
    if not len(strokes):
        return strokes
    pitch = pitch_of(strokes, size)
    row = _assign(strokes, reference, generator)
    model = reference.to(strokes.width)
    bend = torch.view_as_complex(model.bend)[row]
    half = torch.full_like(bend, 0.5)
    unit = torch.stack([half, bend, -half], dim=1)  # along and across, in chords
    chord = pitch * model.length[row] / length_of(torch.view_as_real(unit)).clamp_min(1e-6)
    way = torch.polar(0.5 * chord, 0.5 * _flow_at(strokes.position, strokes).angle() + model.deviation[row])
    before, after = (_flow_at(strokes.position + torch.view_as_real(step), strokes) for step in (-way, way))
    turns = (after * before.conj()).imag > 0  # to one side; the control point then lies on the other side
    unit = unit - 0.5 * bend[:, None]  # moves the middle of the curve to the position of the stroke
    points = torch.where(turns[:, None], unit.conj(), unit) * (4 * way / strokes.scale)[:, None]
    start, control, end = torch.view_as_real(points).unbind(1)
    return replace(strokes, start=start, control=control, end=end, width=pitch * model.width[row] / strokes.scale)


def _assign(strokes: Strokes, reference: Brushwork, generator: torch.Generator) -> Tensor:
    """Choose the row (N,) of the reference from which each stroke takes its shape."""
    n, m = len(strokes), len(reference)
    rows = torch.cat([torch.arange(m).repeat(n // m), torch.randperm(m, generator=generator)[: n % m]])
    thickness = 2 * half_width_of(strokes)
    area = ((length_of(shape_of(strokes)) + thickness) * thickness).cpu()
    drawn = ((reference.length + reference.width) * reference.width).cpu()[rows]
    chance = torch.randn(n, generator=generator)
    assigned = torch.empty(n, dtype=torch.long)
    assigned[(area.log() + AREA_JITTER * chance).argsort()] = rows[drawn.argsort()]
    return assigned.to(strokes.width.device)


def _flow_at(points: Tensor, strokes: Strokes) -> Tensor:
    """Compute the mean direction (Q,) of the strokes nearest to each point (Q, 2), as a complex, doubled angle."""
    shape = shape_of(strokes)
    near = ruler.nearest_strokes(points, strokes.position + ruler.centre_of(shape), exclude_self=False)
    return torch.view_as_complex(ruler.mean_direction(ruler.direction_of(shape), near))
