"""The record of a finished painting: its strokes, and all that is needed to draw them again."""

from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.strokes.catalogue import Strokes, check_strokes
from brushexp.system.reading import check_yaml, in_short

LARGEST_SIDE = 1_000_000  # pixels of a canvas


@dataclass(frozen=True)
class Saved:
    """A finished catalogue and where it came from, as a file stores it."""

    strokes: Strokes  # N strokes, float32
    depth: Tensor  # (N,) int32 ranks, a permutation of 0 to N - 1; 0 is the bottom stroke
    size: tuple[int, int]  # height and width of the canvas, pixels
    background: Tensor  # (3,) RGB of the bare canvas, in [0, 1]
    renderer: str  # name of the renderer plugin
    renderer_hash: str = ""  # of its checkpoint; empty when it has none
    seed: int = 0  # of the run
    config: str = ""  # settings of the run as YAML: text from a file, of which only plugins may be built

    def laid(self, strokes: Strokes, front_to_back: Tensor, background: Tensor) -> Self:
        """Record other strokes of the same run, in the order ``front_to_back`` (N,), the uppermost first."""
        depth = (len(strokes) - 1 - front_to_back.argsort()).int().cpu()
        return replace(self, strokes=strokes.map(Tensor.cpu), depth=depth, background=background.cpu())

    def check(self) -> Self:
        """Return the record; a UserError says what is wrong with it."""
        check_strokes(self.strokes)
        count, ranks = len(self.strokes), self.depth.detach().cpu().sort().values
        if tuple(self.depth.shape) != (count,) or not torch.equal(ranks, torch.arange(count, dtype=ranks.dtype)):
            raise UserError(f"depth is not an order of the strokes; each rank from 0 to {count - 1} is needed once")
        if not all(1 <= side <= LARGEST_SIDE for side in self.size):
            raise UserError(
                f"the canvas is {self.size[0]} x {self.size[1]} pixels; each side must lie in [1, {LARGEST_SIDE}]"
            )
        background = self.background
        if tuple(background.shape) != (3,) or not bool(((background >= 0) & (background <= 1)).all()):
            raise UserError(f"background is {in_short(background.tolist())}; three numbers in [0, 1] are needed")
        if not -(2**63) <= self.seed < 2**64:
            raise UserError(f"seed is {self.seed}; a number of 64 bits is needed")
        try:
            check_yaml(self.config)
        except UserError as error:
            raise UserError(f"config is {error}") from error
        return self
