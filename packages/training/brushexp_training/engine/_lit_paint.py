"""Compute a stroke's lit picture from the coverage and height of its wet paint."""

import numpy as np

from brushexp.contracts.kernels import function, inline
from brushexp_training.engine._bristles import UNITS, F


@inline
def _light(gx, gy):  # type: ignore[no-untyped-def]
    """Compute the diffuse and specular light reflected by paint with slope (gx, gy) (GGX, Walter et al., 2007)."""
    nz = F(7) / np.sqrt(gx * gx + gy * gy + F(49))
    ny = gy * nz / F(7)
    nl = max((nz - ny) * F(0.70710678), F(0))
    nh = max(F(0.38268343) * -ny + F(0.92387953) * nz, F(0))
    a2 = F(0.075) ** 2
    d = a2 / (F(3.14159265) * (nh * nh * (a2 - F(1)) + F(1)) ** 2)
    g = F(1) / ((nl + np.sqrt(a2 + (F(1) - a2) * nl * nl)) * (nz + np.sqrt(a2 + (F(1) - a2) * nz * nz)))
    f = F(0.05) + F(0.95) * (F(1) - F(0.92387953)) ** 5
    return F(0.15) * nl + F(0.85), d * g * f


@function
def picture(state, side, fine, color, relief, image, heights):  # type: ignore[no-untyped-def]
    """Shade the paint on the fine grid, and average the result over the window's pixels."""
    cover, height, window = state[2], state[3], heights.shape[0]
    slope, share = relief * F(side - 2) / UNITS, F(1) / F(fine * fine)
    flat, bare = _light(F(0), F(0))
    rgb = np.empty(3, F)
    for y in range(window):
        for x in range(window):
            total, thick = F(0), F(0)
            rgb[:] = F(0)
            for k in range(fine * fine):
                q = (y * fine + k // fine + 1) * side + x * fine + k % fine + 1
                thick += height[q]
                if cover[q] <= F(0):
                    continue
                above, below = q - side, q + side
                fall, rise = height[above - 1] - height[below + 1], height[above + 1] - height[below - 1]
                gx = fall - rise + F(2) * (height[q - 1] - height[q + 1])
                gy = fall + rise + F(2) * (height[above] - height[below])
                diffuse, shine = _light(slope * gx, slope * gy)
                total += cover[q]
                for c in range(3):
                    rgb[c] += cover[q] * min(max(color[c] * diffuse / flat + F(0.5) * (shine - bare), F(0)), F(1))
            heights[y, x] = thick * share
            image[3, y, x] = min(total * share, F(1))
            for c in range(3):
                image[c, y, x] = rgb[c] / total if total > F(1e-6) else color[c]
