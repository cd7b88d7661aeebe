"""Penalise the divergence of the distribution of the strokes' bends from the distribution for valid strokes."""

from torch import Tensor

from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.registry import register
from brushexp.strokes.prior import SPREAD, bend_of
from brushexp.system.precision import at_least_single

SHRINK = 1e-3  # fraction of the prior's covariance that is mixed into the measured covariance


@register("loss", "kl")
class KullbackLeibler(Loss):
    """Kullback-Leibler divergence of the strokes' bends from those of valid strokes (thesis 2020, eq. 6.26 to 6.37).

    The position of each stroke's control point is measured from the midpoint of s and e, along and across s - e, in
    units of |s - e|. It has the mean mu and the covariance S over all strokes; the loss is KL(N(mu, S) || N(0, T)) with
    T = diag(1/200, 1/25). Unlike in the source, S is (1 - 1/1000) of the measured covariance plus 1/1000 of T, so that
    the loss and its gradient are finite for a single stroke or equal strokes; the minimum stays at mu = 0 and S = T. In
    the source's formula, S and T are swapped.

    Args:
        weight: factor in the sum of losses. For 500 strongly bent strokes, the divergence ended at 51 with ``mse``
            alone, at 0.2 with this loss at its default weight (costing less than 0.1 dB), and at 0.001 with a weight of
            0.001 (0.1 dB).
    """

    weight = 0.0001
    cost = "0.6 x mse"
    looks_at = "strokes"

    def forward(self, view: PaintedView) -> Tensor:
        if not len(view.strokes):
            return view.strokes.control.sum()  # 0, but differentiable
        bend = bend_of(view.strokes.map(at_least_single))
        x, y = (bend / bend.new_tensor(SPREAD).sqrt()).unbind(1)  # T is the identity in these units
        mean_x, mean_y = x.mean(), y.mean()
        x, y = x - mean_x, y - mean_y
        s_xx, s_yy = (SHRINK + (1 - SHRINK) * z.square().mean() for z in (x, y))
        slope = (1 - SHRINK) * (x * y).mean() / s_xx
        # |S| / s_xx as a sum of squares, because s_xx s_yy - s_xy^2 may round to a negative number.
        rest = SHRINK * (1 + slope.square()) + (1 - SHRINK) * (y - slope * x).square().mean()
        return 0.5 * (s_xx + s_yy - 2 - s_xx.log() - rest.log() + mean_x.square() + mean_y.square())
