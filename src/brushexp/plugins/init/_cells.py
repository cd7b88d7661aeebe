"""Partition a picture into cells, and place one stroke in each."""

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.bounds import above, between, one_of
from brushexp.pictures.structure import along_edges, structure_tensor
from brushexp.plugins.init.base import Initializer
from brushexp.strokes.bezier import roomy_window, strokes_along
from brushexp.strokes.catalogue import Strokes

RANDOM_SPREAD, RANDOM_WIDTH = 0.1, 0.03  # the random start of the thesis: points in half-windows, width in windows
ELONGATION_WEIGHT = 0.25  # weight of the cell's own elongation relative to the picture's structure
MIN_GRADIENT_POWER = 1e-4  # squared grey levels per pixel; gradients below 1 % of the range hardly indicate a direction

Array = np.ndarray


@dataclass(kw_only=True)
class CellInitializer(Initializer):
    """Base class for initialisers that place one stroke in each cell and give it the cell's centre, colour and size.

    Args:
        orient: structure (strokes follow the picture's edges and fill their cells) or random (following the thesis:
            points sampled from N(0, 0.1), in half-windows, and the smallest width, for the optimiser to adjust).
        length: stroke length, in sides of the stroke's cell (structure only).
        width: stroke width, in sides of the stroke's cell (structure only).
        opacity: stroke opacity, 0 to 1.
        jitter: standard deviation of a random shift of each stroke, in mean distances between strokes.
    """

    orient: Annotated[str, one_of("structure", "random")] = "structure"
    length: Annotated[float, above(0, 10)] = 1.4
    width: Annotated[float, above(0, 10)] = 1.0
    opacity: Annotated[float, between(0, 1)] = 0.95
    jitter: Annotated[float, between(0, 10)] = 0.02

    @abstractmethod
    def cells(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None) -> Array:
        """Assign each pixel (H, W) to one of ``n`` non-empty cells, numbered from 0."""

    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        flat = self.cells(target, n, generator, focus).ravel()
        _, height, width = target.shape
        picture = target.numpy().astype(np.float64)
        centre, covariance, area = _moments(_coordinates(height, width), flat, n)
        color = cell_means(picture.reshape(3, -1), flat, n)
        pitch = math.sqrt(height * width / n)
        window = roomy_window(pitch)
        if self.orient == "random":
            curve = (RANDOM_SPREAD * torch.randn(3, n, 2, generator=generator)).clamp(-1, 1).double()
            curve = curve.transpose(0, 1) * (window / 2)
            thickness = torch.full((n,), RANDOM_WIDTH * window, dtype=torch.float64)
        else:
            side = np.sqrt(area).clip(0.4 * pitch, 2.5 * pitch)
            angle = _direction(picture, flat, n, covariance)
            half = torch.from_numpy(np.stack([np.cos(angle), np.sin(angle)], 1) * (0.5 * self.length * side)[:, None])
            curve = torch.stack([-half, torch.zeros(n, 2), half], 1)
            thickness = torch.from_numpy(self.width * side)
        position = torch.tensor(centre.T, dtype=torch.float32)
        if self.jitter:
            position = position + self.jitter * pitch * torch.randn(n, 2, generator=generator)
            position = torch.minimum(position.clamp_min(0.5), torch.tensor([width, height]) - 0.5)
        mean = torch.from_numpy(color.T)
        return strokes_along(curve, thickness, mean, self.opacity, window=window, position=position).map(Tensor.float)


def merge_smallest(labels: Array, n: int) -> Array:
    """Keep the ``n`` largest cells of a partition (H, W), and merge every other cell into the nearest of them."""
    flat = labels.ravel()
    centre, _, area = _moments(_coordinates(*labels.shape), flat, int(flat.max()) + 1)
    largest = np.sort(np.argsort(-area, kind="stable")[:n])
    heir = nearest(centre.T[largest], centre.T)
    heir[largest] = np.arange(n)
    return heir[labels]


def nearest(points: Array, to: Array) -> Array:
    """Find, for each point in ``to`` (m, 2), the index (m,) of the nearest of ``points`` (n, 2)."""
    from scipy.spatial import cKDTree  # noqa: PLC0415  (slow to import)

    return cKDTree(points).query(to)[1]


def split_cells(flat: Array, pieces: Array, height: int, width: int) -> Array:
    """Repeatedly split each of n cells (H * W,) across its longer axis, until it consists of ``pieces`` (n,) pieces."""
    points = _coordinates(height, width)
    flat, pieces = flat.copy(), pieces.copy()
    while (pieces > 1).any():
        n = len(pieces)
        pixel = np.flatnonzero((pieces > 1)[flat])
        cell = flat[pixel]
        centre, covariance, count = _moments(points[:, pixel], cell, n)
        angle = along_edges(-covariance)  # the longer axis
        across, down = points[:, pixel] - centre[:, cell]
        small = cell.astype(np.min_scalar_type(n))  # small integers sort several times as fast
        order = np.lexsort((across * np.cos(angle)[cell] + down * np.sin(angle)[cell], small))
        pixel, cell = pixel[order], cell[order]
        rank = np.arange(len(cell)) - (np.cumsum(count) - count)[cell]
        part = pieces // 2
        moves = rank < (count * part // pieces)[cell]
        successor = n - 1 + np.cumsum(pieces > 1)
        flat[pixel[moves]] = successor[cell[moves]]
        pieces = np.concatenate([pieces - np.where(pieces > 1, part, 0), part[pieces > 1]])
    return flat


def _coordinates(height: int, width: int) -> Array:
    y, x = np.mgrid[:height, :width] + 0.5
    return np.stack([x.ravel(), y.ravel()])


def cell_means(values: Array, flat: Array, n: int) -> Array:
    """Average pixel values (C, P) over each of ``n`` cells; the mean is 0 for empty cells."""
    return np.stack([np.bincount(flat, value, n) for value in values]) / np.bincount(flat, minlength=n).clip(1)


def _moments(points: Array, flat: Array, n: int) -> tuple[Array, Array, Array]:
    """Compute each cell's centre (2, n), covariance (3, n: xx, xy, yy) and area (n,) from pixels at points (2, P)."""
    centre = cell_means(points, flat, n)
    dx, dy = points - centre[:, flat]
    return centre, cell_means(np.stack([dx * dx, dx * dy, dy * dy]), flat, n), np.bincount(flat, minlength=n)


def _direction(picture: Array, flat: Array, n: int, covariance: Array) -> Array:
    """Compute the direction (n,), in radians, in which the picture changes least around each cell.

    The direction is computed from the sum of two tensors: the structure tensor (Bigun and Granlund, 1987), averaged
    over the cell and divided by its trace, and a tensor for the elongation of the cell, with a small weight that
    matters only in flat regions.
    """
    tensor = cell_means(structure_tensor(picture, 1.0).reshape(3, -1), flat, n)
    strength = tensor[0] + tensor[2] + MIN_GRADIENT_POWER
    extent = covariance[0] + covariance[2] + 1e-9  # 0 for a cell of one pixel
    return along_edges(tensor / strength - ELONGATION_WEIGHT * covariance / extent)
