"""Find the point on a polyline that is nearest to a pixel, in compiled code."""
# mypy: allow-untyped-defs

import numpy as np

from brushexp.contracts.kernels import inline

F = np.float32


@inline
def unit(value):
    """Clamp a number to [0, 1]."""
    return min(max(value, F(0)), F(1))


@inline
def length_of_line(points):
    """Measure the length of a polyline through points (P, 2)."""
    length = F(0)
    for k in range(len(points) - 1):
        length += np.hypot(points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1])
    return max(length, F(1e-3))


@inline
def nearest_place(points, x, y):
    """Find the point nearest to a pixel on a polyline through points (P, 2).

    Returns the pixel's squared distance from the polyline, and its position along and across the polyline, which is
    extended straight beyond its ends.
    """
    pieces = len(points) - 1
    best, along, across, before = F(1e9), F(0), F(0), F(0)
    for k in range(pieces):
        dx, dy = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
        long = max(np.hypot(dx, dy), F(1e-6))
        px, py = x - points[k, 0], y - points[k, 1]
        u, v = (px * dx + py * dy) / long, (py * dx - px * dy) / long
        inner = min(max(u, F(0)), long)
        apart = (u - inner) ** 2 + v * v
        if apart < best:
            first, last = k == 0 and u < 0, k == pieces - 1 and u > long
            best, along, across = apart, before + (u if first or last else inner), v
        before += long
    return best, along, across
