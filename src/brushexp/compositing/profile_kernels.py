"""Compiled forward and backward passes over tiles of 8 x 8 pixels.

Nothing of size strokes x pixels is stored. A tile's 64 pixels stay in the first-level cache while its strokes are laid
over each other front to back; the loops over the pixels have no branches, so that they become SIMD code. The nearest
parameter t of a curve is found by Newton's method from the best of a few samples, or, if the curve bends strongly, by
Halley's method from both of its ends. By the envelope theorem the distance then depends on the control points only
through the point at fixed t, so its gradient is the unit normal times the Bernstein weights; a tapered stroke adds the
derivative of t itself.
"""

import numpy as np
from numba import prange

from brushexp.compositing.nearest import (
    AREA,
    BEST,
    BLUE,
    FLOOR,
    GREEN,
    LIGHT,
    RED,
    F,
    T,
    find_nearest,
    keep_nearest,
    recall_nearest,
)
from brushexp.compositing.tile_lists import TILE
from brushexp.system.compiled import inline, kernel

WORKERS = 64  # every so many tiles are one worker's: fixed, and enough to share the work evenly
COLUMNS = 11  # of a stroke: start, control, end (x, y each), half width, red, green, blue, opacity
STILL = F(1.25e-5)  # square pixels: as in `strokes.bezier`
# Rows of a tile's scratch, each AREA numbers, after those of `_nearest`.
_RED, _GREEN, _BLUE, _LIGHT, _T, _BEST = RED, GREEN, BLUE, LIGHT, T, BEST
_DISTANCE, _COVER = 6, 7
ROWS = 8
KEPT = 4  # numbers that the backward pass keeps per stroke and pixel: t, distance, cover, light above


@inline
def _rise(x):  # type: ignore[no-untyped-def]
    z = min(max(x, F(-0.5)), F(0.5))
    return z * (F(1.5) - F(2) * z * z)


@inline
def _slope(x):  # type: ignore[no-untyped-def]
    z = min(max(x + F(0.5), F(0)), F(1))
    return F(6) * z * (F(1) - z)


@inline
def _cover(p, i, ox, oy, sharp, taper, buf):  # type: ignore[no-untyped-def]
    """Write rows _DISTANCE and _COVER (coverage, before opacity) of stroke ``i`` in a tile, from its row _T."""
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    h = p[i, 6]
    there = F(1) if h > F(0) else F(0)
    for q in range(AREA):
        t = buf[_T * AREA + q]
        v = F(1) - t
        b0, b1, b2 = v * v, F(2) * t * v, t * t
        rx = b0 * sx + b1 * cx + b2 * ex - F(q & 7) - F(0.5)
        ry = b0 * sy + b1 * cy + b2 * ey - F(q >> 3) - F(0.5)
        d = np.sqrt(rx * rx + ry * ry)
        ht = h * (F(1) - taper * (t - v) * (t - v))
        buf[_DISTANCE * AREA + q] = d
        cover = _rise((ht + d) * sharp) + _rise((ht - d) * sharp)
        buf[_COVER * AREA + q] = max(cover, F(0)) * there  # rounding may leave less, or more of what is not there


@inline
def _lay(p, i, buf):  # type: ignore[no-untyped-def]
    """Lay stroke ``i``, whose coverage is in the scratch, under the strokes before it."""
    red, green, blue, op = p[i, 7], p[i, 8], p[i, 9], p[i, 10]
    for q in range(AREA):
        light = buf[_LIGHT * AREA + q]
        weight = light * op * buf[_COVER * AREA + q]
        buf[_RED * AREA + q] += weight * red
        buf[_GREEN * AREA + q] += weight * green
        buf[_BLUE * AREA + q] += weight * blue
        buf[_LIGHT * AREA + q] = light - weight


@inline
def _bright(buf, opaque):  # type: ignore[no-untyped-def]
    """Pixels that still let as much light through as ``opaque``: all of them if it is 0."""
    count = 0
    for q in range(AREA):
        count += 1 if buf[_LIGHT * AREA + q] >= opaque else 0
    return count


@inline
def _judge(p, i, target, top, left, buf):  # type: ignore[no-untyped-def]
    """Sum of alpha |color - target|^2 and of alpha of stroke ``i`` over the pixels of a tile."""
    red, green, blue, op = p[i, 7], p[i, 8], p[i, 9], p[i, 10]
    error, total = F(0), F(0)
    for y in range(min(TILE, target.shape[1] - top)):
        for x in range(min(TILE, target.shape[2] - left)):
            alpha = op * buf[_COVER * AREA + y * TILE + x]
            dr, dg, db = (
                red - target[0, top + y, left + x],
                green - target[1, top + y, left + x],
                blue - target[2, top + y, left + x],
            )
            error += alpha * (dr * dr + dg * dg + db * db)
            total += alpha
    return error, total


@inline
def _show(buf, background, top, left, image):  # type: ignore[no-untyped-def]
    """Write a finished tile into the picture, with the bare canvas where light comes through."""
    for y in range(min(TILE, image.shape[1] - top)):
        for x in range(min(TILE, image.shape[2] - left)):
            q = y * TILE + x
            light = buf[_LIGHT * AREA + q]
            for c in range(3):
                image[c, top + y, left + x] = buf[c * AREA + q] + light * background[c]


@kernel
def forward(p, first, stroke, slot, columns, background, soft, taper, opaque, target, image, used, nearest, errors):  # type: ignore[no-untyped-def]
    """Paint all tiles.

    Args:
        p: (N, 11) float32 strokes, front to back, as in COLUMNS.
        first: list of each tile, see `TileLists`.
        stroke: see `TileLists`.
        slot: see `TileLists`.
        columns: tiles per row.
        background: (3,) float32.
        soft: width of the edge, pixels.
        taper: 0 to 1.
        opaque: stop in a tile when no pixel lets more light than this through.
        target: (3, H, W), or (3, 0, 0) if no accuracy is wanted; with a target every stroke is looked at.
        image: (3, H, W), written.
        used: (tiles,) length of the list that was looked at, written.
        nearest: (pairs, 64) uint16, written for `backward`: the parameter t of each pixel in 65535ths; or (0, 64).
        errors: (pairs, 2) sum of alpha |color - target|^2 and of alpha, written if there is a target.
    """
    judge, keep = target.shape[1] > 0, len(nearest) > 0
    sharp = F(1) / soft
    for worker in prange(min(WORKERS, len(used))):
        buf = np.empty(ROWS * AREA, F)
        for tile in range(worker, len(used), WORKERS):
            top, left = tile // columns * TILE, tile % columns * TILE
            buf[: 3 * AREA] = F(0)
            buf[_LIGHT * AREA : (_LIGHT + 1) * AREA] = F(1)
            j = first[tile]
            while j < first[tile + 1]:
                i = stroke[j]
                find_nearest(p, i, F(left), F(top), buf)
                if keep:
                    keep_nearest(buf, nearest[j])
                _cover(p, i, F(left), F(top), sharp, taper, buf)
                _lay(p, i, buf)
                if judge:
                    errors[slot[j], 0], errors[slot[j], 1] = _judge(p, i, target, top, left, buf)
                j += 1
                if _bright(buf, opaque) == 0 and not judge:
                    break
            used[tile] = j - first[tile]
            _show(buf, background, top, left, image)


@inline
def _replay(p, strokes, nearest, ox, oy, sharp, taper, buf, kept):  # type: ignore[no-untyped-def]
    """Repeat the forward pass of a tile from the nearest points, keeping KEPT numbers per stroke and pixel."""
    buf[_LIGHT * AREA : (_LIGHT + 1) * AREA] = F(1)
    for k in range(len(strokes)):
        i = strokes[k]
        recall_nearest(p, i, ox, oy, nearest[k], buf)
        _cover(p, i, ox, oy, sharp, taper, buf)
        mine = kept[k * KEPT * AREA : (k + 1) * KEPT * AREA]  # a view: its indices are plainly not negative
        op = p[i, 10]
        for q in range(AREA):
            cover, light = buf[_COVER * AREA + q], buf[_LIGHT * AREA + q]
            mine[q] = buf[_T * AREA + q]
            mine[AREA + q] = buf[_DISTANCE * AREA + q]
            mine[2 * AREA + q] = cover
            mine[3 * AREA + q] = light
            buf[_LIGHT * AREA + q] = light - light * op * cover


@inline
def _load(grad_image, background, top, left, buf):  # type: ignore[no-untyped-def]
    """Put the picture's gradient into rows _LIGHT, _T, _BEST, and the bare canvas into those of the colour behind."""
    buf[_LIGHT * AREA : (_BEST + 1) * AREA] = F(0)  # pixels beyond the edge have no gradient
    for y in range(min(TILE, grad_image.shape[1] - top)):
        for c in range(3):
            line = grad_image[c, top + y, left:]
            for x in range(min(TILE, len(line))):
                buf[(_LIGHT + c) * AREA + y * TILE + x] = line[x]
    for c in range(3):
        buf[c * AREA : (c + 1) * AREA] = background[c]


@inline
def _gradient(p, i, ox, oy, sharp, taper, mine, buf, out):  # type: ignore[no-untyped-def]
    """Gradient (11,) of stroke ``i`` from one tile; the colour behind then includes the stroke."""
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    h, red, green, blue, op = p[i, 6], p[i, 7], p[i, 8], p[i, 9], p[i, 10]
    g0, g1, g2, g3, g4, g5 = F(0), F(0), F(0), F(0), F(0), F(0)
    g6, g7, g8, g9, g10 = F(0), F(0), F(0), F(0), F(0)
    for q in range(AREA):
        t, d, cover, light = mine[q], mine[AREA + q], mine[2 * AREA + q], mine[3 * AREA + q]
        gr, gg, gb = buf[_LIGHT * AREA + q], buf[_T * AREA + q], buf[_BEST * AREA + q]
        br, bg, bb = buf[_RED * AREA + q], buf[_GREEN * AREA + q], buf[_BLUE * AREA + q]
        alpha = op * cover
        g7 += light * alpha * gr
        g8 += light * alpha * gg
        g9 += light * alpha * gb
        ga = light * ((red - br) * gr + (green - bg) * gg + (blue - bb) * gb)
        buf[_RED * AREA + q] = br + alpha * (red - br)
        buf[_GREEN * AREA + q] = bg + alpha * (green - bg)
        buf[_BLUE * AREA + q] = bb + alpha * (blue - bb)
        g10 += ga * cover
        v = F(1) - t
        b0, b1, b2 = v * v, F(2) * t * v, t * t
        profile = F(1) - taper * (t - v) * (t - v)
        inner, outer = _slope((h * profile - d) * sharp), _slope((h * profile + d) * sharp)
        gh = ga * op * sharp * (inner + outer)
        gd = ga * op * sharp * (outer - inner) / max(d, F(1e-6))  # both slopes agree at d = 0
        g6 += gh * profile
        px = gd * (b0 * sx + b1 * cx + b2 * ex - F(q & 7) - F(0.5))
        py = gd * (b0 * sy + b1 * cy + b2 * ey - F(q >> 3) - F(0.5))
        g0 += px * b0
        g1 += py * b0
        g2 += px * b1
        g3 += py * b1
        g4 += px * b2
        g5 += py * b2
        buf[_COVER * AREA + q] = gh
    out[0], out[1], out[2], out[3], out[4], out[5] = g0, g1, g2, g3, g4, g5
    out[6], out[7], out[8], out[9], out[10] = g6, g7, g8, g9, g10


@inline
def _add_taper(p, i, ox, oy, taper, mine, buf, out):  # type: ignore[no-untyped-def]
    """Add to the gradient (11,) that the thickness depends on t, and t on the control points."""
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    bx, by, fx, fy = sx - F(2) * cx + ex, sy - F(2) * cy + ey, cx - sx, cy - sy
    floor = FLOOR * (bx * bx + by * by + F(3) * abs(bx * fx + by * fy) + F(2) * (fx * fx + fy * fy)) + F(1e-20)
    g0, g1, g2, g3, g4, g5 = F(0), F(0), F(0), F(0), F(0), F(0)
    for q in range(AREA):
        t = mine[q]
        v = F(1) - t
        u = t - v
        b0, b1, b2 = v * v, F(2) * t * v, t * t
        rx = b0 * sx + b1 * cx + b2 * ex - F(q & 7) - F(0.5)
        ry = b0 * sy + b1 * cy + b2 * ey - F(q >> 3) - F(0.5)
        dx, dy = bx * t + fx, by * t + fy
        bend = max(F(2) * (dx * dx + dy * dy) + bx * rx + by * ry, floor, STILL)
        gt = F(4) * buf[_COVER * AREA + q] * p[i, 6] * taper * u / bend
        gt = gt if t > F(0) else F(0)  # held at an end, t does not move
        gt = gt if t < F(1) else F(0)
        g0 += gt * (b0 * dx - v * rx)
        g1 += gt * (b0 * dy - v * ry)
        g2 += gt * (b1 * dx - u * rx)
        g3 += gt * (b1 * dy - u * ry)
        g4 += gt * (b2 * dx + t * rx)
        g5 += gt * (b2 * dy + t * ry)
    out[0] += g0
    out[1] += g1
    out[2] += g2
    out[3] += g3
    out[4] += g4
    out[5] += g5


@inline
def _deepest(used, worker):  # type: ignore[no-untyped-def]
    """Length of the longest list that was looked at in the tiles of a worker."""
    deepest = 0
    for tile in range(worker, len(used), WORKERS):
        deepest = max(deepest, used[tile])
    return deepest


@kernel
def backward(p, first, stroke, slot, columns, background, soft, taper, used, nearest, grad_image, grad_pairs):  # type: ignore[no-untyped-def]
    """Gradients of all pairs from the gradient of the picture.

    The forward pass of each tile is repeated, but for the search of nearest points; then its strokes are visited back
    to front with the colour behind them, which needs no division by 1 - alpha.

    Args:
        p: (N, 11) float32 strokes, front to back, as in COLUMNS.
        first: list of each tile, see `TileLists`.
        stroke: see `TileLists`.
        slot: see `TileLists`.
        columns: tiles per row.
        background: (3,) float32.
        soft: width of the edge, pixels.
        taper: 0 to 1.
        used: (tiles,) from `forward`.
        nearest: (pairs, 64) from `forward`.
        grad_image: (3, H, W).
        grad_pairs: (pairs, 11), written, by slot.
    """
    sharp = F(1) / soft
    for worker in prange(min(WORKERS, len(used))):
        buf, kept = np.empty(ROWS * AREA, F), np.empty(_deepest(used, worker) * KEPT * AREA, F)
        for tile in range(worker, len(used), WORKERS):
            top, left, n = tile // columns * TILE, tile % columns * TILE, used[tile]
            ox, oy = F(left), F(top)
            mine = stroke[first[tile] : first[tile] + n]
            slots = slot[first[tile] : first[tile + 1]]
            for k in range(n, len(slots)):
                grad_pairs[slots[k], :] = F(0)
            if n == 0:  # an empty tile
                continue
            _replay(p, mine, nearest[first[tile] : first[tile] + n], ox, oy, sharp, taper, buf, kept)
            _load(grad_image, background, top, left, buf)
            for back in range(n):
                k = n - 1 - back
                rows, out = kept[k * KEPT * AREA : (k + 1) * KEPT * AREA], grad_pairs[slots[k]]
                _gradient(p, mine[k], ox, oy, sharp, taper, rows, buf, out)
                if taper > F(0):
                    _add_taper(p, mine[k], ox, oy, taper, rows, buf, out)


@inline
def _miss(p, i, mine, buf):  # type: ignore[no-untyped-def]
    """What the weighted squared error would grow by in a tile without stroke ``i``; `_load` has brought the error."""
    red, green, blue, op = p[i, 7], p[i, 8], p[i, 9], p[i, 10]
    total = F(0)
    for q in range(AREA):
        alpha, light = op * mine[2 * AREA + q], mine[3 * AREA + q]
        er, eg, eb = buf[_LIGHT * AREA + q], buf[_T * AREA + q], buf[_BEST * AREA + q]
        br, bg, bb = buf[_RED * AREA + q], buf[_GREEN * AREA + q], buf[_BLUE * AREA + q]
        dr, dg, db = light * alpha * (br - red), light * alpha * (bg - green), light * alpha * (bb - blue)
        grown = dr * (dr + F(2) * er) + dg * (dg + F(2) * eg) + db * (db + F(2) * eb)
        total += buf[_COVER * AREA + q] * grown
        buf[_RED * AREA + q] = br + alpha * (red - br)
        buf[_GREEN * AREA + q] = bg + alpha * (green - bg)
        buf[_BLUE * AREA + q] = bb + alpha * (blue - bb)
    return total


@kernel
def worth(p, first, stroke, slot, columns, background, soft, taper, used, nearest, error, weight, pairs):  # type: ignore[no-untyped-def]
    """By how much the squared error of the picture would grow without each stroke, for all pairs.

    Args as of `backward`, but for:
        error: (3, H, W) picture less target.
        weight: (H, W) of each pixel.
        pairs: (pairs, 1), written, by slot.
    """
    sharp = F(1) / soft
    for worker in prange(min(WORKERS, len(used))):
        buf, kept = np.empty(ROWS * AREA, F), np.empty(_deepest(used, worker) * KEPT * AREA, F)
        for tile in range(worker, len(used), WORKERS):
            top, left, n = tile // columns * TILE, tile % columns * TILE, used[tile]
            ox, oy = F(left), F(top)
            mine = stroke[first[tile] : first[tile] + n]
            slots = slot[first[tile] : first[tile + 1]]
            for k in range(n, len(slots)):
                pairs[slots[k], 0] = F(0)
            if n == 0:
                continue
            _replay(p, mine, nearest[first[tile] : first[tile] + n], ox, oy, sharp, taper, buf, kept)
            _load(error, background, top, left, buf)
            buf[_COVER * AREA : (_COVER + 1) * AREA] = F(0)
            for y in range(min(TILE, weight.shape[0] - top)):
                for x in range(min(TILE, weight.shape[1] - left)):
                    buf[_COVER * AREA + y * TILE + x] = weight[top + y, left + x]
            for back in range(n):
                k = n - 1 - back
                pairs[slots[k], 0] = _miss(p, mine[k], kept[k * KEPT * AREA : (k + 1) * KEPT * AREA], buf)


@kernel
def sum_by_stroke(pairs, row, out):  # type: ignore[no-untyped-def]
    """Sum the rows of each stroke's pairs, in double precision and always in the same order."""
    for i in prange(len(out)):
        for c in range(pairs.shape[1]):
            total = 0.0
            for j in range(row[i], row[i + 1]):
                total += pairs[j, c]
            out[i, c] = total
