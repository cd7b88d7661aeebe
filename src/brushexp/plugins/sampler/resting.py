"""Places that hardly change any more are visited less often."""

from dataclasses import astuple
from typing import Annotated, Any

import torch
from torch import Tensor, nn

from brushexp.bounds import at_least, between
from brushexp.compositing.layers import EDGE, SPREAD
from brushexp.pictures.region import Region
from brushexp.plugins.sampler.base import Sampler, View
from brushexp.registry import register
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Strokes

CELL_PIXELS = 8  # side; the ring around the strokes that move is found on a grid as fine as the tiles of the blend
LAST_VISIT_WEIGHT = 0.5  # in the moving average of how fast a block's error falls


@register("sampler", "resting")
class Resting(Sampler):
    """The whole canvas every few steps, and between them only the strokes of blocks that are not yet good.

    A block of pixels falls asleep when its error has all but stopped falling, and it is one of the best, which together
    hold only a small share of the squared error: what they could still gain cannot be seen in the PSNR. Strokes whose
    middle lies in a block that is awake are moved; all that overlap them are drawn, so that they feel what they feel in
    the whole. When the learning rate falls, errors fall again, and blocks wake up.

    Args:
        every: steps from one look at the whole canvas to the next, at least 2.
        share: of the squared error that sleeping blocks may have together, 0 to 1; 0 lets nothing sleep.
        fall: a block falls asleep when its error falls by less than this fraction from one look to the next.
        block: side of the blocks in pixels.
        max_awake: while more than this fraction of the strokes is awake, every step looks at the whole canvas.
    """

    cost, moves = (
        "1 every few steps, less between them",
        "those of blocks whose error still falls, and all now and then",
    )

    def __init__(
        self,
        *,
        every: Annotated[int, at_least(2)] = 4,
        share: Annotated[float, between(0, 1)] = 0.05,
        fall: Annotated[float, at_least(0)] = 0.02,
        block: Annotated[int, at_least(1)] = 32,
        max_awake: Annotated[float, between(0, 1)] = 0.75,
    ) -> None:
        self.every = every
        self.share = share
        self.fall = fall
        self.block = block
        self.max_awake = max_awake
        self._errors = torch.empty(0, 0)  # (rows, columns) squared error of each block at the last look at all
        self._falling = torch.empty(0, 0)  # how fast they fall
        self._view: View | None = None  # until the next look at all
        self._n = 0  # strokes that it was made for

    def __call__(self, strokes: Strokes, size: tuple[int, int], step: int, generator: torch.Generator) -> View:
        whole = View(Region(0, 0, *size))
        if step % self.every == 0:
            self._view = None
            return whole
        if step % self.every == 1:
            self._view, self._n = self._awake(strokes, size), len(strokes)
        return whole if self._view is None or self._n != len(strokes) else self._view

    def seen(self, view: View, image: Tensor, target: Tensor) -> None:
        if view.active is not None:
            return
        errors = _by_block((image - target).square().sum(0), self.block)
        if errors.shape == self._errors.shape:
            now = 1 - errors / self._errors.clamp_min(torch.finfo(errors.dtype).tiny)
            self._falling = self._falling.lerp(now.clamp(-1, 1), LAST_VISIT_WEIGHT)
        else:
            self._falling = torch.ones_like(errors)
        self._errors = errors

    def state_dict(self) -> dict[str, Any]:
        view = self._view
        return {
            "errors": self._errors,
            "falling": self._falling,
            "strokes": None if view is None else (view.active, view.ring),
            "region": None if view is None else astuple(view.region),
            "n": self._n,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._errors, self._falling, self._n = state["errors"], state["falling"], state["n"]
        self._view = None if state["region"] is None else View(Region(*state["region"]), *state["strokes"])

    def _awake(self, strokes: Strokes, size: tuple[int, int]) -> View | None:
        """The strokes that move until the next look at all, and those around them; None for all."""
        if not self._errors.numel() or not len(strokes):
            return None
        asleep = _least(self._errors, self.share) & (self._falling.abs() < self.fall)
        last = torch.tensor([asleep.shape[1] - 1, asleep.shape[0] - 1], device=asleep.device)
        column, row = torch.minimum((strokes.position / self.block).long().clamp_min(0), last).unbind(1)
        active = ~asleep[row, column]
        if not active.any() or active.float().mean() > self.max_awake:
            return None
        ring = _overlapping(strokes, active, size) & ~active
        return View(Region(0, 0, *size), active.nonzero()[:, 0], ring.nonzero()[:, 0])


def _by_block(values: Tensor, side: int) -> Tensor:
    """Sums (rows, columns) of values (H, W) over blocks of ``side`` pixels; those at the far edges are smaller."""
    height, width = values.shape
    padded = nn.functional.pad(values, (0, -width % side, 0, -height % side))
    return padded.view(padded.shape[0] // side, side, -1, side).sum((1, 3))


def _least(errors: Tensor, share: float) -> Tensor:
    """The blocks of least error, bool, as many as hold at most ``share`` of the sum together."""
    order = errors.flatten().argsort()
    within = errors.flatten()[order].cumsum(0) <= share * errors.sum()
    return torch.zeros_like(within).scatter(0, order, within).view(errors.shape)


def _overlapping(strokes: Strokes, active: Tensor, size: tuple[int, int]) -> Tensor:
    """Which strokes (N,), bool, lie in a cell with one that is active (N,); a stroke lies in all cells of its box."""
    curve, reach = curve_of(strokes), SPREAD * half_width_of(strokes)[:, None] + EDGE
    cells = torch.tensor([-(-size[1] // CELL_PIXELS), -(-size[0] // CELL_PIXELS)], device=active.device)
    low = torch.minimum(((curve.amin(1) - reach) / CELL_PIXELS).floor().long().clamp_min(0), cells)
    high = torch.minimum(((curve.amax(1) + reach) / CELL_PIXELS).floor().long().clamp_min(-1) + 1, cells)
    # Each box adds 1 at two of its corners and -1 at the others; sums over rows and columns count the boxes of a cell.
    counts = torch.zeros(int(cells[1]) + 1, int(cells[0]) + 1, dtype=torch.int32, device=active.device)
    some_low, some_high = low[active], high[active]
    for x, y, sign in (
        (some_low, some_low, 1),
        (some_high, some_low, -1),
        (some_low, some_high, -1),
        (some_high, some_high, 1),
    ):
        one = torch.tensor(sign, dtype=torch.int32, device=active.device)
        counts.index_put_((y[:, 1], x[:, 0]), one, accumulate=True)
    wanted = counts.cumsum(0).cumsum(1)[:-1, :-1] > 0
    sums = nn.functional.pad(wanted.int().cumsum(0).cumsum(1), (1, 0, 1, 0))
    (left, top), (right, bottom) = low.unbind(1), high.unbind(1)
    return sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left] > 0
