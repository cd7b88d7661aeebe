"""Base class for density policies, which add and remove strokes."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from brushexp.strokes.catalogue import Strokes


@dataclass(frozen=True)
class DensificationState:
    """The whole painting after a step; its picture, strokes and importance are given at ``zoom`` times its full size.

    ``importance()`` returns the increase (N,) in squared error if each stroke is removed, summed over pixels and
    channels and weighted by the focus. The call takes about as long as five steps.
    """

    image: Tensor  # (3, H, W) as last painted, display-referred RGB in [0, 1]
    target: Tensor  # (3, H, W)
    focus: Tensor | None  # (H, W) weights of the pixels, of mean 1; None for equal weights
    strokes: Strokes  # the N strokes, without gradient
    budget: int  # largest final number of strokes
    step: int  # number of steps taken, 1 or more
    steps: int  # planned number of steps; revised in a run with a time limit
    importance: Callable[[], Tensor]
    psnr: float | None = None  # PSNR in dB to reach; None for no goal
    may_replan: bool = True  # whether an update may change the number of steps; a time limit forbids it
    features: Tensor | None = None  # (H, W) bool: eyes and mouths, whose small strokes are not strays; None for nowhere
    front_to_back: Tensor | None = None  # (N,) indices, top stroke first; None if the last is on top
    zoom: float = 1.0  # pixels of ``image`` per pixel of the painting


@dataclass(frozen=True)
class DensificationUpdate:
    """A change to the set of strokes: which of the N strokes to keep (bool), and new ones to add, at the state's zoom.

    ``steps`` is the new total number of steps; None keeps the current number.
    """

    keep: Tensor
    new: Strokes
    steps: int | None = None


class Density(ABC):
    """Adds strokes where the picture needs them, and removes others (densification and pruning).

    >>> import torch
    >>> class Halve(Density):
    ...     def revise(self, state):
    ...         return DensificationUpdate(keep=state.importance() > 0, new=Strokes.none())
    >>> pictures = torch.zeros(3, 4, 4), torch.ones(3, 4, 4), None
    >>> state = DensificationState(*pictures, Strokes.none(), 9, 1, 10, lambda: torch.tensor([1.0, -1.0]))
    >>> Halve().revise(state).keep
    tensor([ True, False])
    """

    chooses_number: bool = False  # whether the policy chooses the number of strokes, up to a budget
    uses_importance: bool = False  # whether `revise` calls ``importance()``, whose code is then compiled in advance

    @classmethod
    def facts(cls) -> dict[str, str]:
        return {"cost": "five steps a round" if cls.uses_importance else "none", "needs": "the picture as last painted"}

    def first(self, budget: int, steps: int) -> int:
        """Return the initial number of strokes, 1 to ``budget``, for a painting of ``steps`` steps."""
        return budget

    def idle_reason(self, steps: int) -> str:
        """Explain why the policy neither adds nor removes strokes in ``steps`` steps; return "" if it does either.

        The text continues a sentence that begins with the policy's name.
        """
        return ""

    def zoom(self, n: int, size: tuple[int, int], psnr: float | None) -> float:
        """Choose the size of the picture in the next step, relative to a canvas of ``size`` (H, W) with ``n`` strokes.

        ``psnr`` is the PSNR to reach in dB, or None.
        """
        return 1.0

    def due(self, step: int, steps: int) -> bool:
        """Return whether to call `revise` after step number ``step`` (from 1) of ``steps``."""
        return True

    def conclude(self, state: DensificationState) -> None:  # noqa: B027
        """Evaluate the final strokes and their picture for `findings`."""

    def findings(self) -> dict[str, Any]:
        """Return the results of `conclude`, by their names in metrics.json.

        ``verdict`` is a sentence that sums up the results; ``strokes_psnr`` is a list of pairs: a number of strokes and
        the PSNR, in dB, of a painting with that many strokes.
        """
        return {}

    @abstractmethod
    def revise(self, state: DensificationState) -> DensificationUpdate | None:
        """Return the changes to the set of strokes after a step, or None for no change."""

    def state_dict(self) -> dict[str, Any]:
        """Return the tensors and numbers that a resumed run needs."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:  # noqa: B027
        """Load the result of `state_dict`."""
