"""Helpers for painters that place strokes one by one."""

from collections.abc import Iterator

import numpy as np
import torch

from brushexp.contracts.families import PaintState
from brushexp.contracts.strokes import Strokes, strokes_along

PORTIONS = 60  # maximum number of states that a painter yields
LUMINANCE = np.array([0.30, 0.59, 0.11])  # weights of red, green and blue, as in the papers of that time

Array = np.ndarray


def portions(n: int) -> list[int]:
    """List the stroke counts, at most `PORTIONS`, at which the states of a painting with n strokes are yielded."""
    return sorted({n * k // PORTIONS for k in range(1, PORTIONS + 1)} - {0})


def lay(strokes: Strokes) -> Iterator[PaintState]:
    """Yield the states of a painting whose strokes are known in advance; each stroke counts as one step."""
    for n in portions(len(strokes)):
        yield PaintState(strokes[:n], n, len(strokes))


def strokes_from_arrays(curves: Array, thickness: Array, color: Array, opacity: float) -> Strokes:
    """Make strokes along curves (N, 3, 2), with thickness (N,) in pixels and colour (N, 3)."""
    line, thick, shade = (torch.from_numpy(np.ascontiguousarray(x, np.float32)) for x in (curves, thickness, color))
    return strokes_along(line, thick, shade, torch.full((len(curves),), opacity))


def vectors(length: Array, angle: Array) -> Array:
    """Compute vectors (N, 2) of lengths (N,) in directions (N,) in radians."""
    return length[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)


def numpy_generator(generator: torch.Generator) -> np.random.Generator:
    """Create a NumPy generator that is seeded from a PyTorch generator."""
    return np.random.default_rng(int(torch.randint(2**62, (), generator=generator)))
