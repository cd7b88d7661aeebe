"""Quality over time: as callbacks see it at a step, and as metrics.json keeps it."""

import math
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.utils._pytree import tree_map_only

MAX_PAIRS = 200  # (seconds, PSNR) that a run keeps

Pair = tuple[float, float]


class Lazy(Tensor):
    """A number that is computed when somebody looks at it: a PSNR at every step would cost a part of the step."""

    compute: Callable[[], float]

    @classmethod
    def __torch_function__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        args, kwargs = tree_map_only(
            cls, lambda number: torch.tensor(number.compute(), dtype=torch.float64), (args, kwargs or {})
        )
        return func(*args, **kwargs)


class Anytime:
    """Pairs (seconds of optimisation, PSNR in dB as last seen), thinned so that straight lines between them say most.

    When there are more than ``most``, the one goes whose triangle with its two neighbours is smallest (Visvalingam and
    Whyatt, 1993): bends are kept, straight pieces need few pairs. The first and the last one always stay.
    """

    def __init__(self, *, most: int = MAX_PAIRS) -> None:
        self.pairs: list[Pair] = []
        self.most = most

    def add(self, seconds: float, psnr: float) -> None:
        """Add a pair later than the others, or in place of the last one if it is of the same time.

        A PSNR that is no number, because nothing was seen yet or the picture is perfect, is left out.
        """
        if not math.isfinite(psnr):
            return
        if self.pairs and seconds <= self.pairs[-1][0]:
            self.pairs.pop()
        self.pairs.append((seconds, psnr))
        if len(self.pairs) > self.most:
            sizes = [_triangle(*self.pairs[k - 1 : k + 2]) for k in range(1, len(self.pairs) - 1)]
            del self.pairs[1 + sizes.index(min(sizes))]


def _triangle(a: Pair, b: Pair, c: Pair) -> float:
    """Twice the area of the triangle of three pairs."""
    return abs((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]))
