"""Compute structure tensors, which describe the direction of least change in a picture."""

from collections.abc import Iterable

import numpy as np
import torch

Array = np.ndarray


def structure_tensor(picture: Array, sigma: float) -> Array:
    """Compute the structure tensors (3, H, W: xx, xy, yy) of a picture (C, H, W) (Bigun and Granlund, 1987).

    Products of the central differences are summed over channels and smoothed with a Gaussian of ``sigma`` pixels.
    """
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (--help does not need it)

    return np.stack([gaussian_filter(product, sigma) for product in _products(picture)])


class FarStructure:
    """Structure tensors of a picture (C, H, W), which can be smoothed over any distance at the same cost.

    The cosine transform extends a picture by mirroring, as `structure_tensor` does.

    >>> picture = np.random.default_rng(0).random((3, 20, 30))
    >>> near, far = (structure_tensor(picture, sigma) for sigma in (2.0, 5.0))
    >>> bool(np.allclose(FarStructure(picture)([(2.0, 0.1), (5.0, 0.9)]), 0.1 * near + 0.9 * far, atol=1e-5))
    True
    """

    def __init__(self, picture: Array) -> None:
        from scipy.fft import dctn  # noqa: PLC0415  (--help does not need it)

        self.spectrum = dctn(_products(picture), axes=(1, 2), workers=torch.get_num_threads())

    def __call__(self, parts: Iterable[tuple[float, float]]) -> Array:
        """Return a weighted sum (3, H, W) of smoothed tensors; ``parts`` are pairs of Gaussian width and weight."""
        from scipy.fft import idctn  # noqa: PLC0415

        squares = np.add.outer(*((np.pi * np.arange(n) / n) ** 2 for n in self.spectrum.shape[1:]))
        passed = sum(weight * np.exp(-0.5 * sigma**2 * squares) for sigma, weight in parts)
        tensor: Array = idctn(self.spectrum * passed, axes=(1, 2), workers=torch.get_num_threads())
        return tensor


def _products(picture: Array) -> Array:
    """Compute the products (3, H, W) of a picture's central differences (C, H, W), summed over channels."""
    padded = np.pad(picture, ((0, 0), (1, 1), (1, 1)), mode="edge")
    gx, gy = (padded[:, 1:-1, 2:] - padded[:, 1:-1, :-2]) / 2, (padded[:, 2:, 1:-1] - padded[:, :-2, 1:-1]) / 2
    return np.stack([(a * b).sum(0) for a, b in ((gx, gx), (gx, gy), (gy, gy))])


def along_edges(tensor: Array) -> Array:
    """Compute the direction (...) of least change, in radians from the x axis, from structure tensors (3, ...)."""
    return 0.5 * np.arctan2(-2 * tensor[1], tensor[2] - tensor[0])


def sample_at(picture: Array, x: Array, y: Array) -> Array:
    """Look up a picture's values (..., n) at n points; points outside are clamped to the nearest pixel inside."""
    height, width = picture.shape[-2:]
    values: Array = picture[..., y.astype(int).clip(0, height - 1), x.astype(int).clip(0, width - 1)]
    return values


def worst_of_cells(difference: Array, side: int) -> tuple[Array, Array, Array]:
    """Divide a map (H, W) into n square cells, and find the maximum of each.

    Returns the cells (n, side^2), padded with NaN, and the x and y (n,) of the maxima.
    """
    height, width = difference.shape
    rows, columns = -(-height // side), -(-width // side)
    padded = np.pad(difference, ((0, rows * side - height), (0, columns * side - width)), constant_values=np.nan)
    cells = padded.reshape(rows, side, columns, side).swapaxes(1, 2).reshape(rows * columns, -1)
    row, column = np.divmod(np.where(np.isnan(cells), -np.inf, cells).argmax(1), side)
    top, left = np.divmod(np.arange(rows * columns), columns)
    return cells, left * side + column, top * side + row
