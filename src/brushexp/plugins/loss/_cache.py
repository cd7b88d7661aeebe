"""What losses compute of the target, once for as long as steps look at the same place."""

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

import torch
from torch import Tensor

T = TypeVar("T")


class TargetCache(Generic[T]):
    """Keeps what was computed from a target, without gradient, until another target object comes."""

    def __init__(self) -> None:
        self._target: Tensor | None = None
        self._found: dict[Hashable, T] = {}

    def get(self, target: Tensor, compute: Callable[[Tensor], T], key: Hashable = None) -> T:
        """``compute(target)``; ``key`` tells apart what differs beside the target, if anything."""
        if target is not self._target:  # the object is kept, so that its identity cannot be reused
            self._target, self._found = target, {}
        if key not in self._found:
            with torch.no_grad():
                self._found[key] = compute(target)
        return self._found[key]
