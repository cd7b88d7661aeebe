"""Find outlines in a picture as long lines, and cover them with strokes."""

import numpy as np

from brushexp.contracts.pictures import sample_at
from brushexp_media.picture.lines import DARKEST, WIDER

Array = np.ndarray
FULL = 0.3  # relative contrast of an edge of full strength
SPACING = 2.0  # pixels between the points of an outline
SMOOTH = 3.0  # standard deviation, in points, of the blur of positions and strengths along an outline
LOOSE = 0.03  # largest distance of a stroke from its outline, relative to the length of the stroke
SHARES = (1.0, 0.7, 0.5, 0.35, 0.2)  # lengths of strokes to try, relative to the longest
OVERLAP = 0.5  # share of a stroke that the next one covers, so that tapered ends do not show


def find_outlines(
    lightness: Array, sigma: float, clear: Array, lowest: float, highest: float
) -> list[tuple[Array, Array]]:
    """Find the outlines in a picture (H, W); return the points (k, 2: x, y) and strengths (k,), 0 to 1, of each.

    Pixels are in [0, 1]; ``sigma`` is the scale of the edges in pixels. Strengths are multiplied by ``clear`` (H, W), a
    map of the clarity of edges, 0 to 1.

    Source: zero crossings of a difference of Gaussians (Marr and Hildreth, 1980), thresholded with hysteresis (Canny,
    1986): an outline ends where its strength falls below ``lowest``, and is kept if it exceeds ``highest`` somewhere.
    """
    from scipy.ndimage import gaussian_filter, gaussian_filter1d, gaussian_gradient_magnitude  # noqa: PLC0415  (slow)
    from skimage.measure import find_contours  # noqa: PLC0415  (slow to import)

    if min(lightness.shape) < 2:
        return []
    around, near = gaussian_filter(lightness, WIDER * sigma), gaussian_filter(lightness, sigma)
    slope = clear * sigma * gaussian_gradient_magnitude(lightness, sigma) / (around + DARKEST)
    found = []
    for line in find_contours(around - near, 0.0):
        points = gaussian_filter1d(_evenly(line[:, ::-1], SPACING), SMOOTH, axis=0, mode="nearest")
        if len(points) < 3:
            continue
        strength = gaussian_filter1d(sample_at(slope, *(points + 0.5).T), SMOOTH, mode="nearest")
        strength = (strength / FULL).clip(0, 1)
        ends = np.flatnonzero(np.diff(np.concatenate([[False], strength > lowest, [False]]).astype(int)))
        for first, last in ends.reshape(-1, 2):
            if last - first >= 3 and strength[first:last].max() > highest:
                found.append((points[first:last] + 0.5, strength[first:last]))
    return found


def strokes_over(points: Array, longest: float) -> tuple[Array, Array]:
    """Cover an outline (k, 2) with overlapping curves (n, 3, 2); also return the indices (n,) of their middle points.

    Each curve is quadratic, and as long as possible without leaving the outline, up to ``longest`` pixels.
    """
    most, last, first = max(2, round(longest / SPACING)), len(points) - 1, 0
    curves, middles = [], []
    while True:
        for share in SHARES:
            count = max(2, round(share * most))
            end = min(first + count, last)
            begin = max(0, end - count)
            part = points[begin : end + 1]
            curve = _through(part)
            t = np.linspace(0, 1, len(part))[:, None]
            on = (1 - t) ** 2 * curve[0] + 2 * t * (1 - t) * curve[1] + t**2 * curve[2]
            if np.linalg.norm(on - part, axis=1).max() < max(0.7, LOOSE * count * SPACING):
                break
        curves.append(curve)
        middles.append((begin + end) // 2)
        if end == last:
            return np.array(curves), np.array(middles)
        first = max(begin + 1, end - round(OVERLAP * (end - begin)))


def _through(points: Array) -> Array:
    """Find the quadratic curve (3, 2) through the first, middle and last point."""
    start, middle, end = points[0], points[len(points) // 2], points[-1]
    return np.array([start, 2 * middle - (start + end) / 2, end])


def _evenly(line: Array, spacing: float) -> Array:
    """Resample a line (k, 2) at points that are ``spacing`` apart along it."""
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.arange(0, way[-1], spacing)
    return np.stack([np.interp(at, way, line[:, axis]) for axis in (0, 1)], 1)
