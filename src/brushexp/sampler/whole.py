"""The whole canvas at every step."""

import torch

from brushexp.registry import register
from brushexp.sampler.base import Region, Sampler


@register("sampler", "whole")
class Whole(Sampler):
    """The whole canvas at every step."""

    def __init__(self) -> None: ...

    def __call__(self, size: tuple[int, int], step: int, generator: torch.Generator) -> Region:
        return Region(0, 0, *size)
