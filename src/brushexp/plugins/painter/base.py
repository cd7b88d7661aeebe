"""Base class for painters, which approximate a target with strokes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from brushexp.strokes.catalogue import Strokes


@dataclass(frozen=True)
class PaintRequest:
    """The input of a painter: the target, the number of strokes and the settings of the painting."""

    target: Tensor  # (3, H, W) in [0, 1], display-referred RGB
    n: int  # largest number of strokes, 1 to H * W
    background: Tensor  # (3,) colour of the bare canvas
    draw: Callable[[Strokes], Tensor]  # strokes, bottom first -> picture (3, H, W), differentiable in their fields
    generator: torch.Generator  # source of all randomness

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the canvas in pixels."""
        return self.target.shape[1], self.target.shape[2]

    @property
    def pitch(self) -> float:
        """Mean distance between strokes, in pixels."""
        return float((self.target[0].numel() / self.n) ** 0.5)


class PaintState:
    """The strokes so far, bottom stroke first, after ``step`` of ``steps`` steps.

    A step may be a stroke or an iteration. ``steps`` may change between states; in the last state it equals ``step``.
    """

    def __init__(self, strokes: Strokes, step: int, steps: int) -> None:
        self.strokes, self.step, self.steps = strokes, step, steps

    def to(self, device: Any) -> PaintState:
        """Move the strokes to a device, as Lightning does with batches."""
        return PaintState(self.strokes.map(lambda value: value.to(device)), self.step, self.steps)


class Painter(ABC):
    """Paints a picture, starting from the bare canvas.

    The program displays, films, measures and saves the states that the painter yields. Since it can end a run only
    between two states (for Ctrl-C, ``seconds=``, ``psnr=`` or a signal), a painter should yield a state after every few
    per cent of its work.

    >>> from brushexp.strokes.prior import sample_prior
    >>> class Careless(Painter):
    ...     '''The same stroke again and again.'''
    ...     def __call__(self, request):
    ...         for k in range(1, request.n + 1):
    ...             yield PaintState(sample_prior(1)[torch.zeros(k, dtype=torch.long)], k, request.n)
    >>> request = PaintRequest(torch.rand(3, 20, 30), 4, torch.ones(3), lambda strokes: ..., torch.Generator())
    >>> [len(state.strokes) for state in Careless()(request)]
    [1, 2, 3, 4]
    """

    kind: ClassVar[str] = "not stated"  # method in two or three words
    author: ClassVar[str] = ""  # authors of the reimplemented paper or program, for the leaderboard
    differentiates: ClassVar[bool] = False  # whether it uses gradients of pictures, whose code is then compiled

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"decides by": cls.kind}

    @abstractmethod
    def __call__(self, request: PaintRequest) -> Iterator[PaintState]:
        """Yield states with at most ``request.n`` strokes, whose fields are within the ranges in ``FIELDS``."""
