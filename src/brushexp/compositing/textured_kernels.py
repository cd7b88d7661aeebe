"""Compiled forward and backward passes for `TexturedProfile` layers.

As in `_kernels`, with whose parts this is built; what differs is what a stroke is at a pixel. There the coordinates
along and across the stroke are found and its texture is looked up: two loads bring the four texels around the place,
eight bits each of opacity and of light. The gradient goes to the curve through both coordinates; the textures are taken
as given.
"""

import numpy as np
from numba import prange

from brushexp.compositing.nearest import AREA, F, find_nearest, keep_nearest, recall_nearest
from brushexp.compositing.profile_kernels import WORKERS, _bright, _load, _show
from brushexp.compositing.tile_lists import TILE
from brushexp.system.compiled import inline, kernel

COLUMNS = 12  # of a stroke: those of `_kernels`, with half width and opacity as layers have them; texels per pixel
I = np.int32  # noqa: E741
STILL, STILL_PIXELS, LEAST, SHORTEST = F(1e-3), F(0.005), F(0.1), F(1 / 32)  # as in `renderer._frame`
# Rows of a tile's scratch, each AREA numbers; the first ones are those of `_kernels`.
_RED, _GREEN, _BLUE, _LIGHT, _T, _BEST, _X, _Y, _ALPHA, _SHADE = range(10)
ROWS = 10
KEPT = 4  # numbers that the backward pass keeps per stroke and pixel: t, place in the cell, light above


@inline
def _size(bx, by, fx, fy):  # type: ignore[no-untyped-def]
    """Squared size of a curve: of its velocity at both ends, halved."""
    return fx * fx + fy * fy + (fx + bx) * (fx + bx) + (fy + by) * (fy + by)


@inline
def _place(p, i, ox, oy, rows, columns, buf):  # type: ignore[no-untyped-def]
    """Write rows _X and _Y: where in its texture the pixels of a tile find stroke ``i``, in texels; from row _T."""
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    bx, by, fx, fy = sx - F(2) * cx + ex, sy - F(2) * cy + ey, cx - sx, cy - sy
    still = STILL * STILL * _size(bx, by, fx, fy) + STILL_PIXELS * STILL_PIXELS
    outer = F(-1) if fx * by - fy * bx > F(0) else F(1)
    body, scale, origin = F(columns - rows), p[i, 11], F(0.5) * F(rows) + F(0.5)
    for q in range(AREA):
        t = buf[_T * AREA + q]
        v = F(1) - t
        b0, b1, b2 = v * v, F(2) * t * v, t * t
        wx = F(q & 7) + F(0.5) - b0 * sx - b1 * cx - b2 * ex
        wy = F(q >> 3) + F(0.5) - b0 * sy - b1 * cy - b2 * ey
        dx, dy = fx + t * bx, fy + t * by
        speed, square = dx * dx + dy * dy, wx * wx + wy * wy
        moves = speed > still
        length = speed if moves else max(square, F(1e-30))
        tx, ty = (dx, dy) if moves else (outer * wy, -outer * wx)
        one = F(1) / np.sqrt(length)
        along = (tx * wx + ty * wy) * one
        along = F(0) if (t > F(0)) & (t < F(1)) else along
        across = (tx * wy - ty * wx) * one
        buf[_X * AREA + q] = min(max(origin + body * t + scale * along, F(0)), F(columns + 1))
        buf[_Y * AREA + q] = min(max(origin + scale * across, F(0)), F(rows + 1))


@inline
def _fetch(cells, first, columns, rows, buf, at, opacity, light):  # type: ignore[no-untyped-def]
    """Write the corners (AREA,) around the places in rows _X and _Y, and leave the places within the cell there.

    Args:
        cells: all textures as one line of cells: opacity in the lower word, light in the upper one.
        first: where this texture begins in it.
        columns: of texels, without the ring.
        rows: of texels, without the ring.
        buf: scratch.
        at: scratch (AREA,) int32.
        opacity: written.
        light: written.
    """
    for q in range(AREA):
        x, y = buf[_X * AREA + q], buf[_Y * AREA + q]
        column, row = min(I(x), I(columns)), min(I(y), I(rows))
        buf[_X * AREA + q] = x - F(column)
        buf[_Y * AREA + q] = y - F(row)
        at[q] = row * I(columns + 1) + column
    mine = cells[first : first + (rows + 1) * (columns + 1)]
    for q in range(AREA):  # apart from the arithmetic, which becomes SIMD code
        cell = mine[np.uint32(at[q])]
        opacity[q] = I(cell)
        light[q] = I(cell >> 32)


@inline
def _corner(word, k):  # type: ignore[no-untyped-def]
    return F((word >> I(8 * k)) & I(255))


@inline
def _mix(word, x, y):  # type: ignore[no-untyped-def]
    """Bilinear value between the four bytes of a word."""
    a, b, c, d = _corner(word, 0), _corner(word, 1), _corner(word, 2), _corner(word, 3)
    above, below = a + x * (b - a), c + x * (d - c)
    return above + y * (below - above)


@inline
def _cover(opacity, light, op, buf):  # type: ignore[no-untyped-def]
    """Write rows _ALPHA and _SHADE from the corners and the places in the cells; sum up the texture's opacity."""
    total = F(0)
    for q in range(AREA):
        x, y = buf[_X * AREA + q], buf[_Y * AREA + q]
        cover = _mix(opacity[q], x, y)
        buf[_ALPHA * AREA + q] = op * F(1 / 255) * cover
        buf[_SHADE * AREA + q] = F(1 / 127) * _mix(light[q], x, y) - F(128 / 127)
        total += cover
    return total


@inline
def _lay(p, i, buf):  # type: ignore[no-untyped-def]
    """Lay stroke ``i``, whose alpha and shade are in the scratch, under the strokes before it."""
    red, green, blue = p[i, 7], p[i, 8], p[i, 9]
    for q in range(AREA):
        through, alpha, shade = buf[_LIGHT * AREA + q], buf[_ALPHA * AREA + q], buf[_SHADE * AREA + q]
        weight = through * alpha
        pure, white = weight * (F(1) - abs(shade)), weight * max(shade, F(0))
        buf[_RED * AREA + q] += pure * red + white
        buf[_GREEN * AREA + q] += pure * green + white
        buf[_BLUE * AREA + q] += pure * blue + white
        buf[_LIGHT * AREA + q] = through - weight


@inline
def _judge(p, i, target, top, left, buf):  # type: ignore[no-untyped-def]
    """Sum of alpha |color - target|^2 and of alpha of stroke ``i`` over the pixels of a tile."""
    red, green, blue = p[i, 7], p[i, 8], p[i, 9]
    error, total = F(0), F(0)
    for y in range(min(TILE, target.shape[1] - top)):
        for x in range(min(TILE, target.shape[2] - left)):
            alpha, shade = buf[_ALPHA * AREA + y * TILE + x], buf[_SHADE * AREA + y * TILE + x]
            pure, white = F(1) - abs(shade), max(shade, F(0))
            dr = pure * red + white - target[0, top + y, left + x]
            dg = pure * green + white - target[1, top + y, left + x]
            db = pure * blue + white - target[2, top + y, left + x]
            error += alpha * (dr * dr + dg * dg + db * db)
            total += alpha
    return error, total


@kernel
def forward(p, brush, lists, columns, background, opaque, target, image, used, there, nearest, errors):  # type: ignore[no-untyped-def]
    """Paint all tiles.

    Args:
        p: (N, 12) float32 strokes, front to back, as in `COLUMNS`.
        brush: where the texture of each stroke begins (N,), all textures as one line of cells (see `_fetch`), and rows
            and columns of a texture without the ring.
        lists: first, stroke and slot of `TileLists`.
        columns: tiles per row.
        background: (3,) float32.
        opaque: stop in a tile when no pixel lets more light than this through.
        target: (3, H, W), or (3, 0, 0) if no accuracy is wanted; with a target every stroke is looked at.
        image: (3, H, W), written.
        used: (tiles,) length of the list that was looked at, written.
        there: (pairs,) bool, written: whether the stroke's texture is above 0 at any of the tile's pixels.
        nearest: (pairs, 64) uint16, written for `backward`: the parameter t of each pixel in 65535ths; or (0, 64).
        errors: (pairs, 2) sum of alpha |color - target|^2 and of alpha, written if there is a target.
    """
    judge, keep = target.shape[1] > 0, len(nearest) > 0
    first, stroke, slot = lists
    texture, cells, (rows, length) = brush  # a loop in parallel takes no tuples
    for worker in prange(min(WORKERS, len(used))):
        buf = np.empty(ROWS * AREA, F)
        at, opacity, light = np.empty(AREA, I), np.empty(AREA, I), np.empty(AREA, I)
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
                _place(p, i, F(left), F(top), rows, length, buf)
                _fetch(cells, texture[i], length, rows, buf, at, opacity, light)
                there[j] = _cover(opacity, light, p[i, 10], buf) > F(0)
                _lay(p, i, buf)
                if judge:
                    errors[slot[j], 0], errors[slot[j], 1] = _judge(p, i, target, top, left, buf)
                j += 1
                if _bright(buf, opaque) == 0 and not judge:
                    break
            used[tile] = j - first[tile]
            _show(buf, background, top, left, image)


@inline
def _replay(p, strokes, texture, cells, rows, length, there, nearest, ox, oy, buf, at, kept, words):  # type: ignore[no-untyped-def]
    """Repeat the forward pass of a tile from the nearest points; keep what `_shine` and `_move` need."""
    buf[_LIGHT * AREA : (_LIGHT + 1) * AREA] = F(1)
    for k in range(len(strokes)):
        if not there[k]:
            continue
        i = strokes[k]
        recall_nearest(p, i, ox, oy, nearest[k], buf)
        _place(p, i, ox, oy, rows, length, buf)
        mine = kept[k * KEPT * AREA : (k + 1) * KEPT * AREA]  # a view: its indices are plainly not negative
        corners = words[2 * k * AREA : (2 * k + 2) * AREA]
        opacity, light = corners[:AREA], corners[AREA:]
        _fetch(cells, texture[i], length, rows, buf, at, opacity, light)
        op = F(1 / 255) * p[i, 10]
        for q in range(AREA):
            through, x, y = buf[_LIGHT * AREA + q], buf[_X * AREA + q], buf[_Y * AREA + q]
            mine[q] = buf[_T * AREA + q]
            mine[AREA + q] = x
            mine[2 * AREA + q] = y
            mine[3 * AREA + q] = through
            buf[_LIGHT * AREA + q] = through - through * op * _mix(opacity[q], x, y)


@inline
def _shine(p, i, mine, opacity, shades, buf, out):  # type: ignore[no-untyped-def]
    """Gradient of stroke ``i``'s colour and opacity from one tile; the colour behind then includes the stroke.

    The gradient of the place in the texture replaces the place, in rows 1 and 2 of ``mine``.
    """
    red, green, blue, op = p[i, 7], p[i, 8], p[i, 9], p[i, 10] * F(1 / 255)
    g7, g8, g9, g10 = F(0), F(0), F(0), F(0)
    for q in range(AREA):
        x, y, light = mine[AREA + q], mine[2 * AREA + q], mine[3 * AREA + q]
        gr, gg, gb = buf[_LIGHT * AREA + q], buf[_T * AREA + q], buf[_BEST * AREA + q]
        br, bg, bb = buf[_RED * AREA + q], buf[_GREEN * AREA + q], buf[_BLUE * AREA + q]
        word = opacity[q]
        a, b, c, d = _corner(word, 0), _corner(word, 1), _corner(word, 2), _corner(word, 3)
        twist = a - b - c + d
        cover_x, cover_y = b - a + y * twist, c - a + x * twist
        cover = a + x * (b - a) + y * cover_y
        word = shades[q]
        a, b, c, d = _corner(word, 0), _corner(word, 1), _corner(word, 2), _corner(word, 3)
        twist = a - b - c + d
        shade_x, shade_y = b - a + y * twist, c - a + x * twist
        shade = F(1 / 127) * (a + x * (b - a) + y * shade_y) - F(128 / 127)
        alpha, pure, white = op * cover, F(1) - abs(shade), max(shade, F(0))
        dr, dg, db = pure * red + white - br, pure * green + white - bg, pure * blue + white - bb
        buf[_RED * AREA + q] = br + alpha * dr
        buf[_GREEN * AREA + q] = bg + alpha * dg
        buf[_BLUE * AREA + q] = bb + alpha * db
        weight = light * alpha
        tint = weight * pure
        g7 += tint * gr
        g8 += tint * gg
        g9 += tint * gb
        plain = red * gr + green * gg + blue * gb
        gs = F(1 / 127) * weight * (gr + gg + gb - plain if shade > F(0) else plain)
        ga = light * (dr * gr + dg * gg + db * gb)
        g10 += ga * cover
        mine[AREA + q] = ga * op * cover_x + gs * shade_x
        mine[2 * AREA + q] = ga * op * cover_y + gs * shade_y
    out[7], out[8], out[9], out[10] = g7, g8, g9, g10 * F(1 / 255)


@inline
def _move(p, i, ox, oy, body, mine, out):  # type: ignore[no-untyped-def]
    """Gradient of stroke ``i``'s curve and size from one tile, from that of the place in the texture (see `_shine`)."""
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    bx, by, fx, fy = sx - F(2) * cx + ex, sy - F(2) * cy + ey, cx - sx, cy - sy
    half, scale = p[i, 6], p[i, 11]
    size = _size(bx, by, fx, fy)
    still = STILL * STILL * size + STILL_PIXELS * STILL_PIXELS
    least, short = F(1) / np.sqrt(LEAST * size + F(1e-30)), LEAST * size + SHORTEST * half * half
    outer = F(-1) if fx * by - fy * bx > F(0) else F(1)
    g0, g1, g2, g3, g4, g5, g11 = F(0), F(0), F(0), F(0), F(0), F(0), F(0)
    for q in range(AREA):
        t, gx, gy = mine[q], mine[AREA + q], mine[2 * AREA + q]
        v = F(1) - t
        b0, b1, b2 = v * v, F(2) * t * v, t * t
        wx = F(q & 7) + F(0.5) - b0 * sx - b1 * cx - b2 * ex
        wy = F(q >> 3) + F(0.5) - b0 * sy - b1 * cy - b2 * ey
        dx, dy = fx + t * bx, fy + t * by
        speed, square = dx * dx + dy * dy, wx * wx + wy * wy
        moves, beside = speed > still, (t > F(0)) & (t < F(1))
        one = F(1) / np.sqrt(speed if moves else max(square, F(1e-30)))
        tx, ty = (dx * one, dy * one) if moves else (outer * wy * one, -outer * wx * one)
        along, across = F(0) if beside else tx * wx + ty * wy, tx * wy - ty * wx
        g11 += gx * along + gy * across
        gu, gv = F(0) if beside else gx * scale, gy * scale
        gt = body * gx / max(F(2) * speed - wx * bx - wy * by, short)
        gt = gt if beside else F(0)
        turn = (gu * across - gv * along) * min(one, least)
        turn = turn if moves else F(0)
        ax, ay = gv * ty - gu * tx - gt * dx, -gv * tx - gu * ty - gt * dy  # to the point of the curve
        vx, vy = gt * wx - turn * ty, gt * wy + turn * tx  # to the velocity there
        g0 += b0 * ax - v * vx
        g1 += b0 * ay - v * vy
        g2 += b1 * ax + (v - t) * vx
        g3 += b1 * ay + (v - t) * vy
        g4 += b2 * ax + t * vx
        g5 += b2 * ay + t * vy
    out[0], out[1], out[2], out[3], out[4], out[5] = g0, g1, g2, g3, g4, g5
    out[6], out[11] = F(0), g11


@kernel
def backward(p, brush, lists, columns, background, used, there, nearest, grad_image, grad_pairs):  # type: ignore[no-untyped-def]
    """Gradients of all pairs from the gradient of the picture, as `_kernels.backward`.

    Args:
        p: (N, 12) float32 strokes, front to back, as in `COLUMNS`.
        brush: as in `forward`.
        lists: as in `forward`.
        columns: tiles per row.
        background: (3,) float32.
        used: (tiles,) from `forward`.
        there: (pairs,) from `forward`.
        nearest: (pairs, 64) from `forward`.
        grad_image: (3, H, W).
        grad_pairs: (pairs, 12), written, by slot.
    """
    first, stroke, slot = lists
    texture, cells, (rows, length) = brush  # a loop in parallel takes no tuples
    for worker in prange(min(WORKERS, len(used))):
        deepest = 0
        for tile in range(worker, len(used), WORKERS):
            deepest = max(deepest, used[tile])
        buf, kept = np.empty(ROWS * AREA, F), np.empty(deepest * KEPT * AREA, F)
        at, words = np.empty(AREA, I), np.empty(deepest * 2 * AREA, I)
        for tile in range(worker, len(used), WORKERS):
            top, left, begin, n = tile // columns * TILE, tile % columns * TILE, first[tile], used[tile]
            if first[tile + 1] == begin:  # an empty tile
                continue
            ox, oy = F(left), F(top)
            mine, slots = stroke[begin : begin + n], slot[begin : first[tile + 1]]
            seen, near = there[begin : begin + n], nearest[begin : begin + n]
            _replay(p, mine, texture, cells, rows, length, seen, near, ox, oy, buf, at, kept, words)
            _load(grad_image, background, top, left, buf)
            for back in range(len(slots)):
                k = len(slots) - 1 - back
                out = grad_pairs[slots[k]]
                if k >= n or not seen[k]:
                    out[:] = F(0)
                    continue
                past = kept[k * KEPT * AREA : (k + 1) * KEPT * AREA]
                corners = words[2 * k * AREA : (2 * k + 2) * AREA]
                _shine(p, mine[k], past, corners[:AREA], corners[AREA:], buf, out)
                _move(p, mine[k], ox, oy, F(length - rows), past, out)
