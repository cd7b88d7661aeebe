"""Losses that look at the strokes, not at the pixels."""

from pathlib import Path
from typing import Annotated, Any

import torch
from torch import Tensor

from brushexp.bounds import at_least
from brushexp.plugins.loss.base import Loss, PaintedView, at_least_single
from brushexp.registry import register
from brushexp.strokes.bezier import shape_of
from brushexp.strokes.brushwork import distances, load_brushwork
from brushexp.strokes.measures import NEIGHBOURS, curvature_of, direction_of, neighbours_of
from brushexp.strokes.prior import INSET, SPREAD, bend_of

SHRINK = 1e-3  # share of the wanted covariance that is mixed into the measured one


@register("loss", "width")
class Width(Loss):
    """Mean of max(0, 1.4 w - |s - e|): strokes at least as long as valid ones of their width (thesis 2020, eq. 6.24).

    Thickness and length are fractions of the window's side. ``start`` and ``end`` are in half-windows, so |s - e| here
    is half of their distance; a stroke of thickness 0.2 needs ends 0.56 half-windows apart. Differs from the source,
    which asks for 2 w: the ends of valid strokes are 2 w apart before their points (and not their widths) are shrunk by
    ``prior.INSET`` = 0.7, as all parameters here are. So no valid stroke is penalised. The slope of the length is 0
    where the ends coincide.

    Args:
        weight: factor in the sum of losses. Of 500 thick strokes, ``mse`` alone left a mean of 0.2, with the default of
            this loss 0.0004 at a cost of less than 0.1 dB; 0.1 cost 0.1 dB.
    """

    cost = "0.5 x mse"
    looks_at = "strokes"

    def __init__(self, *, weight: float = 0.01) -> None:
        super().__init__(weight)

    def forward(self, painting: PaintedView) -> Tensor:
        strokes = painting.strokes.map(at_least_single)
        square = (strokes.start - strokes.end).square().sum(1)
        nothing = (square == 0).to(square)
        length = (square + nothing).sqrt() - nothing  # the slope at 0 is 0, not 0/0
        return (2 * INSET * strokes.width - 0.5 * length).clamp_min(0).sum() / max(len(strokes), 1)


@register("loss", "kl")
class KullbackLeibler(Loss):
    """How far the bends of all strokes are from those of valid strokes (thesis 2020, eq. 6.26 to 6.37).

    The control point of each stroke, along and across s - e, from the middle between s and e, in units of |s - e|, has
    mean mu and covariance S over the strokes; the loss is KL(N(mu, S) || N(0, T)), T = diag(1/200, 1/25). Differs from
    the source: S is (1 - 1/1000) of the measured covariance and 1/1000 of T, which keeps the loss (below 7 for strokes
    that are all straight) and its gradient finite where S is singular, for one stroke or equal ones, and leaves the
    minimum, 0 at mu = 0 and S = T, where it is. Its print has S and T exchanged in the KL.

    Args:
        weight: factor in the sum of losses. 500 wildly bent strokes ended at 51 with ``mse`` alone, with the default of
            this loss at 0.2 at a cost of less than 0.1 dB, and with 0.001 at 0.001 at a cost of 0.1 dB.
    """

    cost = "0.6 x mse"
    looks_at = "strokes"

    def __init__(self, *, weight: float = 0.0001) -> None:
        super().__init__(weight)

    def forward(self, painting: PaintedView) -> Tensor:
        if not len(painting.strokes):
            return painting.strokes.control.sum()  # 0, and differentiable
        bend = bend_of(painting.strokes.map(at_least_single))
        x, y = (bend / bend.new_tensor(SPREAD).sqrt()).unbind(1)  # in these units T is the identity
        mean_x, mean_y = x.mean(), y.mean()
        x, y = x - mean_x, y - mean_y
        s_xx, s_yy = (SHRINK + (1 - SHRINK) * z.square().mean() for z in (x, y))
        slope = (1 - SHRINK) * (x * y).mean() / s_xx
        # |S| / s_xx as a sum of squares: s_xx s_yy - s_xy^2 may round to a negative number.
        rest = SHRINK * (1 + slope.square()) + (1 - SHRINK) * (y - slope * x).square().mean()
        return 0.5 * (s_xx + s_yy - 2 - s_xx.log() - rest.log() + mean_x.square() + mean_y.square())


@register("loss", "curvature")
class Curvature(Loss):
    """Mean curvature of the strokes: by how much each turns from end to end, in radians; 0 if all are straight.

    Source: Kotovenko et al., 2021, arXiv:2103.17185, who penalise |(s - c) + (e - c)| / |e - s|. Differs: this is the
    total curvature that `task=analyse` reports (`strokes.measures.curvature_of`). It is twice the arc tangent of the
    source's for symmetric strokes, about twice for weak bends and at most pi for hairpins, for which the source's has
    no bound; a control point off the middle of a straight line does not count.

    Args:
        weight: factor in the sum of losses; the source's 4 is for other units. On a portrait ``mse`` alone left a mean
            of 1.26 rad, with the default of this loss 0.48 at a cost of 0.1 dB; 0.0005 left 0.25 (0.3 dB).
    """

    cost = "0.5 x mse"
    looks_at = "strokes"

    def __init__(self, *, weight: float = 0.0002) -> None:
        super().__init__(weight)

    def forward(self, painting: PaintedView) -> Tensor:
        shape = shape_of(painting.strokes.map(at_least_single))
        return curvature_of(shape).sum() / max(len(shape), 1)


@register("loss", "direction")
class Direction(Loss):
    """Mean squared difference between the directions of each stroke and its nearest ones: they flow together.

    Source: Kotovenko et al., 2021, arXiv:2103.17185, who compare (dx^2, dy^2, dx dy) of d = e - s. Differs: the
    direction is (cos 2 theta, sin 2 theta) of the principal axis of the curve, as `task=analyse` measures it
    (`strokes.measures.direction_of`), so that lengths do not matter. 4 sin^2 of the angle between two strokes, averaged
    over all pairs of a stroke and one of its nearest: 0 if all are parallel, 2 in disorder.

    Args:
        weight: factor in the sum of losses; the source's 0.008 is for other units. On a portrait ``mse`` alone left
            1.32, with the default of this loss 0.79 at a cost of 0.1 dB; 0.0001 left 1.04 (less than 0.1 dB).
        k: neighbours of a stroke; of fewer strokes, all others.
        every: the neighbours are found anew at every so many calls, and whenever the number of strokes has changed.
    """

    cost = "0.6 x mse"
    looks_at = "strokes"

    def __init__(
        self,
        *,
        weight: float = 0.0003,
        k: Annotated[int, at_least(1)] = NEIGHBOURS,
        every: Annotated[int, at_least(1)] = 20,
    ) -> None:
        super().__init__(weight)
        self.k, self.every = k, every
        self.calls = 0
        self.neighbours = torch.empty(0, 0, dtype=torch.long)  # (N, k) strokes nearest to each

    def forward(self, painting: PaintedView) -> Tensor:
        strokes = painting.strokes.map(at_least_single)
        shape = shape_of(strokes)
        if self.calls % self.every == 0 or len(self.neighbours) != len(strokes):
            self.neighbours = neighbours_of(strokes, shape, self.k)
        self.calls += 1
        direction = direction_of(shape)
        difference = direction[:, None] - direction[self.neighbours.to(direction.device)]  # (N, k, 2)
        return difference.square().sum() / max(self.neighbours.numel(), 1)

    def get_extra_state(self) -> dict[str, Any]:
        return {"calls": self.calls, "neighbours": self.neighbours}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        self.calls, self.neighbours = state["calls"], state["neighbours"]


@register("loss", "brushwork")
class BrushworkTransfer(Loss):
    """Optimal transport of lengths, widths, curvatures and directional coherence to those of a painting's catalogue.

    Brushwork transfer: the sum over these four measures, which `task=analyse` reports (``strokes.measures``), of the
    squared 2-Wasserstein distance between their distributions in both paintings, each in units of its variance in the
    reference: 0 for the same distributions, and about 1 for a measure that is off by one standard deviation. The
    numbers of strokes need not be equal. It looks at all strokes at every step, also where a step looks at a part of
    the canvas. Strokes too faint or too thin to be seen do not count and have no gradient. ``style.brushwork`` adds
    this loss and starts from strokes drawn accordingly.

    Args:
        option: what sets the catalogue, for messages.
        weight: factor in the sum of losses. For a reference of long, nearly straight strokes, ``style.brushwork`` with
            the default brought distances of 1.4 (length), 0.3 (width), 1.8 (curvature) and 0.7 (coherence) standard
            deviations down to 0.06 and less; the PSNR was 0.9 dB lower.
        catalogue: catalogue.h5 of the painting whose brushwork is wanted; null: none is, and the loss is 0.
    """

    looks_at = "strokes"

    def __init__(
        self, option: str = "loss.brushwork.catalogue", *, weight: float = 0.001, catalogue: str | None = None
    ) -> None:
        super().__init__(weight)
        self.reference = None if catalogue is None else load_brushwork(Path(catalogue), option)

    def forward(self, painting: PaintedView) -> Tensor:
        if self.reference is None:
            return painting.strokes.width.sum() * 0
        strokes = painting.strokes.map(at_least_single)
        self.reference = self.reference.to(strokes.width)
        size = (painting.whole_target.shape[1], painting.whole_target.shape[2])
        return distances(strokes, size, self.reference).sum()
