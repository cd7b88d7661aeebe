"""Compute texture coordinates for the 64 pixels of a tile, as parts of the kernel for textured strokes."""
# mypy: allow-untyped-defs

import numpy as np

from brushexp.compat.compiled import function, inline
from brushexp.compositing.frame import SLOWEST, SLOWEST_PIXELS
from brushexp.compositing.nearest import find_nearest
from brushexp.compositing.textures import TEXEL_ASPECT
from brushexp.compositing.tile_lists import AREA, CENTER_X, CENTER_Y, NEAREST, TILE, F

X, Y, ONE = 2, 3, 4  # rows of a stroke in a tile: place in the texture, in texels, and 1 / length of the direction
PLACES = 5  # rows that the place needs


@inline
def curve_size(bx, by, fx, fy):
    """Compute the squared size of a curve: a quarter of the sum of its squared velocities at both ends."""
    return fx * fx + fy * fy + (fx + bx) * (fx + bx) + (fy + by) * (fy + by)


@inline
def place_in_texture(p, i, ox, oy, frame, own):
    """Write the texels that pixels sample to rows X and Y, and the tangent's inverse length to row ONE; see `frame`."""
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    bx, by, fx, fy = sx - F(2) * cx + ex, sy - F(2) * cy + ey, cx - sx, cy - sy
    still = F(SLOWEST * SLOWEST) * curve_size(bx, by, fx, fy) + F(SLOWEST_PIXELS * SLOWEST_PIXELS)
    outer = F(-1) if fx * by - fy * bx > F(0) else F(1)
    rows, columns, origin, body = frame[0], frame[1], frame[2], frame[3]
    begin, loop, more, flip = frame[4], frame[5], frame[6], frame[7]
    far = frame[8]
    scale, middle, often = p[i, 8], F(0.5) * rows + F(0.5), F(1) / loop
    for q in range(AREA):
        t = own[NEAREST * AREA + q]
        wx, wy = CENTER_X[q] - sx - (fx + fx + bx * t) * t, CENTER_Y[q] - sy - (fy + fy + by * t) * t
        dx, dy = fx + t * bx, fy + t * by
        speed, square = dx * dx + dy * dy, wx * wx + wy * wy
        moves = speed > still
        length = speed if moves else max(square, F(1e-30))
        tx, ty = (dx, dy) if moves else (outer * wy, -outer * wx)
        one = F(1) / np.sqrt(length)
        along = (tx * wx + ty * wy) * one
        along = F(0) if (t > F(0)) & (t < F(1)) else along
        across = (tx * wy - ty * wx) * one
        own[ONE * AREA + q] = one
        x = origin + body * t + F(1 / TEXEL_ASPECT) * scale * along
        back = min(np.floor((x - begin) * often), more)
        x -= loop * back if x >= begin else F(0)
        own[X * AREA + q] = min(max(x, F(0)), columns + F(1))
        y = middle + flip * scale * across if square < far else F(0)
        own[Y * AREA + q] = min(max(y, F(0)), rows + F(1))


@function
def places_in_windows(begin, end, p, frames, places):
    """Write the texture positions (n, S, S, 2) that a canvas's pixels sample, for strokes ``begin`` to ``end``.

    A position in ``places`` is a pair of coordinates in the stroke's texture, from -1 to 1.
    """
    side = places.shape[1]
    for i in range(begin, end):
        own, near = np.empty(PLACES * AREA, F), np.empty((1, AREA), np.uint16)
        rows, columns = frames[i, 0], frames[i, 1]
        for oy in range(0, side, TILE):
            for ox in range(0, side, TILE):
                find_nearest(p, i, F(np.inf), F(ox), F(oy), own, near, 0, False)
                place_in_texture(p, i, F(ox), F(oy), frames[i], own)
                for q in range(AREA):
                    place = places[i, oy + (q >> 3), ox + (q & 7)]
                    place[0] = F(2) * own[X * AREA + q] / (columns + F(1)) - F(1)
                    place[1] = F(2) * own[Y * AREA + q] / (rows + F(1)) - F(1)
