"""What every sampler receives and returns."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch


@dataclass(frozen=True)
class Region:
    """A rectangle of the canvas, pixels."""

    top: int
    left: int
    height: int
    width: int


class Sampler(ABC):
    """Decides which part of the canvas a gradient step renders and compares."""

    @abstractmethod
    def __call__(self, size: tuple[int, int], step: int, generator: torch.Generator) -> Region:
        """The region of a canvas of ``size`` (H, W) for ``step``, wholly inside it."""
