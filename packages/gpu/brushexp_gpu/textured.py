"""Coverage of textured strokes, as in `brushexp.compositing.textured_profile`, for Triton kernels."""
# mypy: allow-untyped-defs

import triton.language as tl

from brushexp.contracts.kernels import frame as frames_of
from brushexp.contracts.kernels import textures
from brushexp_gpu.curves import clip, store_moments, sum_pixels
from brushexp_gpu.launch import inline

TEXEL_WIDTH = tl.constexpr(1.0 / textures.TEXEL_ASPECT)
SLOWEST = tl.constexpr(frames_of.SLOWEST**2)
SLOWEST_PIXELS = tl.constexpr(frames_of.SLOWEST_PIXELS**2)
LEAST_SQUARE = tl.constexpr(frames_of.LEAST_SQUARE)
SHORTEST_SQUARED = tl.constexpr(frames_of.SHORTEST_SQUARED)
FRAME = tl.constexpr(9)  # numbers per stroke frame


@inline
def _size(fx, fy, bx, by):
    """Compute a curve's squared size, the sum of the squared half velocities at both ends."""
    return fx * fx + fy * fy + (fx + bx) * (fx + bx) + (fy + by) * (fy + by)


@inline
def _direction(t, sx, sy, fx, fy, bx, by, x, y):
    """Compute the directions of curves at parameters ``t``, and the offsets of the pixels from them.

    Returns the vector from the curve to the pixel, half the velocity, its square, whether it differs from 0, the unit
    tangent, and the reciprocal of the tangent's length before normalisation. Where the velocity is 0, the tangent is
    perpendicular to the vector; see `brushexp.compositing.frame`.
    """
    wx, wy = x - sx - (fx + fx + bx * t) * t, y - sy - (fy + fy + by * t) * t
    dx, dy = fx + t * bx, fy + t * by
    speed = dx * dx + dy * dy
    moves = speed > _size(fx, fy, bx, by) * SLOWEST + SLOWEST_PIXELS
    outer = tl.where(fx * by - fy * bx > 0.0, -1.0, 1.0)
    one = 1.0 / tl.sqrt(tl.where(moves, speed, tl.maximum(wx * wx + wy * wy, 1e-30)))
    tx, ty = tl.where(moves, dx, outer * wy) * one, tl.where(moves, dy, -outer * wx) * one
    return wx, wy, dx, dy, speed, moves, tx, ty, one


@inline
def _load_frame(frames, i, k: tl.constexpr, here):
    return tl.load(frames + i * FRAME + k, here, 1.0)[:, None]


@inline
def _place(t, sx, sy, fx, fy, bx, by, x, y, frames, i, scale, here):
    """Return texture coordinates (column and row, in texels), and the texture's size in columns and rows (TILES, 1)."""
    wx, wy, _, _, _, _, tx, ty, _ = _direction(t, sx, sy, fx, fy, bx, by, x, y)
    rows, columns = _load_frame(frames, i, 0, here), _load_frame(frames, i, 1, here)
    origin, body = _load_frame(frames, i, 2, here), _load_frame(frames, i, 3, here)
    begin, loop = _load_frame(frames, i, 4, here), _load_frame(frames, i, 5, here)
    more, flip, far = _load_frame(frames, i, 6, here), _load_frame(frames, i, 7, here), _load_frame(frames, i, 8, here)
    along = tl.where((t > 0.0) & (t < 1.0), 0.0, tx * wx + ty * wy)
    across = tx * wy - ty * wx
    u = origin + body * t + scale * along * TEXEL_WIDTH
    u -= tl.where(u >= begin, loop * tl.minimum(tl.floor((u - begin) * (1.0 / loop)), more), 0.0)
    v = tl.where(wx * wx + wy * wy < far, 0.5 * rows + 0.5 + flip * scale * across, 0.0)
    return clip(u, 0.0, columns + 1.0), clip(v, 0.0, rows + 1.0), columns, rows


@inline
def _corner(word, k: tl.constexpr):
    return ((word >> (8 * k)) & 255).to(tl.float32)


@inline
def _mix(word, x, y):
    """Interpolate bilinearly between a word's four bytes, and return the value and its slopes along x and y."""
    a, b, c, d = _corner(word, 0), _corner(word, 1), _corner(word, 2), _corner(word, 3)
    twist = a - b - c + d
    along_y = c - a + x * twist
    return a + x * (b - a) + y * along_y, b - a + y * twist, along_y


@inline
def look_up(t, sx, sy, fx, fy, bx, by, x, y, begin, cells, frames, i, scale, here):
    """Look up opacity in 255ths and tone in [-1, 1], each followed by its slopes along columns and rows."""
    u, v, columns, rows = _place(t, sx, sy, fx, fy, bx, by, x, y, frames, i, scale, here)
    column, row = tl.minimum(u.to(tl.int32), columns.to(tl.int32)), tl.minimum(v.to(tl.int32), rows.to(tl.int32))
    u, v = u - column.to(tl.float32), v - row.to(tl.float32)
    at = tl.load(begin + i, here, 0)[:, None] + row * (columns.to(tl.int32) + 2) + column
    cell = tl.load(cells + at, here[:, None], 0)
    cover, cover_u, cover_v = _mix(cell.to(tl.int32), u, v)
    shade, shade_u, shade_v = _mix((cell >> 32).to(tl.int32), u, v)
    return cover, cover_u, cover_v, (shade - 128.0) / 127.0, shade_u / 127.0, shade_v / 127.0


@inline
def textured_pull(out, gu, gv, t, sx, sy, fx, fy, bx, by, x, y, frames, i, half, scale, here):
    """Write the gradients of curve and scale to ``out`` + 0 to 6 and 8, from the gradients of texture coordinates."""
    wx, wy, dx, dy, speed, moves, tx, ty, one = _direction(t, sx, sy, fx, fy, bx, by, x, y)
    size, beside = _size(fx, fy, bx, by), (t > 0.0) & (t < 1.0)
    along, across = tl.where(beside, 0.0, tx * wx + ty * wy), tx * wy - ty * wx
    gv = gv * _load_frame(frames, i, 7, here)
    tl.store(out + 6, tl.zeros_like(i).to(tl.float32), here)
    tl.store(out + 8, sum_pixels(gu * along * TEXEL_WIDTH + gv * across), here)
    short = size * LEAST_SQUARE + half * half * SHORTEST_SQUARED + 1e-30
    gt = _load_frame(frames, i, 3, here) * gu / tl.maximum(2.0 * speed - wx * bx - wy * by, short)
    gt = tl.where(beside, gt, 0.0)
    gu, gv = tl.where(beside, 0.0, gu * scale * TEXEL_WIDTH), gv * scale
    turn = (gu * across - gv * along) * tl.minimum(one, 1.0 / tl.sqrt(size * LEAST_SQUARE + 1e-30))
    turn = tl.where(moves, turn, 0.0)
    ax, ay = gv * ty - gu * tx - gt * dx, -gv * tx - gu * ty - gt * dy  # gradient of the curve's point
    vx, vy = gt * wx - turn * ty, gt * wy + turn * tx  # gradient of half the velocity there
    ux, uy = t * ax, t * ay
    store_moments(out, ax, 2.0 * ux + vx, t * (ux + vx), ay, 2.0 * uy + vy, t * (uy + vy), here)
