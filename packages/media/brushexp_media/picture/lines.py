"""Find the lines that a draughtsman would draw around objects."""

import numpy as np

from brushexp.contracts.pictures import sample_at

Array = np.ndarray
SIGMA = 0.0022  # standard deviation of the smaller Gaussian in longer sides, as fine as a pen
WIDER = 1.6  # ratio of the larger to the smaller deviation (Marr and Hildreth, 1980: closest to the Laplacian)
STRENGTH, THRESHOLD = 22.0, 0.02  # rate at which a line becomes full, and relative difference at which it begins
DARKEST = 0.2  # lower limit of luma, so that noise in the dark does not form lines
POINTS, BESIDE = 13, 0.6  # points of a line that are compared; share of it that may run along another
TIMES = np.linspace(0, 1, POINTS)
POINTS_PER_SIDE = 8  # points of a line on each side of its middle
SHARPEST = 0.5  # cosine of the sharpest turn that a line follows in one step
LOOSE, SHARES = 0.03, (1.0, 0.75, 0.5, 0.3)  # largest relative deviation of a curve from its path; parts that are tried
LUMA = (0.299, 0.587, 0.114)


def edge_lines(picture: Array, scale: float = 1.0, least: float = THRESHOLD) -> Array:
    """Compute the strength (H, W), 0 to 1, of the line through each pixel of a picture (3, H, W).

    Lines follow the dark side of edges whose difference is at least ``least``, and are ``scale`` times as thick as a
    pen line. Source: Winnemöller et al., "XDoG: An extended difference-of-Gaussians compendium" (2012). Unlike in the
    source, the difference is relative to the surrounding light, so that dark areas also get lines, and it is the
    maximum over red, green and blue, so that colours of equal luma are distinguished.
    """
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

    sigma = max(0.7, scale * SIGMA * max(picture.shape))
    planes = picture.astype(np.float64)
    around, near = (gaussian_filter(planes, (0, width, width)) for width in (WIDER * sigma, sigma))
    difference = ((around - near) / (around + DARKEST)).max(0)
    lines: Array = np.tanh(STRENGTH * (difference - least)).clip(0, 1)
    return lines


def find_apart(curve: Array, size: tuple[int, ...], reach: float) -> Array:
    """Return the indices of the curves (n, 3, 2) that do not run along an earlier one within ``reach`` pixels."""
    points = points_of(curve).swapaxes(0, 1)
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
    """Compute the anisotropy (...), 0 to 1, of structure tensors (3, ...) (Bigun and Granlund, 1987).

    >>> anisotropy_of(np.array([[2.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0]])).tolist()
    [1.0, 1.0, 0.0]
    """
    xx, xy, yy = tensor
    anisotropy: Array = np.hypot(xx - yy, 2 * xy) / np.maximum(xx + yy, np.finfo(float).tiny)
    return anisotropy


def follow_flow(places: Array, flow: Array, reach: Array, field: Array, least: Array | float) -> Array:
    """Follow a flow, in radians, in both directions from points (n, 2), over at most ``reach`` (n,) pixels.

    The curves (n, 3, 2) end where the field (H, W) falls to ``least``, or earlier where the path bends more than a
    quadratic curve can. A flow of shape (1, 1) is constant.
    """
    (back, before), (ahead, after) = (_walk(places, flow, sign * reach, field, least) for sign in (-1.0, 1.0))
    way, number = np.concatenate([back[:0:-1], ahead]), np.arange(len(places))
    curve, left = np.empty((len(places), 3, 2)), np.ones(len(places), bool)
    for share in SHARES:
        first, last = POINTS_PER_SIDE - np.ceil(share * before), POINTS_PER_SIDE + np.ceil(share * after)
        at = first + TIMES[:, None] * (last - first)
        low = at.astype(int).clip(0, 2 * POINTS_PER_SIDE - 1)
        points = way[low, number] + (at - low)[..., None] * (way[low + 1, number] - way[low, number])
        start, middle, end = points[0], points[len(points) // 2], points[-1]
        fitted = np.stack([start, 2 * middle - (start + end) / 2, end], 1)
        off = np.linalg.norm(points_of(fitted) - points, axis=-1).max(0)
        fits = left & ((off < LOOSE * np.linalg.norm(end - start, axis=1)) | (share == SHARES[-1]))
        curve[fits], left = fitted[fits], left & ~fits
    return curve


def points_of(curve: Array) -> Array:
    """Compute points (POINTS, n, 2) on curves (n, 3, 2)."""
    t = TIMES[:, None, None]
    points: Array = (1 - t) ** 2 * curve[:, 0] + 2 * t * (1 - t) * curve[:, 1] + t**2 * curve[:, 2]
    return points


def _walk(places: Array, flow: Array, reach: Array, field: Array, least: Array | float) -> tuple[Array, Array]:
    """Walk along a flow while a field exceeds ``least``; return paths (POINTS_PER_SIDE + 1, n, 2) and step counts."""
    point, going, count = places.astype(float), np.ones(len(places), bool), np.zeros(len(places))
    ahead, points = np.sign(reach)[:, None] * _unit(sample_at(flow, *point.T)), [point]
    for _ in range(POINTS_PER_SIDE):
        following = point + ahead * (np.abs(reach) / POINTS_PER_SIDE)[:, None]
        going &= sample_at(field, *following.T) > least
        point, count = np.where(going[:, None], following, point), count + going
        turned = _unit(sample_at(flow, *point.T))
        turned *= np.where((turned * ahead).sum(1) < 0, -1, 1)[:, None]
        ahead = np.where((turned * ahead).sum(1)[:, None] > SHARPEST, turned, ahead)
        points.append(point)
    return np.array(points), count


def _unit(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], 1)
