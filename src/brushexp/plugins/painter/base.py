"""What every painter receives and yields."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from brushexp.strokes.catalogue import Strokes


@dataclass(frozen=True)
class Commission:
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


@dataclass(frozen=True)
class PaintingState:
    """Where a painting stands after ``step`` of ``steps``; what a step is (a stroke, an iteration) the painter says.

    ``steps`` may change on the way; in the last state it is ``step``.
    """

    strokes: Strokes  # so far, the lowest first
    step: int
    steps: int


class PaintingMethod(ABC):
    """How a painting comes to be, from the bare canvas to the last stroke.

    What it yields is shown, filmed, measured and saved by the program, which also ends it: by Ctrl-C, ``seconds=``,
    ``psnr=`` or a signal, between two states. So a state is due every few hundredths of the work.

    >>> from brushexp.strokes.prior import sample_prior
    >>> class Careless(PaintingMethod):
    ...     '''The same stroke again and again.'''
    ...     def __call__(self, commission):
    ...         for k in range(1, commission.n + 1):
    ...             yield PaintingState(sample_prior(1)[torch.zeros(k, dtype=torch.long)], k, commission.n)
    >>> commission = Commission(torch.rand(3, 20, 30), 4, torch.ones(3), lambda strokes: ..., torch.Generator())
    >>> [len(state.strokes) for state in Careless()(commission)]
    [1, 2, 3, 4]
    """

    kind: ClassVar[str] = "not stated"  # how it decides, in two or three words
    by_steps: ClassVar[bool] = (
        False  # whether it leaves the painting to the program's gradient steps, and is not called
    )
    differentiates: ClassVar[bool] = False  # whether it asks for gradients of pictures; what computes them is compiled

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"decides by": cls.kind}

    @abstractmethod
    def __call__(self, commission: Commission) -> Iterator[PaintingState]:
        """Paint, with ``commission.n`` strokes at most, all of them within the ranges of ``FIELDS``."""
