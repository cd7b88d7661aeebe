"""What losses compute of the target, once for as long as steps look at the same place."""

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

import torch
from torch import Tensor

T = TypeVar("T")


class OfTarget(Generic[T]):
    """Keeps what was made of a target, without gradient, until another target object comes."""

    def __init__(self) -> None:
        self._target: Tensor | None = None
        self._found: dict[Hashable, T] = {}

    def get(self, target: Tensor, make: Callable[[Tensor], T], key: Hashable = None) -> T:
        """``make(target)``; what differs beside the target, if anything, is told by ``key``."""
        if target is not self._target:  # the object is kept, so that its identity cannot be reused
            self._target, self._found = target, {}
        if key not in self._found:
            with torch.no_grad():
                self._found[key] = make(target)
        return self._found[key]
