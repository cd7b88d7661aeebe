"""What every painter receives and yields."""

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
    """What a painter is asked for."""

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
    """Where a painting stands after ``step`` of ``steps``; the painter says what a step is (a stroke, an iteration).

    ``steps`` may change on the way; in the last state it is ``step``. ``strokes`` are those so far, the lowest first.
    """

    def __init__(self, strokes: Strokes, step: int, steps: int) -> None:
        self.strokes, self.step, self.steps = strokes, step, steps

    def to(self, device: Any) -> PaintState:
        """The same with its strokes on a device: Lightning moves every batch."""
        return PaintState(self.strokes.map(lambda value: value.to(device)), self.step, self.steps)


class Painter(ABC):
    """How a painting comes to be, from the bare canvas to the last stroke.

    The program shows, films, measures and saves what a painter yields. It also ends it, by Ctrl-C, ``seconds=``,
    ``psnr=`` or a signal, between two states. So a state is due every few hundredths of the work.

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
    differentiates: ClassVar[bool] = False  # whether it asks for gradients of pictures; what computes them is compiled

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"decides by": cls.kind}

    @abstractmethod
    def __call__(self, request: PaintRequest) -> Iterator[PaintState]:
        """Paint, with ``request.n`` strokes at most, all of them within the ranges of ``FIELDS``."""
