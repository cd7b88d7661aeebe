"""The compiled passes over tiles of 8 x 8 pixels: one skeleton for every type of layer, which supplies its parts.

The only stored array of size strokes x pixels holds a kind's nearest points. A tile's 64 pixels stay in the first-level
cache while its strokes are composited front to back ("over", Porter and Duff, 1984); the loops over the pixels have no
branches, so that they become SIMD code. The backward pass repeats the forward pass of a tile, except for the search for
nearest points. It then visits the strokes back to front and tracks what lies behind them, so that nothing is divided by
(1 - alpha); of the colours behind, it needs only the sum of their products with the gradient of the picture. The
gradient of a stroke in a tile goes to its own row, and rows are summed per stroke in double precision: there are no
atomics, and results are bit-for-bit identical on any number of threads.

Colours have CHANNELS numbers. A pixel's alpha is computed once, and the loops over its channels are unrolled, because
their number is known when a kernel is compiled (`channel_rows`).

The parts are the functions `seek`, `recall`, `cover`, `tint`, `shade`, `tone` and `pull`. The versions here do nothing
and document the interface; `TileKernel` replaces them by those of a type of layer. Their arguments are:

- ``p``: (N, C) float32, the numbers of the strokes; ``i``, the index of a stroke; ``data``, a tuple of any other data
  of the layers; ``(ox, oy)``, the upper left corner of the tile in pixels.
- ``own``: ROWS rows of 64 numbers, one for each pixel of the tile (pixel q at column q & 7 and row q >> 3), which
  belong to the stroke in this tile: `cover` writes what `shade` and `pull` read. Parts do not use row ABOVE; row
  NEAREST has the nearest parameters if the kind seeks them.
- ``temporary``: TEMPORARY more rows, for use within one part.
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
    """Part: restore the nearest points."""


@inline
def cover(p, i, data, ox, oy, own, temporary):
    """Part: write the data of stroke ``i`` for this tile into ``own``; return whether it covers any of the tile."""


@inline
def tint(p, i):
    """Part: return the numbers of stroke ``i`` that `shade` and `tone` need at every pixel, as a tuple."""


@inline
def shade(look, own, q):
    """Part: return alpha at pixel ``q`` and any other numbers that `tone` needs there; ``look`` comes from `tint`."""


@inline
def tone(look, seen, own, q, c):
    """Part: return channel ``c`` of the colour at pixel ``q``, multiplied by alpha; ``seen`` comes from `shade`."""


@inline
def pull(p, i, data, ox, oy, own, temporary, buf, out):
    """Part: write the gradient of the numbers of stroke ``i`` into ``out``, given the gradients of alpha and colour.

    The gradient of alpha is in row PULL_ALPHA of ``buf``; `of_color` computes the gradient of a channel. ``own`` may be
    overwritten.
    """


@inline
def of_color(own, buf, q, c):
    """Compute the derivative with respect to channel ``c`` of the result of `tone` at pixel ``q``."""
    return own[ABOVE * AREA + q] * buf[(PICTURE + c) * AREA + q]


@inline
def _lay(look, own, buf, opaque):
    """Composite a stroke beneath those above it; return how many pixels still transmit at least ``opaque``."""
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
    """Add the visible colour of a stroke at a pixel.

    This is a separate function, like other loops over channels: inside the loop over pixels it would carry `c` from one
    pixel to the next, and the compiler would peel off the first pixel, which misaligns the others.
    """
    for c in range(CHANNELS):
        buf[c * AREA + q] += light * tone(look, seen, own, q, c)


@inline
def _judge(look, own, buf):
    """Sum alpha |color - target|^2 and alpha of a stroke over a tile whose target is in rows PICTURE."""
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
    """Paint the tiles that belong to workers ``begin`` to ``end``, out of WORKERS.

    ``reach`` (N,) is that of `Layers`; ``order`` (N,) lists the strokes, top stroke first; ``first``, ``stroke`` and
    ``slot`` are those of `TileLists`, with ``columns`` tiles per row; ``background`` is (C,) float32. A tile is
    finished when no pixel transmits more light than ``opaque``; with a ``target`` (C, H, W), however, every stroke is
    evaluated. Without a target it is (C, 0, 0).

    Writes ``image`` (C, H, W); ``used`` (tiles,), how much of its list each tile used; by slot, ``there`` (pairs,),
    whether a stroke covers the tile, False before; ``near`` (pairs, 64) uint16 for `recall`, or (0, 64); and with a
    target, ``errors`` (pairs, 2), the sums of alpha |color - target|^2 and of alpha.
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
    """Repeat the forward pass of a tile from its nearest points; keep each stroke's rows and the light reaching it."""
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
    """Set up the bare canvas behind the last stroke: its colour, or its product with the gradient for `_step_back`."""
    buf[: CHANNELS * AREA] = F(0)
    for c in range(CHANNELS):
        for q in range(AREA):
            if weighs:
                buf[c * AREA + q] = background[c]
            else:
                buf[BEHIND * AREA + q] += background[c] * buf[(PICTURE + c) * AREA + q]


@inline
def _step_back(look, own, buf):
    """Write the derivative with respect to a stroke's alpha, then add the stroke to what is behind the next one.

    Only the product of the colour behind with the gradient of the picture is needed.
    """
    for q in range(AREA):
        seen, light, behind = shade(look, own, q), own[ABOVE * AREA + q], buf[BEHIND * AREA + q]
        painted = _product(look, seen, own, q, buf)
        buf[PULL_ALPHA * AREA + q] = -light * behind
        buf[BEHIND * AREA + q] = behind + (painted - seen[0] * behind)


@inline
def _product(look, seen, own, q, buf):
    """Compute the dot product, over channels, of a stroke's colour at a pixel and the gradient of the picture."""
    total = F(0)
    for c in range(CHANNELS):
        total += buf[(PICTURE + c) * AREA + q] * tone(look, seen, own, q, c)
    return total


@inline
def _miss(look, own, buf):
    """Compute how much a tile's weighted squared error grows if a stroke is removed; add it to the colour behind."""
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
    """Visit the strokes in these workers' tiles back to front, and compute the gradients of all pairs.

    The arguments are those of `forward_pass`, with the arrays it wrote. ``picture`` is the gradient of the image (C, H,
    W). With ``weighs``, it is instead image minus target, followed by the weight of each pixel (C + 1, H, W), and the
    output is the increase in the weighted squared error if a stroke is removed. ``pairs`` (pairs, .) is written where
    they are ``there``.
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
    """Sum the rows of each stroke's pairs, in double precision and in a fixed order."""
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
