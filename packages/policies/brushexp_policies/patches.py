"""Partial updates: each step moves the strokes of one group and compares a patch around them."""

import math
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Any

import torch
from torch import Tensor

from brushexp.contracts import at_least, one_of, register
from brushexp.contracts.families import Sampler, View
from brushexp.contracts.pictures import Region
from brushexp.contracts.strokes import Strokes

SAMPLED_POINTS = 200  # random points used to estimate the mean number of strokes active at a point


@register("sampler", "patches")
@dataclass(kw_only=True)
class Patches(Sampler):
    """Move a few hundred neighbouring strokes per step, surrounded by a ring of fixed strokes (thesis 2020, 6.3).

    The time and memory that a step needs do not depend on the canvas size.

    Args:
        n_active: maximum number of strokes that a step moves.
        n_ring: number of surrounding strokes, the nearest ones, that are drawn but not moved.
        patch: side in pixels of the square that a step paints and compares; strokes centred outside do not move.
        steps_per_patch: number of consecutive steps on one patch.
        coverage: choice of patches: fair makes every stroke active in exactly one patch per round; random takes the
            strokes nearest to a random point, as the thesis does, and so visits strokes at the border less often.
    """

    n_active: Annotated[int, at_least(1)] = 256
    n_ring: Annotated[int, at_least(0)] = 128
    patch: Annotated[int, at_least(1)] = 320
    steps_per_patch: Annotated[int, at_least(1)] = 5
    coverage: Annotated[str, one_of("fair", "random")] = "fair"
    _round: Tensor = field(default_factory=partial(torch.empty, 0, dtype=torch.long), init=False)  # (N,) places
    _turn: int = field(default=0, init=False)  # number of the current place
    _point: Tensor | None = field(default=None, init=False)  # centre of the patch
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
                if not inside(position, self._patch_at(point, size)).any():  # use the nearest stroke
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
        """Return the next group's strokes; begin a new round after the last group, or if the stroke count changed."""
        self._turn += begins
        if len(self._round) != len(position) or self._turn > int(self._round.max()):
            self._round = places(position.cpu(), self.n_active, self.patch, generator)
            self._turn = 0
        return (self._round == self._turn).nonzero()[:, 0].to(position.device)

    def _active_at(self, point: Tensor, position: Tensor, size: tuple[int, int]) -> Tensor:
        return nearest_to_box(position, inside(position, self._patch_at(point, size)), point, point, self.n_active)

    def _patch_at(self, point: Tensor, size: tuple[int, int]) -> Region:
        height, width = (min(self.patch, side) for side in size)
        left, top = (int(x) for x in point.tolist())
        top = min(max(top - height // 2, 0), size[0] - height)
        left = min(max(left - width // 2, 0), size[1] - width)
        return Region(top, left, height, width)


def places(position: Tensor, most: int, side: float, generator: torch.Generator) -> Tensor:
    """Divide strokes into groups of at most ``most`` strokes and ``side`` pixels; return group numbers (N,).

    The strokes, at ``position`` (N, 2), are repeatedly split in two across the longer side of their bounding box, in
    random proportions, so that the borders differ from round to round. The groups are numbered in random order.
    """
    groups, queue = [], [(torch.arange(len(position)), math.ceil(len(position) / most))]
    while queue:
        group, pieces = queue.pop()
        low, high = position[group].aminmax(dim=0)
        extent = high - low
        if pieces == 1 and bool((extent <= side).all()):
            groups.append(group)
            continue
        pieces = max(pieces, 2)
        least, largest = math.ceil(pieces / 3), pieces - math.ceil(pieces / 3)
        first = int(torch.randint(least, largest + 1, (), generator=generator))
        order = position[group, int(extent.argmax())].argsort(stable=True)
        cut = round(len(group) * first / pieces)
        queue += [(group[order[:cut]], first), (group[order[cut:]], pieces - first)]
    number = torch.empty(len(position), dtype=torch.long)
    for turn, which in enumerate(torch.randperm(len(groups), generator=generator).tolist()):
        number[groups[which]] = turn
    return number


def nearest_to_box(position: Tensor, among: Tensor, low: Tensor, high: Tensor, n: int) -> Tensor:
    """Of the strokes in the mask ``among`` (N,), return the ``n`` nearest to a box from ``low`` to ``high``, sorted."""
    outside = (low - position).clamp_min(0) + (position - high).clamp_min(0)
    distance = torch.where(among, outside.square().sum(1), torch.inf)
    return distance.topk(min(n, int(among.sum())), largest=False).indices.sort().values


def on_canvas(position: Tensor, size: tuple[int, int]) -> Tensor:
    """Clamp positions (N, 2) to a canvas of ``size`` (H, W)."""
    return torch.minimum(position.clamp_min(0), position.new_tensor([size[1], size[0]]))


def inside(position: Tensor, region: Region) -> Tensor:
    """Mark which positions (N, 2) are inside a region."""
    low = position.new_tensor([region.left, region.top])
    high = low + position.new_tensor([region.width, region.height])
    return ((position >= low) & (position <= high)).all(1)
