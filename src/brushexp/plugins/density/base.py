"""What every density policy receives and returns."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from brushexp.strokes.catalogue import Strokes


@dataclass(frozen=True)
class DensificationState:
    """The whole painting after a step.

    ``importance()`` is (N,) by how much the squared error, summed over pixels and channels and weighted by the focus,
    would grow without each stroke. It takes about as long as five steps.
    """

    image: Tensor  # (3, H, W) as the steps last saw it, display-referred RGB in [0, 1]
    target: Tensor  # (3, H, W) what it should look like
    focus: Tensor | None  # (H, W) how much each pixel counts, of mean 1; None for all alike
    strokes: Strokes  # the N strokes, without gradient
    budget: int  # strokes that the painting may have
    step: int  # steps that are done, 1 or more
    steps: int  # in all, as far as that is known: a run with a limit of seconds corrects it
    importance: Callable[[], Tensor]


@dataclass(frozen=True)
class DensificationUpdate:
    """A change of the set of strokes: which of the present ones stay (N,), bool, and strokes to add."""

    keep: Tensor
    new: Strokes


class Density(ABC):
    """Adds strokes where they are needed and removes those that are not (densification and pruning).

    >>> import torch
    >>> class Halve(Density):
    ...     def revise(self, state):
    ...         return DensificationUpdate(keep=state.importance() > 0, new=Strokes.none())
    >>> pictures = torch.zeros(3, 4, 4), torch.ones(3, 4, 4), None
    >>> state = DensificationState(*pictures, Strokes.none(), 9, 1, 10, lambda: torch.tensor([1.0, -1.0]))
    >>> Halve().revise(state).keep
    tensor([ True, False])
    """

    # Whether `revise` asks for the importance of strokes; what computes it is then compiled before the first step.
    uses_importance: bool = False

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"cost": "five steps a round" if cls.uses_importance else "none", "needs": "the picture as last seen"}

    def first(self, budget: int, steps: int) -> int:
        """Strokes to begin with, 1 to ``budget``: the most that a painting of so many steps may have in the end."""
        return budget

    def due(self, step: int, steps: int) -> bool:
        """Whether `revise` is called after step number ``step`` (from 1) of ``steps``."""
        return True

    @abstractmethod
    def revise(self, state: DensificationState) -> DensificationUpdate | None:
        """Look at the painting after a step and say what changes; None for no change."""

    def state_dict(self) -> dict[str, Any]:
        """What an interrupted run needs to go on as if nothing had happened: tensors and numbers."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:  # noqa: B027
        """Take over what `state_dict` gave."""
