"""What every sampler receives and returns."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from brushexp.pictures.region import Region
from brushexp.strokes.catalogue import Strokes


@dataclass(frozen=True)
class View:
    """What one step looks at.

    Attributes:
        region: the part of the canvas that it renders and compares.
        active: (A,) int64 numbers of the strokes that it moves, without repetition; None for all of them.
        ring: (R,) int64 numbers of strokes around those, which are drawn and stay as they are; None for none.
    """

    region: Region
    active: Tensor | None = None
    ring: Tensor | None = None


class Sampler(ABC):
    """Decides which strokes a gradient step moves, and which part of the canvas it renders and compares."""

    @abstractmethod
    def __call__(self, strokes: Strokes, size: tuple[int, int], step: int, generator: torch.Generator) -> View:
        """Where ``step`` (from 0) looks on a canvas of ``size`` (H, W); the region lies wholly inside it.

        Args:
            strokes: the N strokes as they are now, without gradient.
            size: of the canvas.
            step: number of the step.
            generator: of everything random.
        """

    def steps_per_round(self, strokes: Strokes, size: tuple[int, int]) -> int:
        """Steps in which each of the strokes, on a canvas of ``size`` (H, W), is moved about once."""
        return 1

    def seen(self, view: View, image: Tensor, target: Tensor) -> None:  # noqa: B027
        """Look at what a step saw; called after each one.

        Args:
            view: where it looked.
            image: (3, h, w) the region before the step, without gradient.
            target: (3, h, w) what it should look like.
        """

    def state_dict(self) -> dict[str, Any]:
        """What an interrupted run needs to go on as if nothing had happened: tensors and numbers."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:  # noqa: B027
        """Take over what `state_dict` gave."""
