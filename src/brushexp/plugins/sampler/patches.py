"""Partial updates: a step moves the strokes of one place and looks at a patch around them."""

import math
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any

import torch
from torch import Tensor

from brushexp.bounds import at_least, one_of
from brushexp.pictures.region import Region
from brushexp.plugins.sampler.base import Sampler, View
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes

SAMPLED_POINTS = 200  # random points by which it is estimated how many strokes are active at one


@register("sampler", "patches")
@dataclass(kw_only=True)
class Patches(Sampler):
    """A few hundred strokes of one place per step, with a ring around them that stays as it is (thesis 2020, 6.3).

    Time and memory of a step do not depend on the size of the canvas. A patch larger than the canvas is the canvas; at
    most all strokes are active.

    Args:
        n_active: strokes that a step moves, at most.
        n_ring: the nearest ones around those; they are drawn and stay. 0 for none.
        patch: side in pixels of the square that is painted and compared. Strokes whose middle lies outside it are
            not moved.
        steps_per_patch: steps in a row at one place.
        coverage: fair: in each round every stroke is active at exactly one place; random: the nearest strokes to a
            random point (the thesis's), which visits the strokes at the border less often.
    """

    n_active: Annotated[int, at_least(1)] = 256
    n_ring: Annotated[int, at_least(0)] = 128
    patch: Annotated[int, at_least(1)] = 320
    steps_per_patch: Annotated[int, at_least(1)] = 5
    coverage: Annotated[str, one_of("fair", "random")] = "fair"
    _round: Tensor = field(default_factory=partial(torch.empty, 0, dtype=torch.long), init=False)  # (N,) places now
    _turn: int = field(default=0, init=False)  # place whose turn it is
    _point: Tensor | None = field(default=None, init=False)  # in the middle of the patch
    cost, moves = "that of one patch, however large the canvas is", "those of one place"

    def __call__(self, strokes: Strokes, size: tuple[int, int], step: int, generator: torch.Generator) -> View:
        if not len(strokes):
            return View(Region(0, 0, *size))
        position = on_canvas(strokes.position, size)
        begins = step % self.steps_per_patch == 0
        if self.coverage == "fair":
            active = self._turn_of(position, generator, begins)
            low, high = position[active].aminmax(dim=0)
            region = self._patch_at(0.5 * (low + high), size)
        else:
            if begins or self._point is None:
                point = torch.rand(2, generator=generator) * torch.tensor([size[1], size[0]])
                if not inside(position, self._patch_at(point, size)).any():  # the next stroke is farther away
                    point = position[(position - point.to(position)).square().sum(1).argmin()].cpu()
                self._point = point
            low = high = self._point.to(position)
            active, region = self._active_at(low, position, size), self._patch_at(low, size)
        others = torch.ones(len(position), dtype=torch.bool, device=position.device)
        others[active] = False
        return View(region, active, nearest_to_box(position, others, low, high, self.n_ring))

    def steps_per_round(self, strokes: Strokes, size: tuple[int, int]) -> int:
        if not len(strokes):
            return 1
        position, generator = on_canvas(strokes.position, size).cpu(), torch.Generator().manual_seed(0)
        if self.coverage == "fair":
            return int(places(position, self.n_active, self.patch, generator).max()) + 1
        points = torch.rand(SAMPLED_POINTS, 2, generator=generator) * torch.tensor([size[1], size[0]])
        moved = [len(self._active_at(point, position, size)) for point in points]
        return max(1, round(len(strokes) * SAMPLED_POINTS / sum(moved)))

    def state_dict(self) -> dict[str, Any]:
        return {"round": self._round, "turn": self._turn, "point": self._point}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._round, self._turn, self._point = state["round"], state["turn"], state["point"]

    def _turn_of(self, position: Tensor, generator: torch.Generator, begins: bool) -> Tensor:
        """Strokes of the present place; when the last place of a round is done, or N has changed, a round begins."""
        self._turn += begins
        if len(self._round) != len(position) or self._turn > int(self._round.max()):
            self._round = places(position.cpu(), self.n_active, self.patch, generator)
            self._turn = 0
        return (self._round == self._turn).nonzero()[:, 0].to(position.device)

    def _active_at(self, point: Tensor, position: Tensor, size: tuple[int, int]) -> Tensor:
        """The strokes nearest to a point, of those in the patch around it."""
        return nearest_to_box(position, inside(position, self._patch_at(point, size)), point, point, self.n_active)

    def _patch_at(self, point: Tensor, size: tuple[int, int]) -> Region:
        """The patch around a point, shifted so that it lies on the canvas."""
        height, width = (min(self.patch, side) for side in size)
        left, top = (int(x) for x in point.tolist())
        top = min(max(top - height // 2, 0), size[0] - height)
        left = min(max(left - width // 2, 0), size[1] - width)
        return Region(top, left, height, width)


def places(position: Tensor, most: int, side: float, generator: torch.Generator) -> Tensor:
    """Number (N,) of each stroke's place: places of at most ``most`` strokes, not wider or higher than ``side`` pixels.

    The strokes, at ``position`` (N, 2), are cut in two across the longer side of their box, again and again, in
    proportion to the numbers of places on either side; these are drawn, so that the borders differ from round to round.
    Places are numbered in random order.
    """
    found, waiting = [], [(torch.arange(len(position)), math.ceil(len(position) / most))]
    while waiting:
        group, pieces = waiting.pop()
        low, high = position[group].aminmax(dim=0)
        extent = high - low
        if pieces == 1 and bool((extent <= side).all()):
            found.append(group)
            continue
        pieces = max(pieces, 2)
        least, largest = math.ceil(pieces / 3), pieces - math.ceil(pieces / 3)
        first = int(torch.randint(least, largest + 1, (), generator=generator))
        order = position[group, int(extent.argmax())].argsort(stable=True)
        cut = round(len(group) * first / pieces)
        waiting += [(group[order[:cut]], first), (group[order[cut:]], pieces - first)]
    number = torch.empty(len(position), dtype=torch.long)
    for turn, which in enumerate(torch.randperm(len(found), generator=generator).tolist()):
        number[found[which]] = turn
    return number


def nearest_to_box(position: Tensor, among: Tensor, low: Tensor, high: Tensor, n: int) -> Tensor:
    """Numbers, ascending, of the ``n`` strokes nearest to a box, or fewer if ``among`` (N,) is true for fewer.

    The corners ``low`` and ``high`` (2,) of the box may be the same point.
    """
    outside = (low - position).clamp_min(0) + (position - high).clamp_min(0)
    distance = torch.where(among, outside.square().sum(1), torch.inf)
    return distance.topk(min(n, int(among.sum())), largest=False).indices.sort().values


def on_canvas(position: Tensor, size: tuple[int, int]) -> Tensor:
    """Positions (N, 2), those beyond a canvas of ``size`` (H, W) moved to its edge."""
    return torch.minimum(position.clamp_min(0), position.new_tensor([size[1], size[0]]))


def inside(position: Tensor, region: Region) -> Tensor:
    """Which positions (N, 2) lie in a region."""
    low = position.new_tensor([region.left, region.top])
    high = low + position.new_tensor([region.width, region.height])
    return ((position >= low) & (position <= high)).all(1)
