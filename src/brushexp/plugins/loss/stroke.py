"""Losses that look at the strokes, not at the pixels."""

from torch import Tensor

from brushexp.plugins.loss.base import Loss, Painting, at_least_single
from brushexp.registry import register
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

    def forward(self, painting: Painting) -> Tensor:
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

    def forward(self, painting: Painting) -> Tensor:
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
