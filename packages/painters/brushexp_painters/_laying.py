"""What painters that decide stroke by stroke share."""

from collections.abc import Iterator

import numpy as np
import torch

from brushexp.plugins.painter.base import PaintState
from brushexp.strokes.bezier import strokes_along
from brushexp.strokes.catalogue import Strokes

PORTIONS = 60  # states of a painting whose strokes are all known

LUMINANCE = np.array([0.30, 0.59, 0.11])  # weights of red, green and blue in papers of the time

Array = np.ndarray


def laid(strokes: Strokes) -> Iterator[PaintState]:
    """States of a painting whose strokes are known: so many are laid, then more; a step is a stroke."""
    n = len(strokes)
    for k in range(1, PORTIONS + 1):
        if (done := n * k // PORTIONS) > n * (k - 1) // PORTIONS:
            yield PaintState(strokes[:done], done, n)


def strokes_from_arrays(curves: Array, thickness: Array, color: Array, opacity: float) -> Strokes:
    """Strokes along curves (N, 3, 2), so many (N,) pixels thick, in colours (N, 3)."""
    line, thick, shade = (
        torch.from_numpy(np.ascontiguousarray(part, np.float32)) for part in (curves, thickness, color)
    )
    return strokes_along(line, thick, shade, torch.full((len(curves),), opacity))


def vectors(length: Array, angle: Array) -> Array:
    """Vectors (N, 2) of lengths (N,) in directions (N,) in radians."""
    return length[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)


def numpy_generator(generator: torch.Generator) -> np.random.Generator:
    """A generator of NumPy that follows from one of PyTorch."""
    return np.random.default_rng(int(torch.randint(2**62, (), generator=generator)))
