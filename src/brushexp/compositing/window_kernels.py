"""Compiled forward and backward passes for strokes that were drawn in windows (`Patches`).

A window is square to the pixels, so the texels and weights of a bilinear lookup are found once for each of the eight
columns and rows of a tile. Texels are weighted by alpha before they are mixed. The backward pass goes over the tiles
first and leaves two numbers for every stroke and pixel that was looked at: the light that reaches the stroke, and the
derivative with respect to its alpha. Then it goes over the strokes, each of which gathers them from its tiles into its
own picture: no atomics, and the same bits on any number of threads.
"""

import numpy as np
from numba import prange

from brushexp.compositing.nearest import AREA
from brushexp.compositing.profile_kernels import WORKERS, _show
from brushexp.compositing.tile_lists import TILE
from brushexp.plugins.renderer.base import ALMOST_NOTHING
from brushexp.system.compiled import inline, kernel

F = np.float32
# Rows of a tile's scratch, each AREA numbers: of the picture, and of the stroke before its opacity is applied.
_RED, _GREEN, _BLUE, _LIGHT, _PAINTED, _ALPHA = 0, 1, 2, 3, 4, 7
ROWS = 8
SEEN = (
    5  # numbers that the backward pass keeps for a stroke and pixel of the tile at hand: painted 3, alpha, light above
)
LEFT = 2  # numbers that it leaves for the pass over the strokes: light above, derivative with respect to alpha


@inline
def _axis(centre, scale, side, origin, index, weight, inside):  # type: ignore[no-untyped-def]
    """Of the eight pixels from ``origin`` on, along one axis: the texels before and after (2, 8), what each counts, and
    whether it is there at all.
    """  # noqa: D205
    per_pixel = F(side) / scale
    for q in range(TILE):
        t = (F(q) + F(0.5) + origin - centre) * per_pixel + F(0.5) * F(side) - F(0.5)
        t = min(max(t, F(-2)), F(side))
        low = int(np.floor(t))
        f = t - F(low)
        inside[0, q] = F(1) if 0 <= low < side else F(0)
        inside[1, q] = F(1) if 0 <= low + 1 < side else F(0)
        weight[0, q], weight[1, q] = inside[0, q] * (F(1) - f), inside[1, q] * f
        index[0, q], index[1, q] = min(max(low, 0), side - 1), min(max(low + 1, 0), side - 1)


@inline
def _look_up(places, images, i, ox, oy, index, weight, inside, buf):  # type: ignore[no-untyped-def]
    """Write rows _PAINTED (three of them) and _ALPHA of the stroke ``i`` in the tile at (ox, oy)."""
    side = images.shape[-1]
    _axis(places[i, 0], places[i, 2], side, ox, index[0], weight[0], inside[0])
    _axis(places[i, 1], places[i, 2], side, oy, index[1], weight[1], inside[1])
    image = images[i]
    for y in range(TILE):
        for x in range(TILE):
            red, green, blue, alpha = F(0), F(0), F(0), F(0)
            for k in range(4):
                row, column = index[1, k >> 1, y], index[0, k & 1, x]
                covered = weight[1, k >> 1, y] * weight[0, k & 1, x] * image[3, row, column]
                alpha += covered
                red += covered * image[0, row, column]
                green += covered * image[1, row, column]
                blue += covered * image[2, row, column]
            q = y * TILE + x
            buf[_PAINTED * AREA + q] = red
            buf[(_PAINTED + 1) * AREA + q] = green
            buf[(_PAINTED + 2) * AREA + q] = blue
            buf[_ALPHA * AREA + q] = alpha


@inline
def _lay(opacity, buf):  # type: ignore[no-untyped-def]
    """Lay the stroke in the scratch under those before it; say how bright the brightest pixel still is."""
    brightest = F(0)
    for q in range(AREA):
        light = buf[_LIGHT * AREA + q]
        weight = light * opacity
        for c in range(3):
            buf[c * AREA + q] += weight * buf[(_PAINTED + c) * AREA + q]
        light -= weight * buf[_ALPHA * AREA + q]
        buf[_LIGHT * AREA + q] = light
        brightest = max(brightest, light)
    return brightest


@inline
def _judge(opacity, target, top, left, buf):  # type: ignore[no-untyped-def]
    """Sum of alpha |color - target|^2 and of alpha of the stroke in the scratch over the pixels of a tile."""
    error, total = F(0), F(0)
    for y in range(min(TILE, target.shape[1] - top)):
        for x in range(min(TILE, target.shape[2] - left)):
            q = y * TILE + x
            alpha = buf[_ALPHA * AREA + q]
            square = F(0)
            for c in range(3):
                color = buf[(_PAINTED + c) * AREA + q] / max(alpha, F(ALMOST_NOTHING))
                square += (color - target[c, top + y, left + x]) ** 2
            error += opacity * alpha * square
            total += opacity * alpha
    return error, total


@kernel
def forward(places, images, order, first, stroke, slot, columns, background, opaque, target, image, used, errors):  # type: ignore[no-untyped-def]
    """Paint all tiles.

    Args:
        places: (N, 4) float32: centre x and y, side, opacity.
        images: (N, 4, S, S) float32.
        order: (N,) which row each stroke of the lists is.
        first: list of each tile, see `TileLists`.
        stroke: see `TileLists`.
        slot: see `TileLists`.
        columns: tiles per row.
        background: (3,) float32.
        opaque: stop in a tile when no pixel lets more light than this through.
        target: (3, H, W), or (3, 0, 0) if no accuracy is wanted; with a target every stroke is looked at.
        image: (3, H, W), written.
        used: (tiles,) length of the list that was looked at, written.
        errors: (pairs, 2) sum of alpha |color - target|^2 and of alpha, written if there is a target.
    """
    judge = target.shape[1] > 0
    for worker in prange(min(WORKERS, len(used))):
        buf = np.empty(ROWS * AREA, F)
        index, weight, inside = np.empty((2, 2, TILE), np.int64), np.empty((2, 2, TILE), F), np.empty((2, 2, TILE), F)
        for tile in range(worker, len(used), WORKERS):
            top, left = tile // columns * TILE, tile % columns * TILE
            buf[: 3 * AREA] = F(0)
            buf[_LIGHT * AREA : (_LIGHT + 1) * AREA] = F(1)
            j = first[tile]
            while j < first[tile + 1]:
                i = order[stroke[j]]
                _look_up(places, images, i, F(left), F(top), index, weight, inside, buf)
                brightest = _lay(places[i, 3], buf)
                if judge:
                    errors[slot[j], 0], errors[slot[j], 1] = _judge(places[i, 3], target, top, left, buf)
                j += 1
                if brightest < opaque and not judge:
                    break
            used[tile] = j - first[tile]
            _show(buf, background, top, left, image)


@inline
def _keep(opacity, buf, seen):  # type: ignore[no-untyped-def]
    """Keep what the backward pass needs of the stroke in the scratch, and take its light."""
    for q in range(AREA):
        for c in range(SEEN - 1):
            seen[c, q] = buf[(_PAINTED + c) * AREA + q]
        light = buf[_LIGHT * AREA + q]
        seen[SEEN - 1, q] = light
        buf[_LIGHT * AREA + q] = light - light * opacity * seen[3, q]


@inline
def _load(grad_image, background, top, left, buf, grad):  # type: ignore[no-untyped-def]
    """Put the picture's gradient into ``grad`` (3, 64), and the bare canvas into the scratch as the colour behind."""
    grad[:] = F(0)  # pixels beyond the edge have no gradient
    for c in range(3):
        buf[c * AREA : (c + 1) * AREA] = background[c]
        for y in range(min(TILE, grad_image.shape[1] - top)):
            for x in range(min(TILE, grad_image.shape[2] - left)):
                grad[c, y * TILE + x] = grad_image[c, top + y, left + x]


@inline
def _step_back(opacity, seen, grad, buf, out):  # type: ignore[no-untyped-def]
    """Write what a stroke needs from a tile into ``out`` (LEFT, 64); the colour behind then includes the stroke."""
    for q in range(AREA):
        hidden = F(0)
        for c in range(3):
            behind = buf[c * AREA + q]
            hidden += grad[c, q] * behind
            buf[c * AREA + q] = behind + opacity * (seen[c, q] - seen[3, q] * behind)
        out[0, q] = seen[SEEN - 1, q]
        out[1, q] = -seen[SEEN - 1, q] * hidden


@kernel
def over_tiles(  # type: ignore[no-untyped-def]
    places, images, order, first, stroke, slot, columns, background, used, begin, grad_image, left_behind, tile_of, at
):
    """Repeat the forward pass of each tile, then visit its strokes back to front with the colour behind them.

    Args:
        places: as in `forward`.
        images: as in `forward`.
        order: as in `forward`.
        first: list of each tile, see `TileLists`.
        stroke: see `TileLists`.
        slot: see `TileLists`.
        columns: tiles per row.
        background: (3,) float32.
        used: (tiles,) from `forward`.
        begin: (tiles,) where each tile's rows of ``left_behind`` begin.
        grad_image: (3, H, W).
        left_behind: (sum of used, LEFT, 64), written.
        tile_of: (pairs,) each slot's tile, written.
        at: (pairs,) each slot's row of ``left_behind``, or -1 if the stroke was not looked at; written.
    """
    for worker in prange(min(WORKERS, len(used))):
        deepest = 0
        for tile in range(worker, len(used), WORKERS):
            deepest = max(deepest, used[tile])
        buf, seen, grad = np.empty(ROWS * AREA, F), np.empty((deepest, SEEN, AREA), F), np.empty((3, AREA), F)
        index, weight, inside = np.empty((2, 2, TILE), np.int64), np.empty((2, 2, TILE), F), np.empty((2, 2, TILE), F)
        for tile in range(worker, len(used), WORKERS):
            top, left, n = tile // columns * TILE, tile % columns * TILE, used[tile]
            for j in range(first[tile], first[tile + 1]):
                k = j - first[tile]
                tile_of[slot[j]], at[slot[j]] = tile, begin[tile] + k if k < n else -1
            buf[_LIGHT * AREA : (_LIGHT + 1) * AREA] = F(1)
            for k in range(n):
                i = order[stroke[first[tile] + k]]
                _look_up(places, images, i, F(left), F(top), index, weight, inside, buf)
                _keep(places[i, 3], buf, seen[k])
            _load(grad_image, background, top, left, buf, grad)
            for back in range(n):
                k = n - 1 - back
                _step_back(places[order[stroke[first[tile] + k]], 3], seen[k], grad, buf, left_behind[begin[tile] + k])


@kernel
def over_strokes(places, images, order, row, columns, tile_of, at, left_behind, grad_image, grad_places, grad_images):  # type: ignore[no-untyped-def]
    """Gather each stroke's gradient from its tiles, always in the same order.

    Args:
        places: as in `forward`.
        images: as in `forward`.
        order: as in `forward`.
        row: see `TileLists`.
        columns: tiles per row.
        tile_of: from `over_tiles`.
        at: from `over_tiles`.
        left_behind: from `over_tiles`.
        grad_image: (3, H, W).
        grad_places: (N, 4) zeros, written.
        grad_images: (N, 4, S, S) zeros, written.
    """
    side = images.shape[-1]
    for s in prange(len(row) - 1):
        i = order[s]
        index, weight, inside = np.empty((2, 2, TILE), np.int64), np.empty((2, 2, TILE), F), np.empty((2, 2, TILE), F)
        per_pixel, total = F(side) / places[i, 2], np.zeros(4, np.float64)
        for j in range(row[s], row[s + 1]):
            if at[j] < 0:
                continue
            top, left, given = tile_of[j] // columns * TILE, tile_of[j] % columns * TILE, left_behind[at[j]]
            _axis(places[i, 0], places[i, 2], side, F(left), index[0], weight[0], inside[0])
            _axis(places[i, 1], places[i, 2], side, F(top), index[1], weight[1], inside[1])
            for y in range(min(TILE, grad_image.shape[1] - top)):
                for x in range(min(TILE, grad_image.shape[2] - left)):
                    along_x, along_y, of_opacity = _scatter(
                        images[i], places[i, 3], given, grad_image, top, left, y, x, index, weight, inside,
                        grad_images[i],
                    )  # fmt: skip
                    total[0] -= along_x
                    total[1] -= along_y
                    total[2] -= along_x * (F(x + left) + F(0.5) - places[i, 0])
                    total[2] -= along_y * (F(y + top) + F(0.5) - places[i, 1])
                    total[3] += of_opacity
        grad_places[i, 0] = total[0] * per_pixel
        grad_places[i, 1] = total[1] * per_pixel
        grad_places[i, 2] = total[2] * per_pixel / places[i, 2]
        grad_places[i, 3] = total[3]


@inline
def _scatter(image, opacity, given, grad_image, top, left, y, x, index, weight, inside, out):  # type: ignore[no-untyped-def]
    """Add one pixel's gradient to four texels of ``out`` (4, S, S).

    Returns:
        derivatives with respect to the place of the pixel, in texels along x and y, and to the opacity.
    """
    light, of_alpha = given[0, y * TILE + x], given[1, y * TILE + x]
    red = light * grad_image[0, top + y, left + x]
    green = light * grad_image[1, top + y, left + x]
    blue = light * grad_image[2, top + y, left + x]
    along_x, along_y, of_opacity = F(0), F(0), F(0)
    for k in range(4):
        row, column = index[1, k >> 1, y], index[0, k & 1, x]
        wy, wx = weight[1, k >> 1, y], weight[0, k & 1, x]
        alpha = image[3, row, column]
        slope = of_alpha + red * image[0, row, column] + green * image[1, row, column] + blue * image[2, row, column]
        total = wy * wx * opacity
        out[3, row, column] += total * slope
        out[0, row, column] += total * alpha * red
        out[1, row, column] += total * alpha * green
        out[2, row, column] += total * alpha * blue
        value = alpha * slope
        of_opacity += wy * wx * value
        along_x += (value if k & 1 else -value) * inside[0, k & 1, x] * wy
        along_y += (value if k >> 1 else -value) * inside[1, k >> 1, y] * wx
    return opacity * along_x, opacity * along_y, of_opacity
