"""The local structure of a picture: in which direction it changes least."""

import numpy as np

Array = np.ndarray


def structure_tensor(picture: Array, sigma: float) -> Array:
    """Structure tensor (3, H, W: xx, xy, yy) of a picture (C, H, W), summed over channels (Bigun and Granlund, 1987).

    Products of the central differences per pixel, smoothed with a Gaussian of ``sigma`` pixels.
    """
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (--help does not need it)

    padded = np.pad(picture, ((0, 0), (1, 1), (1, 1)), mode="edge")
    gx, gy = (padded[:, 1:-1, 2:] - padded[:, 1:-1, :-2]) / 2, (padded[:, 2:, 1:-1] - padded[:, :-2, 1:-1]) / 2
    return np.stack([gaussian_filter((a * b).sum(0), sigma) for a, b in ((gx, gx), (gx, gy), (gy, gy))])


def along_edges(tensor: Array) -> Array:
    """Direction (...) in which a picture with this structure tensor (3, ...) changes least, radians from the x axis."""
    return 0.5 * np.arctan2(-2 * tensor[1], tensor[2] - tensor[0])
