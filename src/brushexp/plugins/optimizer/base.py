"""Base class for optimisers, which move the strokes."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping

from torch import nn, optim


class Optimizer(ABC):
    """Moves the strokes, with a learning rate that depends on the progress.

    >>> import torch
    >>> class Descent(Optimizer):
    ...     units = {"position": 0.01}
    ...     def over(self, parameters: Iterable[nn.Parameter]) -> optim.Optimizer:
    ...         return optim.SGD(parameters, lr=0.1)
    ...     def share(self, progress: float) -> float:
    ...         return 1 - progress
    >>> type(Descent().over([nn.Parameter(torch.zeros(2))])).__name__, Descent().share(0.75)
    ('SGD', 0.25)
    """

    units: Mapping[str, float]  # stroke field -> unit (`Catalogue`); a field without a unit is frozen

    @abstractmethod
    def over(self, parameters: Iterable[nn.Parameter]) -> optim.Optimizer:
        """Create a PyTorch optimiser for these parameters."""

    @abstractmethod
    def share(self, progress: float) -> float:
        """Return the learning rate, as a fraction of its full value, at ``progress`` (0 to 1) in a stage."""
