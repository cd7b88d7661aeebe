"""The compiled passes over tiles of 8 x 8 pixels: one skeleton for every kind of layer, which brings its parts.

Nothing of size strokes x pixels is stored but a kind's nearest points. A tile's 64 pixels stay in the first-level cache
while its strokes are laid over each other front to back ("over", Porter and Duff, 1984); the loops over the pixels have
no branches, so that they become SIMD code. On the way back the forward pass of a tile is repeated, but for the search
of nearest points; then its strokes are visited back to front with the colour behind them, which needs no division by
1 - alpha. What a stroke receives from a tile goes to a row of its own, and rows are summed per stroke in double
precision: no atomics, and the same bits on any number of threads.

The parts are the functions `seek`, `recall`, `cover`, `tint`, `shade` and `pull`. Those here do nothing and say what is
expected; `TileKernel` puts those of a kind in their place. They are given:

- ``p``: (N, C) float32, the numbers of the strokes; ``i``, which stroke; ``data``, a tuple of whatever else belongs to
  the layers; ``(ox, oy)``, the upper left corner of the tile in pixels.
- ``own``: ROWS rows of 64 numbers, one for each pixel of the tile (pixel q at column q & 7 and row q >> 3), which
  belong to the stroke in this tile: `cover` writes what `shade` and `pull` read. Row ABOVE is not for the parts, row
  NEAREST has the nearest parameters if the kind seeks them.
- ``temporary``: TEMPORARY more rows, for use within one part.
"""
# mypy: allow-untyped-defs

import numpy as np

from brushexp.compositing.tile_lists import ABOVE, AREA, TILE, F
from brushexp.system.compiled import inline, kernel, prange

WORKERS = 64  # every so many tiles are one worker's: fixed, and enough to share the work evenly
# Rows of a worker's scratch: the picture so far (on the way back: the colour behind), the light that is left, three of
# the picture that is given (target, gradient or error), what its pixels count, and what `pull` is given.
RED, GREEN, BLUE, LIGHT, PICTURE, WEIGHT = 0, 1, 2, 3, 4, 7
PULL_RED, PULL_GREEN, PULL_BLUE, PULL_ALPHA = 7, 8, 9, 10
SCRATCH = 11
ROWS = TEMPORARY = 1


@inline
def seek(p, i, ox, oy, own, near, j, keep):
    """Part: find the nearest points of stroke ``i``; if ``keep``, leave them in row ``j`` of ``near`` for `recall`."""


@inline
def recall(p, i, ox, oy, own, near, j):
    """Part: bring the nearest points back."""


@inline
def cover(p, i, data, ox, oy, own, temporary):
    """Part: write into ``own`` what stroke ``i`` is in the tile, and return whether it is there at all."""


@inline
def tint(p, i):
    """Part: a tuple of the numbers of stroke ``i`` that `shade` needs at every pixel."""


@inline
def shade(look, own, q):
    """Part: alpha, red, green and blue at pixel ``q``, the colours multiplied by alpha; ``look`` is from `tint`."""


@inline
def pull(p, i, data, ox, oy, own, temporary, buf, out):
    """Part: write the gradient of the numbers of stroke ``i`` into ``out``, from that of what `shade` says.

    It is in rows PULL_ALPHA, PULL_RED, PULL_GREEN and PULL_BLUE of ``buf``; ``own`` may be written over.
    """


@inline
def _lay(look, own, buf):
    """Lay a stroke under those before it."""
    for q in range(AREA):
        alpha, red, green, blue = shade(look, own, q)
        light = buf[LIGHT * AREA + q]
        buf[RED * AREA + q] += light * red
        buf[GREEN * AREA + q] += light * green
        buf[BLUE * AREA + q] += light * blue
        buf[LIGHT * AREA + q] = light - light * alpha


@inline
def _bright(buf, opaque):
    """Pixels that still let as much light through as ``opaque``: all of them if it is 0."""
    count = 0
    for q in range(AREA):
        count += 1 if buf[LIGHT * AREA + q] >= opaque else 0
    return count


@inline
def _load(picture, top, left, buf):
    """Put a tile of a picture (3 or 4, H, W) into rows PICTURE and WEIGHT: 1 for three planes, 0 beyond the edge."""
    buf[PICTURE * AREA : (WEIGHT + 1) * AREA] = F(0)
    for y in range(min(TILE, picture.shape[1] - top)):
        for c in range(len(picture)):
            line = picture[c, top + y, left:]
            for x in range(min(TILE, len(line))):
                buf[WEIGHT * AREA + y * TILE + x] = F(1)
                buf[(PICTURE + c) * AREA + y * TILE + x] = line[x]


@inline
def _judge(look, own, buf):
    """Sum of alpha |color - target|^2 and of alpha of a stroke over the pixels of a tile, which `_load` has brought."""
    error, total = F(0), F(0)
    for q in range(AREA):
        alpha, red, green, blue = shade(look, own, q)
        dr = red - alpha * buf[PICTURE * AREA + q]
        dg = green - alpha * buf[(PICTURE + 1) * AREA + q]
        db = blue - alpha * buf[(PICTURE + 2) * AREA + q]
        error += buf[WEIGHT * AREA + q] * (dr * dr + dg * dg + db * db) / max(alpha, F(1e-12))
        total += buf[WEIGHT * AREA + q] * alpha
    return error, total


@inline
def _show(buf, background, top, left, image):
    """Write a finished tile into the picture, with the bare canvas where light comes through."""
    for y in range(min(TILE, image.shape[1] - top)):
        for x in range(min(TILE, image.shape[2] - left)):
            q = y * TILE + x
            light = buf[LIGHT * AREA + q]
            for c in range(3):
                image[c, top + y, left + x] = buf[c * AREA + q] + light * background[c]


@kernel
def forward_pass(
    p, data, order, first, stroke, slot, columns, background, opaque, target, image, used, there, near, errors
):
    """Paint all tiles.

    ``order`` (N,) are the strokes, the uppermost first; ``first``, ``stroke`` and ``slot`` are those of `TileLists`,
    with ``columns`` tiles per row; ``background`` is (3,) float32. A tile is finished when no pixel lets more light
    than ``opaque`` through; but with a ``target`` (3, H, W) every stroke is looked at. Without, it is (3, 0, 0).

    Written are ``image`` (3, H, W); how much of its list was ``used`` by each tile (tiles,); by slot whether a stroke
    is ``there`` (pairs,), False before; ``near`` (pairs, 64) uint16 for `recall`, or (0, 64); and with a target
    ``errors`` (pairs, 2), the sums of alpha |color - target|^2 and of alpha.
    """
    judge, keep = target.shape[1] > 0, len(near) > 0
    for worker in prange(min(WORKERS, len(used))):
        buf, own, temporary = np.empty(SCRATCH * AREA, F), np.empty(ROWS * AREA, F), np.empty(TEMPORARY * AREA, F)
        for tile in range(worker, len(used), WORKERS):
            top, left = tile // columns * TILE, tile % columns * TILE
            buf[: LIGHT * AREA] = F(0)
            buf[LIGHT * AREA : (LIGHT + 1) * AREA] = F(1)
            if judge:
                _load(target, top, left, buf)
            j = first[tile]
            while j < first[tile + 1]:
                i = order[stroke[j]]
                seek(p, i, F(left), F(top), own, near, j, keep)
                there[slot[j]] = cover(p, i, data, F(left), F(top), own, temporary)
                look = tint(p, i)
                _lay(look, own, buf)
                if judge:
                    errors[slot[j], 0], errors[slot[j], 1] = _judge(look, own, buf)
                j += 1
                if _bright(buf, opaque) == 0 and not judge:
                    break
            used[tile] = j - first[tile]
            _show(buf, background, top, left, image)


@inline
def _replay(p, data, order, stroke, slot, there, near, begin, n, ox, oy, buf, kept, temporary):
    """Repeat the forward pass of a tile from the nearest points; keep the rows of each stroke and the light above."""
    buf[LIGHT * AREA : (LIGHT + 1) * AREA] = F(1)
    for k in range(n):
        if not there[slot[begin + k]]:
            continue
        i = order[stroke[begin + k]]
        own = kept[k * ROWS * AREA : (k + 1) * ROWS * AREA]  # a view: its indices are plainly not negative
        recall(p, i, ox, oy, own, near, begin + k)
        cover(p, i, data, ox, oy, own, temporary)
        look = tint(p, i)
        for q in range(AREA):
            alpha, _, _, _ = shade(look, own, q)
            light = buf[LIGHT * AREA + q]
            own[ABOVE * AREA + q] = light
            buf[LIGHT * AREA + q] = light - light * alpha


@inline
def _step_back(look, own, buf):
    """Write the gradient of what `shade` says of a stroke; the colour behind then includes the stroke."""
    for q in range(AREA):
        alpha, red, green, blue = shade(look, own, q)
        light = own[ABOVE * AREA + q]
        gr, gg = light * buf[PICTURE * AREA + q], light * buf[(PICTURE + 1) * AREA + q]
        gb = light * buf[(PICTURE + 2) * AREA + q]
        br, bg, bb = buf[RED * AREA + q], buf[GREEN * AREA + q], buf[BLUE * AREA + q]
        buf[PULL_RED * AREA + q] = gr
        buf[PULL_GREEN * AREA + q] = gg
        buf[PULL_BLUE * AREA + q] = gb
        buf[PULL_ALPHA * AREA + q] = -(br * gr + bg * gg + bb * gb)
        buf[RED * AREA + q] = br + (red - alpha * br)
        buf[GREEN * AREA + q] = bg + (green - alpha * bg)
        buf[BLUE * AREA + q] = bb + (blue - alpha * bb)


@inline
def visit(p, i, data, ox, oy, own, temporary, buf, out):
    """What is done with stroke ``i`` on the way back: here, write the gradient of its numbers into ``out``."""
    _step_back(tint(p, i), own, buf)
    pull(p, i, data, ox, oy, own, temporary, buf, out)


@inline
def weigh(p, i, data, ox, oy, own, temporary, buf, out):
    """In place of `visit`: write what the weighted squared error would grow by in the tile without the stroke."""
    out[0] = _miss(tint(p, i), own, buf)


@inline
def _miss(look, own, buf):
    """What the weighted squared error would grow by in a tile without a stroke; the colour behind then includes it."""
    total = F(0)
    for q in range(AREA):
        alpha, red, green, blue = shade(look, own, q)
        light = own[ABOVE * AREA + q]
        er, eg, eb = buf[PICTURE * AREA + q], buf[(PICTURE + 1) * AREA + q], buf[(PICTURE + 2) * AREA + q]
        dr = alpha * buf[RED * AREA + q] - red
        dg = alpha * buf[GREEN * AREA + q] - green
        db = alpha * buf[BLUE * AREA + q] - blue
        grown = dr * (light * dr + F(2) * er) + dg * (light * dg + F(2) * eg) + db * (light * db + F(2) * eb)
        total += buf[WEIGHT * AREA + q] * light * grown
        buf[RED * AREA + q] -= dr
        buf[GREEN * AREA + q] -= dg
        buf[BLUE * AREA + q] -= db
    return total


@kernel
def backward_pass(p, data, order, first, stroke, slot, columns, background, used, there, near, picture, pairs):
    """Visit the strokes of all tiles back to front: by default, for the gradients of all pairs.

    Arguments as of `forward_pass`, with what it wrote. ``picture`` is the gradient of the image (3, H, W); for `weigh`
    it is image less target, and the weight of each pixel (4, H, W). ``pairs`` (pairs, .) is written where ``there``.
    """
    for worker in prange(min(WORKERS, len(used))):
        buf, temporary = np.empty(SCRATCH * AREA, F), np.empty(TEMPORARY * AREA, F)
        kept = np.empty(used[worker::WORKERS].max() * ROWS * AREA, F)
        for tile in range(worker, len(used), WORKERS):
            top, left, begin, n = tile // columns * TILE, tile % columns * TILE, first[tile], used[tile]
            ox, oy = F(left), F(top)
            _replay(p, data, order, stroke, slot, there, near, begin, n, ox, oy, buf, kept, temporary)
            _load(picture, top, left, buf)
            for c in range(3):  # the bare canvas lies behind the last stroke
                buf[c * AREA : (c + 1) * AREA] = background[c]
            for back in range(n):
                k = n - 1 - back
                if not there[slot[begin + k]]:
                    continue
                i, own = order[stroke[begin + k]], kept[k * ROWS * AREA : (k + 1) * ROWS * AREA]
                visit(p, i, data, ox, oy, own, temporary, buf, pairs[slot[begin + k]])


@kernel
def sum_by_stroke(pairs, there, row, order, out):
    """Sum the rows of each stroke's pairs, in double precision and always in the same order."""
    for i in prange(len(order)):
        for c in range(pairs.shape[1]):
            total = 0.0
            for j in range(row[i], row[i + 1]):
                if there[j]:
                    total += pairs[j, c]
            out[order[i], c] = total
