"""Load and store the pixels of tiles and the colours of strokes.

There are C channels, padded to CP, a power of 2; ``here`` (TILES,) marks the active tiles.
"""
# mypy: allow-untyped-defs

import triton.language as tl

from brushexp_gpu.curves import AREA, TILE
from brushexp_gpu.launch import inline


@inline
def pixel_places(tile, columns, height, width, here):
    """Return each pixel's offset in a plane and whether it exists (TILES, AREA), and each tile's corner (TILES,)."""
    q = tl.arange(0, AREA)[None, :]
    top, left = tile // columns * TILE, tile % columns * TILE
    row, column = top[:, None] + q // TILE, left[:, None] + q % TILE
    there = (row < height) & (column < width) & here[:, None]
    return row.to(tl.int64) * width + column, there, left.to(tl.float32), top.to(tl.float32)


@inline
def load_planes(picture, place, there, height, width, C: tl.constexpr, CP: tl.constexpr):
    """Load pixels (CP, TILES, AREA) from the first C planes of a picture, with 0 beyond its edge."""
    c = tl.arange(0, CP)[:, None, None]
    offset = c.to(tl.int64) * height * width + place[None]
    return tl.load(picture + offset, there[None] & (c < C), 0.0)


@inline
def store_planes(picture, color, place, there, height, width, C: tl.constexpr, CP: tl.constexpr):
    """Write pixels (CP, TILES, AREA) to the first C planes of a picture."""
    c = tl.arange(0, CP)[:, None, None]
    tl.store(picture + c.to(tl.int64) * height * width + place[None], color, there[None] & (c < C))


@inline
def _load_colors(colors, i, here, C: tl.constexpr, CP: tl.constexpr):
    c = tl.arange(0, CP)[:, None, None]
    return tl.load(colors + i[None, :, None] + c, here[None, :, None] & (c < C), 0.0)  # (CP, TILES, 1)


@inline
def load_paint(strokes, row, t, here, C: tl.constexpr, CP: tl.constexpr, TEXTURED: tl.constexpr, DRIFTS: tl.constexpr):
    """Load the colours (CP, TILES, 1 or AREA) at curve parameters ``t``, and their drift along the strokes."""
    paint = _load_colors(strokes + (9 if TEXTURED else 10), row, here, C, CP)
    drift = tl.zeros_like(paint)
    if DRIFTS:
        drift = _load_colors(strokes + 10 + C, row, here, C, CP)
        paint += drift * (t + t - 1.0)[None]
    return paint, drift


@inline
def load_bare(background, C: tl.constexpr, CP: tl.constexpr):
    """Load the colour (CP, 1, 1) of the bare canvas."""
    c = tl.arange(0, CP)
    return tl.load(background + c, c < C, 0.0)[:, None, None]


@inline
def load_number(strokes, at, k: tl.constexpr, here):
    """Load the ``k``-th number (TILES, 1) of strokes whose numbers begin at the offsets ``at`` (TILES,)."""
    return tl.load(strokes + at + k, here, 0.0)[:, None]


@inline
def store_colors(out, given, seen, here, C: tl.constexpr, CP: tl.constexpr):
    """Write each tile's sum of ``given`` (CP, TILES, AREA) over the pixels, weighted by ``seen`` (TILES, AREA)."""
    c = tl.arange(0, CP)[:, None]
    tl.store(out[None] + c, tl.sum(given * seen[None], axis=2), here[None] & (c < C))
