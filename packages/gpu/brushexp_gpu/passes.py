"""Passes over the tiles, in which each program composites the strokes of a few tiles, chunk by chunk.

For each pair of a tile and a stroke, the forward pass stores the nearest points and the light that the strokes above
transmit; for each chunk on its own, it stores the colour and the transmitted light. From these, `behind_pass` computes
the colour behind each chunk, without dividing by light that has almost vanished, so that the backward pass can visit
all chunks in parallel. Each pair writes its contribution to a separate row, and `sum_rows` adds the rows in a fixed
order, without atomics.

The arguments ``strokes`` (N, width), ``begin``, ``cells`` and ``frames`` come from `KernelInput`, and ``first`` (tiles
+ 1,), ``stroke``, ``slot`` and ``part`` (pairs,), and ``chunks`` (tiles + 1,) from `Lists`. ``used`` (tiles,) is the
number of chunks painted per tile. There are C channels, padded to CP, a power of 2.
"""
# mypy: allow-untyped-defs

import triton.language as tl
from triton import jit

from brushexp_gpu.curves import AREA, CURVE_PARTS, find_nearest, load_curve, pixels, sum_pixels
from brushexp_gpu.launch import inline
from brushexp_gpu.plain import plain_cover, plain_pull
from brushexp_gpu.planes import (
    load_bare,
    load_number,
    load_paint,
    load_planes,
    pixel_places,
    store_colors,
    store_planes,
)
from brushexp_gpu.textured import look_up, textured_pull

SIZES = ["tiles", "columns", "height", "width", "numbers"]  # sizes that kernels are not specialised for


@inline
def _seek(part, j, sx, sy, fx, fy, bx, by, here):
    """Find the parameters (TILES, AREA) of the nearest points on the listed parts of the curves."""
    bounds = tl.load(part + j, here, 0)[:, None]
    low, high = (bounds & 255).to(tl.float32) / CURVE_PARTS, (bounds >> 8).to(tl.float32) / CURVE_PARTS
    x, y = pixels()
    return find_nearest(sx, sy, fx, fy, bx, by, low, high, x, y)


@inline
def _look(t, sx, sy, fx, fy, bx, by, strokes, begin, cells, frames, i, at, taper, here, TEXTURED: tl.constexpr):
    """Compute coverage before opacity (0 unless ``here``) and tone (TILES, AREA), each with its two texture slopes."""
    x, y = pixels()
    if TEXTURED:
        scale = load_number(strokes, at, 8, here)
        cover, cover_u, cover_v, tone, tone_u, tone_v = look_up(
            t, sx, sy, fx, fy, bx, by, x, y, begin, cells, frames, i, scale, here
        )
        cover, cover_u, cover_v = cover / 255.0, cover_u / 255.0, cover_v / 255.0
    else:
        half, sharp = load_number(strokes, at, 6, here), load_number(strokes, at, 8, here)
        widening = load_number(strokes, at, 9, here)
        cover = plain_cover(t, sx, sy, fx, fy, bx, by, x, y, half, sharp, widening, taper)
        tone = tl.zeros_like(cover)
        cover_u, cover_v, tone_u, tone_v = tone, tone, tone, tone
    return tl.where(here[:, None], cover, 0.0), cover_u, cover_v, tone, tone_u, tone_v


@inline
def _judge(errors, pair, shown, goal, there, alpha, here, C: tl.constexpr, CP: tl.constexpr):
    """Write two sums over each tile's pixels, one of alpha |color - target|^2 and one of alpha."""
    d = tl.where(there[None] & (tl.arange(0, CP)[:, None, None] < C), shown - goal, 0.0)
    tl.store(errors + 2 * pair, sum_pixels(alpha * tl.sum(d * d, axis=0)), here)
    tl.store(errors + 2 * pair + 1, sum_pixels(tl.where(there, alpha, 0.0)), here)


@inline
def _store_state(states, chunk, own, clear, here, C: tl.constexpr, CP: tl.constexpr):
    """Write the colour (CP, TILES, AREA) of each chunk and the light (TILES, AREA) that it transmits."""
    q, c = tl.arange(0, AREA)[None, :], tl.arange(0, CP)[:, None, None]
    at = states + (chunk * (C + 1) * AREA)[:, None] + q
    tl.store(at[None] + c * AREA, own, here[None, :, None] & (c < C))
    tl.store(at + C * AREA, clear, here[:, None])


@jit(do_not_specialize=SIZES)
def forward_pass(
    strokes, begin, cells, frames, taper, stroke, slot, part, first, chunks, background, opaque, target, image,
    used, near, above, states, errors, tiles, columns, height, width, numbers,
    C: tl.constexpr, CP: tl.constexpr, TILES: tl.constexpr, CHUNK: tl.constexpr, TEXTURED: tl.constexpr,
    DRIFTS: tl.constexpr, JUDGE: tl.constexpr, KEEP: tl.constexpr,
):  # fmt: skip
    """Paint ``image`` (C, H, W), and count the painted chunks in ``used``.

    A tile is finished if, at the end of a chunk, less light than ``opaque`` remains at every pixel. With JUDGE, the
    pass visits every stroke regardless, compares it with a ``target`` (C, H, W), and writes, for each slot, the sums of
    alpha |color - target|^2 and of alpha to ``errors`` (pairs, 2). With KEEP, it writes the input of the backward pass:
    ``near`` and ``above`` (pairs, AREA), and ``states`` (chunks, C + 1, AREA), whose last channel is the transmitted
    light.
    """
    tile = tl.program_id(0) * TILES + tl.arange(0, TILES)
    inside = tile < tiles
    at = tl.load(first + tile, inside, 0)
    count = (tl.load(first + tile + 1, inside, 0) - at).to(tl.int32)
    chunk = tl.load(chunks + tile, inside, 0)
    place, there, ox, oy = pixel_places(tile, columns, height, width, inside)
    q = tl.arange(0, AREA)[None, :]
    color, light = tl.zeros((CP, TILES, AREA), tl.float32), tl.full((TILES, AREA), 1.0, tl.float32)
    done = tl.zeros((TILES,), tl.int32)
    begun, longest = 0, tl.max(count)
    while begun < longest:
        own, clear = tl.zeros((CP, TILES, AREA), tl.float32), tl.full((TILES, AREA), 1.0, tl.float32)
        for k in range(begun, tl.minimum(begun + CHUNK, longest)):
            here = k < count
            i = tl.load(stroke + at + k, here, 0)
            row = i * numbers
            sx, sy, fx, fy, bx, by = load_curve(strokes, row, ox, oy, here)
            t = _seek(part, at + k, sx, sy, fx, fy, bx, by, here)
            cover, _, _, tone, _, _ = _look(
                t, sx, sy, fx, fy, bx, by, strokes, begin, cells, frames, i, row, taper, here, TEXTURED
            )
            alpha = cover * load_number(strokes, row, 7, here)
            paint, _ = load_paint(strokes, row, t, here, C, CP, TEXTURED, DRIFTS)
            shown = paint * (1.0 - tl.abs(tone))[None] + tl.maximum(tone, 0.0)[None]
            if KEEP:
                pair = (at + k)[:, None] * AREA + q
                tl.store(near + pair, t, here[:, None])
                tl.store(above + pair, light * clear, here[:, None])
            if JUDGE:
                goal = load_planes(target, place, there, height, width, C, CP)
                _judge(errors, tl.load(slot + at + k, here, 0), shown, goal, there, alpha, here, C, CP)
            own += shown * (clear * alpha)[None]
            clear -= clear * alpha
        if KEEP:
            _store_state(states, chunk + begun // CHUNK, own, clear, begun < count, C, CP)
        color += own * light[None]
        light *= clear
        done += (begun < count).to(tl.int32)
        if not JUDGE:
            count = tl.where(tl.max(light, axis=1) >= opaque, count, 0)
        begun += CHUNK
        longest = tl.max(count)
    color += load_bare(background, C, CP) * light[None]
    store_planes(image, color, place, there, height, width, C, CP)
    tl.store(used + tile, done, inside)


@jit(do_not_specialize=SIZES)
def behind_pass(
    states, behinds, chunks, chunk_tile, used, background, tiles,
    C: tl.constexpr, CP: tl.constexpr, TILES: tl.constexpr,
):  # fmt: skip
    """Write the colour behind each chunk, including the bare canvas, to ``behinds`` (chunks, C, AREA).

    ``chunk_tile`` (chunks,) receives the tile of each chunk, or -1 if the chunk was not painted.
    """
    tile = tl.program_id(0) * TILES + tl.arange(0, TILES)
    inside = tile < tiles
    chunk, count = tl.load(chunks + tile, inside, 0), tl.load(used + tile, inside, 0)
    listed = (tl.load(chunks + tile + 1, inside, 0) - chunk).to(tl.int32)
    for k in range(0, tl.max(listed)):
        tl.store(chunk_tile + chunk + k, tl.where(k < count, tile, -1), k < listed)
    q, c = tl.arange(0, AREA)[None, :], tl.arange(0, CP)[:, None, None]
    behind = tl.zeros((CP, TILES, AREA), tl.float32) + load_bare(background, C, CP)
    for back in range(0, tl.max(count)):
        here = back < count
        row, mask = chunk + count - 1 - back, here[None, :, None] & (c < C)
        own = (row * (C + 1) * AREA)[:, None] + q
        tl.store(behinds + (row * C * AREA)[None, :, None] + c * AREA + q[None], behind, mask)
        clear = tl.load(states + own + C * AREA, here[:, None], 1.0)
        behind = tl.load(states + own[None] + c * AREA, mask, 0.0) + behind * clear[None]


@inline
def _open_chunks(first, chunks, chunk_tile, tiles, CHUNK: tl.constexpr, TILES: tl.constexpr):
    """Return a program's chunks (TILES,), their tiles, whether they were painted, their first pairs and pair counts."""
    chunk = tl.program_id(0) * TILES + tl.arange(0, TILES)
    tile = tl.load(chunk_tile + chunk, chunk < tl.load(chunks + tiles), -1)
    inside = tile >= 0
    number = (chunk - tl.load(chunks + tile, inside, 0)).to(tl.int32)
    at = tl.load(first + tile, inside, 0)
    count = (tl.load(first + tile + 1, inside, 0) - at).to(tl.int32) - number * CHUNK
    return chunk.to(tl.int64), tile, inside, at + number * CHUNK, tl.where(inside, tl.minimum(count, CHUNK), 0)


@jit(do_not_specialize=SIZES)
def backward_pass(
    strokes, begin, cells, frames, taper, stroke, slot, first, chunks, chunk_tile, near, above, behinds,
    picture, pairs, tiles, columns, height, width, numbers,
    C: tl.constexpr, CP: tl.constexpr, TILES: tl.constexpr, CHUNK: tl.constexpr, TEXTURED: tl.constexpr,
    DRIFTS: tl.constexpr, WEIGHS: tl.constexpr,
):  # fmt: skip
    """Write the gradient or the importance of each stroke in each tile, visiting every chunk's strokes back to front.

    The pass follows `behind_pass`, which determines each chunk's ``chunk_tile``. The input ``picture`` is the gradient
    of the image (C, H, W), and the output ``pairs`` (pairs, numbers) is the gradient of the strokes' numbers for each
    slot. With WEIGHS, ``picture`` (C + 1, H, W) is image - target followed by the weight of each pixel, and ``pairs``
    (pairs, 1) is the increase in the weighted squared error that removing the stroke would cause.
    """
    chunk, tile, inside, at, count = _open_chunks(first, chunks, chunk_tile, tiles, CHUNK, TILES)
    place, there, ox, oy = pixel_places(tile, columns, height, width, inside)
    q, c = tl.arange(0, AREA)[None, :], tl.arange(0, CP)[:, None, None]
    given = load_planes(picture, place, there, height, width, C, CP)
    state = (chunk * C * AREA)[None, :, None] + c * AREA + q[None]
    behind = tl.load(behinds + state, inside[None, :, None] & (c < C), 0.0)
    if WEIGHS:
        weight = tl.load(picture + C * height.to(tl.int64) * width + place, there, 0.0)
    else:
        behind = tl.sum(behind * given, axis=0)  # the only use of the colour behind
    for back in range(0, tl.max(count)):
        k = count - 1 - back
        here = k >= 0
        i = tl.load(stroke + at + k, here, 0)
        row, pair = i * numbers, (at + k)[:, None] * AREA + q
        t, light = tl.load(near + pair, here[:, None], 0.0), tl.load(above + pair, here[:, None], 0.0)
        sx, sy, fx, fy, bx, by = load_curve(strokes, row, ox, oy, here)
        cover, cover_u, cover_v, tone, tone_u, tone_v = _look(
            t, sx, sy, fx, fy, bx, by, strokes, begin, cells, frames, i, row, taper, here, TEXTURED
        )
        opacity = load_number(strokes, row, 7, here)
        paint, drift = load_paint(strokes, row, t, here, C, CP, TEXTURED, DRIFTS)
        alpha, pure, white = cover * opacity, 1.0 - tl.abs(tone), tl.maximum(tone, 0.0)
        out = pairs + tl.load(slot + at + k, here, 0) * (1 if WEIGHS else numbers)
        if WEIGHS:
            d = tl.where(c < C, (behind - paint * pure[None] - white[None]) * alpha[None], 0.0)
            grown = tl.sum(d * (light[None] * d + 2.0 * given), axis=0)
            tl.store(out, sum_pixels(weight * light * grown), here)
            behind -= d
        else:
            plain, every = tl.sum(paint * given, axis=0), tl.sum(given, axis=0)
            shown = pure * plain + white * every
            ga = light * (shown - behind)
            seen = light * alpha * pure
            _pull_color(out, cover, ga, given, seen, t, here, C, CP, TEXTURED, DRIFTS)
            x, y = pixels()
            half = load_number(strokes, row, 6, here)
            if TEXTURED:
                gs = light * alpha * tl.where(tone > 0.0, every - plain, plain)
                gu, gv = ga * opacity * cover_u + gs * tone_u, ga * opacity * cover_v + gs * tone_v
                scale = load_number(strokes, row, 8, here)
                textured_pull(out, gu, gv, t, sx, sy, fx, fy, bx, by, x, y, frames, i, half, scale, here)
            else:
                sharp, widening = load_number(strokes, row, 8, here), load_number(strokes, row, 9, here)
                by_color = 2.0 * seen * tl.sum(drift * given, axis=0)  # derivative in t; 0 unless DRIFTS
                plain_pull(
                    out, ga, t, sx, sy, fx, fy, bx, by, x, y, half, opacity, sharp, widening, taper, by_color, here
                )
            behind += alpha * (shown - behind)


@inline
def _pull_color(
    out, cover, ga, given, seen, t, here, C: tl.constexpr, CP: tl.constexpr, TEXTURED: tl.constexpr,
    DRIFTS: tl.constexpr,
):  # fmt: skip
    """Write the gradients of opacity, colour and drift, given alpha's gradient ``ga`` and the visible part ``seen``."""
    tl.store(out + 7, sum_pixels(ga * cover), here)
    store_colors(out + (9 if TEXTURED else 10), given, seen, here, C, CP)
    if DRIFTS:
        store_colors(out + 10 + C, given, seen * (t + t - 1.0), here, C, CP)


@jit(do_not_specialize=["numbers"])
def sum_rows(pairs, space, order, sums, numbers, WIDTH: tl.constexpr, ROWS: tl.constexpr):
    """Sum each stroke's rows of ``pairs``, which begin at ``space``, into ``sums`` (N, numbers) in double precision."""
    k = tl.program_id(0)
    begin, end = tl.load(space + k), tl.load(space + k + 1)
    row, column = tl.arange(0, ROWS)[:, None], tl.arange(0, WIDTH)[None, :]
    total = tl.zeros((WIDTH,), tl.float64)
    for j in range(begin, end, ROWS):
        mask = (j + row < end) & (column < numbers)
        total += tl.sum(tl.load(pairs + (j + row) * numbers + column, mask, 0.0).to(tl.float64), axis=0)
    column = tl.arange(0, WIDTH)
    tl.store(sums + tl.load(order + k) * numbers + column, total.to(tl.float32), column < numbers)
