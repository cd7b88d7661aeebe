"""Keep strokes inside a region, so that nothing outside it changes."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor, nn

from brushexp.contracts.families import ExportJob, reach_of
from brushexp.contracts.kernels import TILE
from brushexp.contracts.strokes import FIELDS, Catalogue, Strokes, curve_of, half_width_of, point_at

SAMPLES = 33  # points per curve at which the distance to the outside is looked up
SLACK = 0.75  # pixels; a point is at most 0.71 from the centre of its pixel, and the rest allows for rounding
SLACK_OF_KEPT = 0.73  # pixels; admits strokes that lay inside until storage rounded them
SHAPE = ("position", "scale", "start", "control", "end", "width", "softness", "widening")


class Fence(nn.Module):
    """Module that lets only strokes wholly inside a region change, and keeps them inside; others stay bit-identical.

    The height of lit paint is relative to the median width of all strokes. Strokes wider than the median therefore stay
    wider, narrower strokes stay narrower, and the median stays bit-identical.

    The region is given in pixels of the painting; one unit of the strokes' coordinates is ``zoom`` such pixels.
    """

    room: Tensor
    inner: Tensor  # (N,) bool: strokes that may change

    def __init__(self, strokes: Strokes, room: Tensor, edge: float, zoom: float = 1.0) -> None:
        super().__init__()
        self.zoom = zoom
        self.first = Catalogue(strokes, {})  # bit-identical
        self.register_buffer("room", room, persistent=False)
        self.edge = edge
        self.register_buffer("inner", self.holds(strokes), persistent=False)

    @torch.no_grad()
    def forward(self, strokes: Strokes, before: Strokes | None = None, rows: Tensor | None = None) -> Strokes:
        """Restrict strokes (those with indices ``rows``, or all) to the changes that the region permits.

        A stroke that leaves the region is moved back to its shape in ``before``, the strokes before the step, or to its
        shape in the painting if ``before`` is None.
        """
        first, inner = self.first(), self.inner
        typical = half_width_of(first).median()
        if rows is not None:
            first, inner = first[rows], inner[rows]
        strokes = replace(strokes, scale=first.scale)
        crosses = (half_width_of(strokes) - typical).sign() != (half_width_of(first) - typical).sign()
        strokes = replace(strokes, width=torch.where(crosses, first.width, strokes.width))
        if before is None:
            strokes = choose(self.holds(strokes, SLACK_OF_KEPT), strokes, first, SHAPE)
        else:
            strokes = choose(self.holds(strokes), strokes, before, SHAPE)
        return choose(inner, strokes, first, FIELDS)

    @torch.no_grad()
    def holds(self, strokes: Strokes, slack: float = SLACK) -> Tensor:
        """Mark the strokes (N,) wholly inside the region, soft edges included; areas off the canvas count as inside."""
        strokes = strokes.moved(zoom=self.zoom)
        t = torch.linspace(0, 1, SAMPLES).to(strokes.position)
        points = point_at(curve_of(strokes)[:, None], t)  # (N, SAMPLES, 2)
        apart = (points[:, 1:] - points[:, :-1]).square().sum(2).sqrt().amax(1)
        size = torch.tensor(self.room.shape, device=points.device)
        x, y = (points[..., k].nan_to_num().long().clamp_min(0).minimum(size[1 - k] - 1) for k in (0, 1))
        return self.room[y, x].amin(1) - slack - apart / 2 > reach_of(strokes, self.edge)


def choose(which: Tensor, strokes: Strokes, others: Strokes, names: Iterable[str]) -> Strokes:
    """Take the named fields from ``strokes`` where ``which`` (N,) is true, and from ``others`` elsewhere."""
    pairs = {name: (getattr(strokes, name), getattr(others, name)) for name in names}
    return replace(
        strokes, **{name: torch.where(which.reshape(-1, *[1] * (a.ndim - 1)), a, b) for name, (a, b) in pairs.items()}
    )


def room_in(mask: Tensor, job: ExportJob) -> Tensor:
    """Compute how far paint may extend from each pixel of a ``mask`` (H, W), bool, in pixels (H, W).

    This is the distance to the nearest pixel that can influence a pixel outside the mask: through the light, whose
    slopes span one pixel to each side; through the paper; or through its tile, whose blend stops once all pixels are
    opaque.
    """
    from scipy.ndimage import distance_transform_edt, maximum_filter  # noqa: PLC0415  (--help does not need it)

    margin = TILE - 1 + (job.light.depth > 0) + (0 if job.paper is None else job.paper.margin(job.size))
    outside = maximum_filter(~mask.numpy(), 2 * margin + 1)
    distance = distance_transform_edt(~outside) if outside.any() else np.full(outside.shape, np.inf)
    return torch.from_numpy(distance).float()
