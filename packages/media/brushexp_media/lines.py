"""Lines that a draughtsman would draw around things."""

import numpy as np

Array = np.ndarray
SIGMA = 0.0022  # deviation of the smaller Gaussian, in longer sides: as fine as a pen
WIDER = 1.6  # deviation of the larger one over it (Marr and Hildreth, 1980: nearest to the Laplacian)
STRENGTH, LEAST = 22.0, 0.02  # how fast a line becomes full, from the difference over the luma around it on
DARKEST = 0.2  # luma that counts as at least there: in the dark, noise is no line
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
