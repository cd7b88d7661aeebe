"""Compare the whole canvas in every step."""

import torch

from brushexp.pictures.region import Region
from brushexp.plugins.sampler.base import Sampler, View
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes


@register("sampler", "whole")
class Whole(Sampler):
    """Compares the whole canvas and moves all strokes in every step."""

    cost, moves = "1", "all strokes"

    def __call__(self, strokes: Strokes, size: tuple[int, int], step: int, generator: torch.Generator) -> View:
        return View(Region(0, 0, *size))
