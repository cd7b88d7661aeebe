"""Composite strokes on a canvas, and compute the visible stroke at each pixel."""
# mypy: allow-untyped-defs

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.kernels import function, inline
from brushexp.contracts.strokes import length_of
from brushexp_recovery.curves.bezier import chords_of
from brushexp_recovery.curves.round_line import width_of_line
from brushexp_recovery.synthesis.layout import StrokeLayout
from brushexp_recovery.synthesis.windows import StrokeWindows, Texel

Array = NDArray[Any]
F = np.float32

COUNTED_REACH = 1.6  # distance from the middle, in half chords, within which the paint of a stroke is counted
BINS = 64  # number of bins along this distance for finding where the paint begins and ends
FIRST_PAINT, LAST_PAINT = 0.03, 0.97  # quantiles of the paint that define the extent of a stroke
DIAGONAL = 1.42  # diagonal of a square, in sides
FAINT = F(1e-4)  # opacity below which paint is ignored
RELIEF = F(1.2)  # height of full paint
LEVELLING = F(0.7)  # share of the relief below that paint fills
NARROWEST = 0.5  # smallest width in pixels
DRAG_STEPS, DRAG_TRACKS = 24, 12  # number of steps along and tracks across a stroke at which bristles take up paint
DRAG_MEMORY = F(0.8)  # share of its paint that a bristle keeps after a step


@dataclass(frozen=True)
class Mixing:
    """How the paint of N strokes mixes with the paint below."""

    coats: float
    opacity: Array  # (N,)
    wet: Array  # (N,) share of the colour below that a stroke takes up along its way
    drag: Array  # (N,) share of the colour that each bristle takes up and deposits further along


def opaque_mixing(n: int, coats: float) -> Mixing:
    """Return the mixing of ``n`` opaque strokes, which do not take up any paint from below."""
    return Mixing(coats, opacity=np.ones(n), wet=np.zeros(n), drag=np.zeros(n))


class Extent(IntEnum):
    """The area and position of a stroke's paint, whether visible or hidden; only ``VISIBLE`` excludes hidden paint."""

    AREA = 0  # pixels
    X = 1  # mean position in pixels
    Y = 2
    FIRST = 3  # parameter on the chord, from -1 (start) to 1 (end), at which paint begins
    LAST = 4
    VISIBLE = 5  # pixels


class StrokeGeometry(IntEnum):
    """The true attributes of a stroke, as columns of the table of a painting's strokes."""

    CENTRE_X = 0  # pixels
    CENTRE_Y = 1
    ANGLE = 2  # radians
    LOG_WIDTH = 3  # logarithm of pixels
    LOG_LENGTH = 4
    VISIBLE = 5  # visible share of the stroke


class Placement(IntEnum):
    """The position of a stroke's window on the canvas, and its bend."""

    X = 0  # centre in pixels
    Y = 1
    SIDE = 2  # pixels
    COSINE = 3  # cosine of the chord's direction
    SINE = 4
    HALF_CHORD = 5  # pixels
    SWAY = 6  # pixels
    TAPER = 7


@dataclass(frozen=True)
class Canvas:
    """A canvas after compositing N strokes."""

    image: Array  # (H, W, 3)
    height: Array  # (H, W) height of the paint
    labels: Array  # (H, W) int32, visible stroke, or -1 for the ground
    extent: Array  # (N, len(Extent))


def compose(windows: StrokeWindows, layout: StrokeLayout, mixing: Mixing, ground: Array) -> Canvas:
    """Composite strokes over a ``ground`` (H, W, 3), bottom to top."""
    places = _placements(windows, layout)
    image, height = ground.astype(F), np.zeros(ground.shape[:2], F)
    coats, opacity = F(mixing.coats), mixing.opacity.astype(F)
    _paint(
        windows.texels,
        windows.first,
        windows.side,
        places,
        windows.width.astype(F),
        coats,
        opacity,
        mixing.wet.astype(F),
        mixing.drag.astype(F),
        image,
        height,
    )
    labels, extent = _see(windows.texels, windows.first, windows.side, places, coats, opacity, height.shape)
    return Canvas(np.clip(image, 0, 1), height, labels, extent)


def _placements(windows: StrokeWindows, layout: StrokeLayout) -> Array:
    """Compute the placements (N, len(Placement)) float32 of N windows."""
    chord = chords_of(windows.curve)
    length = np.maximum(np.linalg.norm(chord, axis=1), 1e-3)
    places = np.empty((len(length), len(Placement)), F)
    places[:, [Placement.X, Placement.Y]] = windows.position
    places[:, Placement.SIDE] = windows.scale
    places[:, [Placement.COSINE, Placement.SINE]] = chord / length[:, None]
    places[:, Placement.HALF_CHORD] = 0.5 * length
    places[:, Placement.SWAY] = layout.sway
    places[:, Placement.TAPER] = layout.taper
    return places


@inline
def _box(place, height, width):
    """Return the bounds of the rows and columns that a window may touch."""
    sway, taper = place[Placement.SWAY], place[Placement.TAPER]
    reach = 0.5 * place[Placement.SIDE] * DIAGONAL * (1 + abs(taper)) + abs(sway) + 1
    if sway == 0 and taper == 0:
        reach = 0.5 * place[Placement.SIDE] + 1
    top, bottom = max(int(place[Placement.Y] - reach), 0), min(int(place[Placement.Y] + reach) + 2, height)
    left, right = max(int(place[Placement.X] - reach), 0), min(int(place[Placement.X] + reach) + 2, width)
    return top, bottom, left, right


@inline
def _texel_place(x, y, place, side):
    """Map a pixel centre to a row and a column of the window before bending, and to a parameter along the chord."""
    cosine, sine, sway = place[Placement.COSINE], place[Placement.SINE], place[Placement.SWAY]
    dx, dy = x - place[Placement.X], y - place[Placement.Y]
    along, across = dx * cosine + dy * sine, dy * cosine - dx * sine
    t = along / place[Placement.HALF_CHORD]
    if sway != 0 or place[Placement.TAPER] != 0:
        inner = min(max(t, F(-1)), F(1))
        across = (across - sway * np.sin(F(np.pi) * inner)) / (1 + place[Placement.TAPER] * inner)
        dx, dy = along * cosine - across * sine, along * sine + across * cosine
    per_pixel = side / place[Placement.SIDE]
    return dy * per_pixel + F(0.5) * side - F(0.5), dx * per_pixel + F(0.5) * side - F(0.5), t


@inline
def _look_up(texels, first, side, row, column, channel):
    """Interpolate a channel of a window bilinearly; outside the window, the channel is 0."""
    top, left = int(np.floor(row)), int(np.floor(column))
    total = F(0)
    for i in range(2):
        for j in range(2):
            r, c = top + i, left + j
            if 0 <= r < side and 0 <= c < side:
                weight = (row - top if i else 1 - (row - top)) * (column - left if j else 1 - (column - left))
                total += F(weight) * texels[first + r * side + c, channel]
    return total


@function
def _paint(texels, first, side, places, brush_width, coats, opacity, wet, drag, image, height):
    """Composite strokes over an image (H, W, 3), and add them to the paint height (H, W)."""
    rows, columns = height.shape
    carried = np.zeros((DRAG_STEPS, DRAG_TRACKS, 4), F)
    for n in range(len(first)):
        place = places[n]
        top, bottom, left, right = _box(place, rows, columns)
        below, weight = np.zeros(3, F), F(1e-6)
        if wet[n] > 0:
            for y in range(top, bottom):
                for x in range(left, right):
                    row, column, _ = _texel_place(x + F(0.5), y + F(0.5), place, side[n])
                    alpha = _look_up(texels, first[n], side[n], row, column, Texel.ALPHA)
                    weight += alpha
                    for c in range(3):
                        below[c] += alpha * image[y, x, c]
        if drag[n] > 0:
            _take_up(texels, first[n], side[n], place, brush_width[n], image, (top, bottom, left, right), carried)
        for y in range(top, bottom):
            for x in range(left, right):
                row, column, t = _texel_place(x + F(0.5), y + F(0.5), place, side[n])
                raw = _look_up(texels, first[n], side[n], row, column, Texel.ALPHA)
                if raw <= FAINT:
                    continue
                bump = _look_up(texels, first[n], side[n], row, column, Texel.HEIGHT)
                alpha = opacity[n] * (1 - (1 - min(raw, F(1))) ** coats)
                taken = wet[n] * (F(0.5) + F(0.5) * min(max(t, F(-1)), F(1)))  # increases towards the end
                step, track = 0, 0
                if drag[n] > 0:
                    step, track = _drag_cell(x + F(0.5), y + F(0.5), t, place, brush_width[n])
                for c in range(3):
                    own = _look_up(texels, first[n], side[n], row, column, c) / raw
                    own = own + taken * (below[c] / weight - own)
                    if drag[n] > 0 and carried[step, track, 3] > 0:
                        own = own + drag[n] * (carried[step, track, c] - own)
                    image[y, x, c] += alpha * (own - image[y, x, c])
                height[y, x] += alpha * (bump * RELIEF - LEVELLING * height[y, x])


@inline
def _drag_cell(x, y, t, place, width):
    """Return the indices of the step along the chord, and of the track across it, that contain a pixel centre."""
    across = (y - place[Placement.Y]) * place[Placement.COSINE] - (x - place[Placement.X]) * place[Placement.SINE]
    step = int((min(max(t, F(-1)), F(1)) + 1) * F(0.5) * (DRAG_STEPS - 1) + F(0.5))
    track = int(min(max(across / max(width, F(1)) + F(0.5), F(0)), F(0.999)) * DRAG_TRACKS)
    return step, track


@inline
def _take_up(texels, first, side, place, width, image, box, carried):
    """Compute the colours that a stroke's bristles carry, and their weights: (`DRAG_STEPS`, `DRAG_TRACKS`, 4).

    Each bristle keeps a leaky memory of the colours that it passes from the start of the stroke to the end.
    """
    carried[:] = 0
    for y in range(box[0], box[1]):
        for x in range(box[2], box[3]):
            row, column, t = _texel_place(x + F(0.5), y + F(0.5), place, side)
            alpha = _look_up(texels, first, side, row, column, Texel.ALPHA)
            if alpha <= FAINT:
                continue
            step, track = _drag_cell(x + F(0.5), y + F(0.5), t, place, width)
            for c in range(3):
                carried[step, track, c] += alpha * image[y, x, c]
            carried[step, track, 3] += alpha
    for track in range(DRAG_TRACKS):
        for step in range(DRAG_STEPS):
            weight = carried[step, track, 3]
            for c in range(3):
                if weight > 0:
                    carried[step, track, c] /= weight
                if step > 0 and carried[step - 1, track, 3] > 0:
                    before = carried[step - 1, track, c]
                    kept = DRAG_MEMORY if weight > 0 else F(1)
                    carried[step, track, c] += kept * (before - carried[step, track, c])
            if step > 0 and carried[step - 1, track, 3] > 0:
                carried[step, track, 3] = max(weight, F(1e-6))


@function
def _see(texels, first, side, places, coats, opacity, shape):
    """Find the stroke that contributes most to each pixel, and the extent of each stroke."""
    rows, columns = shape
    light, best = np.ones((rows, columns), F), np.zeros((rows, columns), F)
    labels = np.full((rows, columns), -1, np.int32)
    extent = np.zeros((len(first), len(Extent)))
    for n in range(len(first) - 1, -1, -1):
        place = places[n]
        top, bottom, left, right = _box(place, rows, columns)
        bins, count = np.zeros(BINS), 0
        for y in range(top, bottom):
            for x in range(left, right):
                row, column, t = _texel_place(x + F(0.5), y + F(0.5), place, side[n])
                closed = _look_up(texels, first[n], side[n], row, column, Texel.CLOSED)
                cover = 1 - (1 - min(closed, F(1))) ** coats
                if cover <= FAINT:
                    continue
                if cover >= F(0.5):
                    count += 1
                    extent[n, Extent.X] += x + 0.5
                    extent[n, Extent.Y] += y + 0.5
                    bins[min(max(int((t + COUNTED_REACH) / (2 * COUNTED_REACH) * BINS), 0), BINS - 1)] += 1
                adds = opacity[n] * cover * light[y, x]
                if adds > best[y, x]:
                    best[y, x], labels[y, x] = adds, n
                light[y, x] *= 1 - opacity[n] * cover
        extent[n, Extent.AREA] = count
        if count:
            extent[n, Extent.X] /= count
            extent[n, Extent.Y] /= count
            extent[n, Extent.FIRST] = _quantile(bins, FIRST_PAINT * count)
            extent[n, Extent.LAST] = _quantile(bins, LAST_PAINT * count)
    _uncover_ground(light, best, labels, extent)
    return labels, extent


@inline
def _uncover_ground(light, best, labels, extent):
    """Label with -1 the pixels to which the ground contributes most, and count the visible pixels of each stroke."""
    for y in range(labels.shape[0]):
        for x in range(labels.shape[1]):
            if light[y, x] > best[y, x]:
                labels[y, x] = -1
            elif labels[y, x] >= 0:
                extent[labels[y, x], Extent.VISIBLE] += 1


@inline
def _quantile(bins, count):
    """Return the position along the chord that is preceded by ``count`` pixels of paint."""
    total = 0.0
    for i in range(BINS):
        if total + bins[i] >= count and bins[i] > 0:
            return (i + (count - total) / bins[i]) / BINS * (2 * COUNTED_REACH) - COUNTED_REACH
        total += bins[i]
    return 0.0


def geometry_of(windows: StrokeWindows, canvas: Canvas) -> Array:
    """Compute the true attributes (N, len(StrokeGeometry)) float32 of N strokes.

    A stroke's width and length are those of a round-ended line with the same area of paint.
    """
    import torch  # noqa: PLC0415

    area, x, y, first, last, visible = canvas.extent.T
    chord_x, chord_y = chords_of(windows.curve).T
    arc = length_of(torch.as_tensor(windows.curve)).numpy()
    length = np.maximum(0.5 * (last - first) * arc, 1.0) / (LAST_PAINT - FIRST_PAINT)
    geometry = np.empty((len(area), len(StrokeGeometry)))
    geometry[:, StrokeGeometry.CENTRE_X] = x
    geometry[:, StrokeGeometry.CENTRE_Y] = y
    geometry[:, StrokeGeometry.ANGLE] = np.arctan2(chord_y, chord_x)
    geometry[:, StrokeGeometry.LOG_WIDTH] = np.log(np.clip(width_of_line(area, length), NARROWEST, None))
    geometry[:, StrokeGeometry.LOG_LENGTH] = np.log(np.maximum(length, 1))
    geometry[:, StrokeGeometry.VISIBLE] = (visible / np.maximum(area, 1)).clip(0, 1)
    return geometry.astype(F)
