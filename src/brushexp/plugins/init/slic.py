"""Place strokes on superpixels."""

import heapq
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.bounds import above, between
from brushexp.plugins.init._cells import CellInitializer, cell_means, merge_smallest, split_cells
from brushexp.plugins.init.grid import lattice
from brushexp.registry import register

SLIC_ITERATIONS = 5  # ten iterations take twice as long and paint no better
REFINEMENT_ROUNDS = 3  # number of rounds; each splits the cells of the previous round
GREY_LEVEL = 1 / 255  # standard deviation of colour below which the area of a cell decides


@register("init", "slic")
@dataclass(kw_only=True)
class Slic(CellInitializer):
    """Places strokes on SLIC superpixels (Achanta et al., 2012), denser in detailed and in-focus regions.

    Each stroke is placed at the centre of mass of a cell and has the cell's mean colour. Unlike in the source, the
    number of cells is exact, and some of them are obtained by splitting the superpixels with the most variation or,
    with a focus, the most important ones.

    Args:
        compactness: regularity of the superpixels: high values make them square, low values follow colours.
        detail: fraction of the strokes placed by detail, 0 to 1; the others are spread evenly.
    """

    compactness: Annotated[float, above(0, 1e4)] = 10.0
    detail: Annotated[float, between(0, 1)] = 0.5
    width: Annotated[float, above(0, 10)] = 0.8

    def cells(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None) -> np.ndarray:
        labels = superpixels(target, max(1, round((1 - self.detail) * n)), self.compactness)
        return refine_cells(labels, n, target.numpy(), None if focus is None else focus.numpy())


def superpixels(target: Tensor, n: int, compactness: float) -> np.ndarray:
    """Assign each pixel (H, W) to one of about ``n`` superpixels, or to a lattice if the superpixels would be tiny."""
    from skimage.segmentation import slic  # noqa: PLC0415  (slow to import)

    _, height, width = target.shape
    if n * 4 > height * width or min(height, width) < 2:
        return lattice(height, width, n)
    labels: np.ndarray = slic(
        target.permute(1, 2, 0).numpy(),
        n_segments=n,
        compactness=compactness,
        max_num_iter=SLIC_ITERATIONS,
        min_size_factor=0.1,  # small cells are wanted, so that details get strokes
        start_label=0,
        channel_axis=-1,
    )
    return labels


def refine_cells(labels: np.ndarray, n: int, picture: np.ndarray, focus: np.ndarray | None = None) -> np.ndarray:
    """Split the cells of a partition (H, W), those with the largest weights first, until there are exactly ``n``.

    The weight of a cell is its area times the standard deviation of its colours, times its mean ``focus`` (H, W). Area
    times variance, which is the squared error, does not give a higher PSNR and leaves flat regions visibly too coarse.
    If there are more than ``n`` cells, the smallest are merged into neighbours.
    """
    height, width = labels.shape
    if labels.max() >= n:
        return merge_smallest(labels, n)
    flat, channels = labels.ravel(), picture.reshape(3, -1).astype(np.float64)
    squares = channels**2
    for rounds in range(REFINEMENT_ROUNDS, 0, -1):
        k = int(flat.max()) + 1
        area = np.bincount(flat, minlength=k)
        variance = (cell_means(squares, flat, k) - cell_means(channels, flat, k) ** 2).sum(0).clip(0)
        weight = area * np.sqrt(variance + GREY_LEVEL**2)
        if focus is not None:
            weight *= np.bincount(flat, focus.ravel(), minlength=k) / area
        flat = split_cells(flat, _pieces(weight, area, k + (n - k) // rounds), height, width)
    return flat.reshape(height, width)


def _pieces(weight: np.ndarray, area: np.ndarray, n: int) -> np.ndarray:
    """Choose the number of pieces for each cell, so that there are ``n`` pieces, none of them smaller than a pixel.

    If a cell with a colour ramp is cut into p pieces, each piece has 1 / p of the cell's area and 1 / p of its standard
    deviation, and so 1 / p^2 of its weight. The cell whose pieces have the largest weight is split next.
    """
    pieces = np.ones(len(area), np.int64)
    heap = [(-value if size > 1 else 0.0, cell) for cell, (value, size) in enumerate(zip(weight, area, strict=True))]
    heapq.heapify(heap)
    for _ in range(n - len(area)):
        _, cell = heap[0]
        pieces[cell] += 1
        rest = weight[cell] / pieces[cell] ** 2 if pieces[cell] < area[cell] else 0.0
        heapq.heapreplace(heap, (-rest, cell))
    return pieces
