"""Lines that a draughtsman would draw around things."""

import numpy as np

Array = np.ndarray
SIGMA = 0.0022  # deviation of the smaller Gaussian, in longer sides: as fine as a pen
WIDER = 1.6  # deviation of the larger one over it (Marr and Hildreth, 1980: nearest to the Laplacian)
STRENGTH, LEAST = 22.0, 0.02  # how fast a line becomes full, from the difference over the luma around it on
DARKEST = 0.2  # luma that counts as at least there: in the dark, noise is no line
POINTS, BESIDE = 12, 0.6  # places of a line that are compared; share of it that may run along another
LUMA = (0.299, 0.587, 0.114)


def luminance(picture: Array) -> Array:
    """Compute luma (H, W) of a picture (3, H, W) in [0, 1]."""
    luma: Array = np.tensordot(LUMA, picture.astype(np.float64), 1)
    return luma


def edge_lines(picture: Array, scale: float = 1.0, least: float = LEAST) -> Array:
    """Compute how much of a line (H, W), 0 to 1, goes through each pixel of a picture (3, H, W).

    Lines are on the dark side of edges, and ``scale`` times as thick as a pen's, from a difference of ``least`` on.
    Source: Winnemöller et al., "XDoG: An extended difference-of-Gaussians compendium" (2012). Differs: the difference
    counts in proportion to the light around it, so that things in the dark have lines, too; and it is the largest of
    red, green and blue, so that colours of one luma are told apart.
    """
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

    sigma = max(0.7, scale * SIGMA * max(picture.shape))
    planes = picture.astype(np.float64)
    around, near = (gaussian_filter(planes, (0, width, width)) for width in (WIDER * sigma, sigma))
    difference = ((around - near) / (around + DARKEST)).max(0)
    lines: Array = np.tanh(STRENGTH * (difference - least)).clip(0, 1)
    return lines


def find_apart(curve: Array, size: tuple[int, ...], reach: float) -> Array:
    """Find which curves (n, 3, 2) do not run along an earlier one within ``reach`` pixels: one line, not many."""
    t = np.linspace(0, 1, POINTS)[:, None, None]
    points = ((1 - t) ** 2 * curve[:, 0] + 2 * t * (1 - t) * curve[:, 1] + t**2 * curve[:, 2]).swapaxes(0, 1)
    rows, columns = (points[..., k].astype(int).clip(0, size[1 - k] - 1) for k in (1, 0))
    taken, kept, near = np.zeros(size, bool), [], max(1, round(reach))
    for number, (y, x) in enumerate(zip(rows, columns, strict=True)):
        if taken[y, x].mean() > BESIDE:
            continue
        kept.append(number)
        for row, column in zip(y, x, strict=True):
            taken[max(row - near, 0) : row + near + 1, max(column - near, 0) : column + near + 1] = True
    return np.array(kept, int)


def anisotropy_of(tensor: Array) -> Array:
    """Compute how much one direction prevails (...), 0 to 1, from tensors (3, ...) (Bigun and Granlund, 1987).

    >>> anisotropy_of(np.array([[2.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0]])).tolist()
    [1.0, 1.0, 0.0]
    """
    xx, xy, yy = tensor
    anisotropy: Array = np.hypot(xx - yy, 2 * xy) / np.maximum(xx + yy, np.finfo(float).tiny)
    return anisotropy
