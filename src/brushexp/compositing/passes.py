"""The compiled passes over tiles of 8 x 8 pixels: a skeleton whose parts are supplied by each type of layer.

The only stored array of size strokes x pixels holds the nearest points. A tile's 64 pixels stay in the first-level
cache while its strokes are composited front to back ("over", Porter and Duff, 1984). The loops over the pixels have no
branches, so that they are compiled to SIMD code. The backward pass repeats the forward pass of a tile, except for the
search for nearest points. It then visits the strokes back to front and tracks the colour behind them, so that it never
divides by (1 - alpha); it needs only the dot product of that colour and the picture's gradient. The gradient of each
(tile, stroke) pair is written to a separate row, and rows are summed per stroke in double precision: there are no
atomics, and results are bit-for-bit identical on any number of threads.

Colours have CHANNELS channels. A pixel's alpha is computed once, and the loops over its channels are unrolled, because
the number of channels is known when a kernel is compiled (`channel_rows`).

The parts are the functions `seek`, `recall`, `cover`, `tint`, `shade`, `tone` and `pull`. The versions in this module
do nothing and document the interface; `TileKernel` replaces them with those of a type of layer. Their arguments are:

- ``p``: (N, C) float32, the numbers that describe the strokes; ``i``, the index of a stroke; ``data``, a tuple of the
  layers' other data; ``(ox, oy)``, the upper left corner of the tile in pixels.
- ``own``: ROWS rows of 64 numbers, one for each pixel of the tile (pixel q is in column q & 7 and row q >> 3), which
  belong to the stroke in this tile: `cover` writes the numbers that `shade` and `pull` read. Parts do not use row
  ABOVE; row NEAREST contains the nearest parameters if `seek` computes them.
- ``temporary``: TEMPORARY additional rows, for use within one part.
"""
# mypy: allow-untyped-defs

import numpy as np

from brushexp.compat.compiled import function, inline
from brushexp.compositing.scratch import BEHIND, CHANNELS, LIGHT, PICTURE, PULL_ALPHA, SCRATCH, WEIGHT, load_tile, show
from brushexp.compositing.tile_lists import ABOVE, AREA, TILE, F, most_tiles, tile_of

ROWS = TEMPORARY = 1


@inline
def seek(p, i, reach, ox, oy, own, near, j, keep):
    """Part: find the nearest points of stroke ``i``; if ``keep``, store them in row ``j`` of ``near`` for `recall`."""


@inline
def recall(p, i, ox, oy, own, near, j):
    """Part: restore the nearest points stored by `seek`."""


@inline
def cover(p, i, data, ox, oy, own, temporary):
    """Part: write the data of stroke ``i`` for a tile to ``own``; return whether the stroke covers any of the tile."""


@inline
def tint(p, i):
    """Part: return, as a tuple, the numbers of stroke ``i`` that `shade` and `tone` need at every pixel."""


@inline
def shade(look, own, q):
    """Part: return alpha at pixel ``q`` and any other numbers that `tone` needs; ``look`` is the result of `tint`."""


@inline
def tone(look, seen, own, q, c):
    """Part: return channel ``c`` of the colour at pixel ``q``, times alpha; ``seen`` is the result of `shade`."""


@inline
def pull(p, i, data, ox, oy, own, temporary, buf, out):
    """Part: write to ``out`` the gradient of the numbers of stroke ``i``, given the gradients of alpha and colour.

    The gradient of alpha is in row PULL_ALPHA of ``buf``; `of_color` computes the gradient of a channel. ``own`` may be
    overwritten.
    """


@inline
def of_color(own, buf, q, c):
    """Compute the derivative with respect to channel ``c`` of the result of `tone` at pixel ``q``."""
    return own[ABOVE * AREA + q] * buf[(PICTURE + c) * AREA + q]


@inline
def _lay(look, own, buf, opaque):
    """Composite a stroke beneath the strokes already laid.

    Returns how many pixels still transmit at least the fraction ``opaque`` of the light.
    """
    bright = F(0)
    for q in range(AREA):
        seen, light = shade(look, own, q), buf[LIGHT * AREA + q]
        _add_color(look, seen, own, q, light, buf)
        light -= light * seen[0]
        buf[LIGHT * AREA + q] = light
        bright += F(1) if light >= opaque else F(0)
    return bright


@inline
def _add_color(look, seen, own, q, light, buf):
    """Add a stroke's visible colour to a pixel.

    Like the other loops over channels, this one is in a separate function. If it were inside the loop over pixels, it
    would carry `c` from one pixel to the next, and the compiler would peel off the first pixel, which would misalign
    the others.
    """
    for c in range(CHANNELS):
        buf[c * AREA + q] += light * tone(look, seen, own, q, c)


@inline
def _judge(look, own, buf):
    """Sum a stroke's alpha |color - target|^2, and its alpha, over a tile; the target is in rows PICTURE."""
    error, total = F(0), F(0)
    for q in range(AREA):
        seen, square = shade(look, own, q), F(0)
        for c in range(CHANNELS):
            d = tone(look, seen, own, q, c) - seen[0] * buf[(PICTURE + c) * AREA + q]
            square += d * d
        error += buf[WEIGHT * AREA + q] * square / max(seen[0], F(1e-12))
        total += buf[WEIGHT * AREA + q] * seen[0]
    return error, total


@function
def forward_pass(
    begin, end, p, data, reach, order, first, stroke, slot, columns, background, opaque, target, image, used, there,
    near, errors,
):  # fmt: skip
    """Paint the tiles that belong to workers ``begin`` to ``end``, out of WORKERS workers.

    ``reach`` (N,) is as in `Layers`; ``order`` (N,) lists the strokes, top stroke first; ``first``, ``stroke`` and
    ``slot`` are as in `TileLists`, with ``columns`` tiles per row; ``background`` is (C,) float32. A tile is
    finished when no pixel transmits more than the fraction ``opaque`` of the light. With a ``target`` (C, H, W),
    however, every stroke is evaluated; ``target`` is (C, 0, 0) if there is none.

    Writes ``image`` (C, H, W); ``used`` (tiles,), the number of strokes in its list that each tile used; ``there``
    (pairs,), by slot and initially False, which tells whether a stroke covers the tile; ``near`` (pairs, 64) uint16 for
    `recall`, or (0, 64) if it is not needed; and, with a target, ``errors`` (pairs, 2), by slot, the sums of alpha
    |color - target|^2 and of alpha.
    """
    judge, keep = target.shape[1] > 0, len(near) > 0
    buf, own, temporary = np.empty(SCRATCH * AREA, F), np.empty(ROWS * AREA, F), np.empty(TEMPORARY * AREA, F)
    for worker in range(begin, end):
        for k in range(most_tiles(used)):
            tile = tile_of(worker, k)
            if tile >= len(used):
                break
            top, left = tile // columns * TILE, tile % columns * TILE
            buf[: LIGHT * AREA] = F(0)
            buf[LIGHT * AREA : (LIGHT + 1) * AREA] = F(1)
            if judge:
                load_tile(target, top, left, buf)
            j = first[tile]
            while j < first[tile + 1]:
                i = order[stroke[j]]
                seek(p, i, reach[i], F(left), F(top), own, near, j, keep)
                there[slot[j]] = cover(p, i, data, F(left), F(top), own, temporary)
                look = tint(p, i)
                bright = _lay(look, own, buf, opaque)
                if judge:
                    errors[slot[j], 0], errors[slot[j], 1] = _judge(look, own, buf)
                j += 1
                if bright == F(0) and not judge:
                    break
            used[tile] = j - first[tile]
            show(buf, background, top, left, image)


@inline
def _replay(p, data, order, stroke, slot, there, near, at, n, ox, oy, buf, kept, temporary):
    """Repeat a tile's forward pass from stored nearest points; keep each stroke's rows and the light reaching it."""
    buf[LIGHT * AREA : (LIGHT + 1) * AREA] = F(1)
    for k in range(n):
        if not there[slot[at + k]]:
            continue
        i = order[stroke[at + k]]
        own = kept[k * ROWS * AREA : (k + 1) * ROWS * AREA]  # a view; its indices are plainly not negative
        recall(p, i, ox, oy, own, near, at + k)
        cover(p, i, data, ox, oy, own, temporary)
        look = tint(p, i)
        for q in range(AREA):
            light = buf[LIGHT * AREA + q]
            own[ABOVE * AREA + q] = light
            buf[LIGHT * AREA + q] = light - light * shade(look, own, q)[0]


@inline
def _begin_behind(background, weighs, buf):
    """Initialise the colour behind the last stroke or, for `_step_back`, that colour's product with the gradient."""
    buf[: CHANNELS * AREA] = F(0)
    for c in range(CHANNELS):
        for q in range(AREA):
            if weighs:
                buf[c * AREA + q] = background[c]
            else:
                buf[BEHIND * AREA + q] += background[c] * buf[(PICTURE + c) * AREA + q]


@inline
def _step_back(look, own, buf):
    """Write the derivative with respect to a stroke's alpha, then composite the stroke over the colour behind it.

    The colour itself is not stored, only its product with the picture's gradient.
    """
    for q in range(AREA):
        seen, light, behind = shade(look, own, q), own[ABOVE * AREA + q], buf[BEHIND * AREA + q]
        painted = _product(look, seen, own, q, buf)
        buf[PULL_ALPHA * AREA + q] = -light * behind
        buf[BEHIND * AREA + q] = behind + (painted - seen[0] * behind)


@inline
def _product(look, seen, own, q, buf):
    """Compute the dot product of a stroke's premultiplied colour and the picture's gradient at a pixel."""
    total = F(0)
    for c in range(CHANNELS):
        total += buf[(PICTURE + c) * AREA + q] * tone(look, seen, own, q, c)
    return total


@inline
def _miss(look, own, buf):
    """Compute how much a tile's weighted squared error increases without a stroke, then composite the stroke."""
    total = F(0)
    for q in range(AREA):
        seen, light, grown = shade(look, own, q), own[ABOVE * AREA + q], F(0)
        for c in range(CHANNELS):
            d = seen[0] * buf[c * AREA + q] - tone(look, seen, own, q, c)
            grown += d * (light * d + F(2) * buf[(PICTURE + c) * AREA + q])
            buf[c * AREA + q] -= d
        total += buf[WEIGHT * AREA + q] * light * grown
    return total


@function
def backward_pass(
    begin, end, p, data, reach, order, first, stroke, slot, columns, background, used, there, near, picture,
    weighs, pairs,
):  # fmt: skip
    """Visit the strokes in the workers' tiles back to front, and compute the gradient of each (tile, stroke) pair.

    The arguments are those of `forward_pass`, including the arrays that it wrote. ``picture`` is the gradient of the
    image (C, H, W). With ``weighs``, it is instead image minus target, followed by the weight of each pixel (C + 1, H,
    W), and the output is the increase in the weighted squared error if a stroke is removed. Rows of ``pairs`` (pairs,
    .) are written only where ``there`` is true.
    """
    buf, temporary = np.empty(SCRATCH * AREA, F), np.empty(TEMPORARY * AREA, F)
    kept = np.empty(used.max() * ROWS * AREA, F)
    for worker in range(begin, end):
        for tile_of_worker in range(most_tiles(used)):
            tile = tile_of(worker, tile_of_worker)
            if tile >= len(used):
                break
            top, left, at, n = tile // columns * TILE, tile % columns * TILE, first[tile], used[tile]
            ox, oy = F(left), F(top)
            _replay(p, data, order, stroke, slot, there, near, at, n, ox, oy, buf, kept, temporary)
            load_tile(picture, top, left, buf)
            _begin_behind(background, weighs, buf)
            for back in range(n):
                k = n - 1 - back
                if not there[slot[at + k]]:
                    continue
                i, own = order[stroke[at + k]], kept[k * ROWS * AREA : (k + 1) * ROWS * AREA]
                look, out = tint(p, i), pairs[slot[at + k]]
                if weighs:
                    out[0] = _miss(look, own, buf)
                else:
                    _step_back(look, own, buf)
                    pull(p, i, data, ox, oy, own, temporary, buf, out)


@function
def sum_by_stroke(begin, end, pairs, there, row, order, out):
    """Sum the rows of ``pairs`` that belong to each stroke, in double precision and in a fixed order."""
    totals = np.empty(pairs.shape[1], np.float64)
    for i in range(begin, end):
        totals[:] = 0.0
        for j in range(row[i], row[i + 1]):
            if there[j]:
                _add(pairs[j], totals)
        _round(totals, out[order[i]])


@inline
def _add(values, totals):
    for c in range(len(totals)):
        totals[c] += values[c]


@inline
def _round(totals, out):
    for c in range(len(totals)):
        out[c] = totals[c]
