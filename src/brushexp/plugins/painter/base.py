"""The contract of painters."""

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
    """The order that a painter carries out."""

    target: Tensor  # (3, H, W) in [0, 1], display-referred RGB
    n: int  # strokes that the painting may have, 1 to H * W
    background: Tensor  # (3,) colour of the bare canvas
    draw: Callable[[Strokes], Tensor]  # strokes, the lowest first -> picture (3, H, W); differentiable in their fields
    generator: torch.Generator  # everything random comes from it

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the canvas in pixels."""
        return self.target.shape[1], self.target.shape[2]

    @property
    def pitch(self) -> float:
        """Mean distance between strokes in pixels."""
        return float((self.target[0].numel() / self.n) ** 0.5)


class PaintState:
    """The strokes so far, the lowest first, after ``step`` of ``steps`` (of strokes, or iterations).

    ``steps`` may change on the way; in the last state it is ``step``.
    """

    def __init__(self, strokes: Strokes, step: int, steps: int) -> None:
        self.strokes, self.step, self.steps = strokes, step, steps

    def to(self, device: Any) -> PaintState:
        """Move the strokes to a device, as Lightning does with every batch."""
        return PaintState(self.strokes.map(lambda value: value.to(device)), self.step, self.steps)


class Painter(ABC):
    """Paints a picture, from the bare canvas to the last stroke.

    The program shows, films, measures and saves its states, and ends the run only between two of them (by Ctrl-C,
    ``seconds=``, ``psnr=`` or a signal). So yield a state every few hundredths of the work.

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

    kind: ClassVar[str] = "not stated"  # how it decides, in two or three words
    author: ClassVar[str] = ""  # of the paper or program that it re-implements, whom the leaderboard names
    differentiates: ClassVar[bool] = False  # whether it asks for gradients of pictures; what computes them is compiled

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"decides by": cls.kind}

    @abstractmethod
    def __call__(self, request: PaintRequest) -> Iterator[PaintState]:
        """Paint, with ``request.n`` strokes at most, all of them within the ranges of ``FIELDS``."""
