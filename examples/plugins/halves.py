"""Sampler plugin in a single file: ``sampler=halves``."""

import torch

from brushexp.contracts import register
from brushexp.contracts.families import Sampler, View
from brushexp.contracts.pictures import Region
from brushexp.contracts.strokes import Strokes


@register("sampler", "halves")
class Halves(Sampler):
    """Alternates between the left and the right half of the canvas: each step moves only the strokes in one half."""

    cost, moves = "half", "those in one half of the canvas"

    def __call__(self, strokes: Strokes, size: tuple[int, int], step: int, generator: torch.Generator) -> View:
        height, width = size
        middle = max(1, width // 2)
        is_left = step % 2 == 0 or width == 1
        region = Region(0, 0, height, middle) if is_left else Region(0, middle, height, width - middle)
        inside = (strokes.position[:, 0] < middle) == is_left
        return View(region, inside.nonzero()[:, 0], (~inside).nonzero()[:, 0])

    def steps_per_round(self, strokes: Strokes, size: tuple[int, int]) -> int:
        return 2
