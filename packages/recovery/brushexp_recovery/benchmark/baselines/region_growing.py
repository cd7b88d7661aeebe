"""Find brushstrokes as elliptical regions grown from seeds, after Lamberti, Sanna and Paravati (2014).

Source: "Computer-assisted analysis of painting brushstrokes: digital image processing for unsupervised extraction of
visible features from van Gogh's works". Unlike in the source, seeds are not taken at random but in ascending order of
the gradient, so that the same picture always gives the same strokes.
"""
# mypy: allow-untyped-defs

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from brushexp.contracts.kernels import function, inline

Array = NDArray[Any]

SIGMA = 0.7  # standard deviation of the smoothing in pixels
TOLERANCE = 7.0  # maximum CIELAB difference of a pixel from the mean of its region
SMALLEST_REGION = 20  # pixels
LARGEST_REGION = 0.05  # share of the picture
ELLIPTICAL = 0.75  # minimum share of a region inside the ellipse with the same moments


def grow_ellipses(image: Array) -> Array:
    """Label the brushstrokes in a picture (H, W, 3); labels (H, W) are -1 where there is none."""
    from skimage.color import rgb2lab  # noqa: PLC0415  (slow to import)

    lab = gaussian_filter(rgb2lab(image), (SIGMA, SIGMA, 0))
    slope = sum((part**2).sum(-1) for part in np.gradient(lab, axis=(0, 1)))
    order = np.argsort(np.asarray(slope).ravel(), kind="stable")
    return _grow_regions(lab, order, int(LARGEST_REGION * slope.size))


@function
def _grow_regions(lab, order, largest):
    """Grow a region from each free pixel, in the given order, and keep elliptical regions."""
    height, width, _ = lab.shape
    labels = np.full((height, width), -1, np.int32)
    state = np.zeros((height, width), np.int32)  # 0 if free, otherwise the last region that tried the pixel
    queue = np.zeros((height * width, 2), np.int32)
    count = 0
    for attempt in range(len(order)):
        row, column = order[attempt] // width, order[attempt] % width
        if state[row, column] != 0:
            continue
        size = _grow(lab, row, column, attempt + 1, labels, state, queue)
        if SMALLEST_REGION <= size <= largest and _ellipticity(queue[:size]) >= ELLIPTICAL:
            for k in range(size):
                labels[queue[k, 0], queue[k, 1]] = count
            count += 1
    return labels


@inline
def _grow(lab, row, column, mark, labels, state, queue):
    """Grow a region from a pixel, write its pixels to ``queue`` and its ``mark`` to ``state``, and return its size."""
    height, width, _ = lab.shape
    total = np.zeros(3)
    head, tail = 0, 1
    queue[0, 0], queue[0, 1] = row, column
    state[row, column] = mark
    while head < tail:
        y, x = queue[head]
        head += 1
        for c in range(3):
            total[c] += lab[y, x, c]
        for k in range(4):
            v, u = y + (k == 0) - (k == 1), x + (k == 2) - (k == 3)
            if v < 0 or v >= height or u < 0 or u >= width or state[v, u] == mark or labels[v, u] >= 0:
                continue
            gap = 0.0
            for c in range(3):
                gap += (lab[v, u, c] - total[c] / head) ** 2
            if gap <= TOLERANCE**2:
                state[v, u] = mark
                queue[tail, 0], queue[tail, 1] = v, u
                tail += 1
    return tail


@function
def _ellipticity(places):
    """Divide the number of points (n, 2) inside the ellipse with the same moments by the larger of its area and n.

    The result is 1 for an ellipse.
    """
    n = len(places)
    my = mx = 0.0
    for k in range(n):
        my += places[k, 0] / n
        mx += places[k, 1] / n
    yy = xx = 1.0 / 12
    xy = 0.0
    for k in range(n):
        dy, dx = places[k, 0] - my, places[k, 1] - mx
        yy += dy * dy / n
        xx += dx * dx / n
        xy += dx * dy / n
    det = xx * yy - xy * xy
    inside = 0
    for k in range(n):
        dy, dx = places[k, 0] - my, places[k, 1] - mx
        inside += (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / det <= 4.0
    area = 4 * np.pi * np.sqrt(det)
    return inside / max(area, 1.0 * n)
