"""Drawn strokes are laid over each other on a canvas, and the truth of what is seen where is kept."""
# mypy: allow-untyped-defs

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.compat.compiled import function, inline
from brushexp.strokes.bezier import length_of
from brushexp_recovery.synthesis import Laid
from brushexp_recovery.synthesis_looks import Drawn

Array = NDArray[Any]

BINS = 64  # along a stroke, to find where its paint begins and ends
ENDS = (0.03, 0.97)  # shares of the paint between which a stroke is said to extend
F = np.float32


@dataclass(frozen=True)
class Mixing:
    """How the paint of N strokes mixes with what lies below."""

    coats: float
    opacity: Array  # (N,)
    wet: Array  # (N,) share of the colour below that a stroke takes up on its way


@dataclass(frozen=True)
class Composed:
    """A canvas with strokes."""

    image: Array  # (H, W, 3)
    height: Array  # (H, W) of the paint
    labels: Array  # (H, W) int32, stroke that is seen, -1 the ground
    extent: Array  # (N, 6) whole area, mean x and y, first and last parameter of the chord with paint, visible pixels


def compose(drawn: Drawn, laid: Laid, mixing: Mixing, ground: Array) -> Composed:
    """Lay strokes over a ``ground`` (H, W, 3), the first lowest."""
    places = _places(drawn, laid)
    image, height = ground.astype(F), np.zeros(ground.shape[:2], F)
    where = (drawn.texels, drawn.first, drawn.side, places)
    _lay(*where, F(mixing.coats), mixing.opacity.astype(F), mixing.wet.astype(F), image, height)
    labels, extent = _own(*where, F(mixing.coats), mixing.opacity.astype(F), height.shape)
    return Composed(np.clip(image, 0, 1), height, labels, extent)


def _places(drawn: Drawn, laid: Laid) -> Array:
    """Place each window: centre, side, direction (cosine, sine), half chord, sway, taper."""
    chord = drawn.curve[:, 2] - drawn.curve[:, 0]
    length = np.maximum(np.linalg.norm(chord, axis=1), 1e-3)
    way = chord / length[:, None]
    rest = (drawn.scale, *way.T, 0.5 * length, laid.sway, laid.taper)
    return np.column_stack([drawn.position, *rest]).astype(F)


@inline
def _box(place, height, width):
    """First and last rows and columns that a window may touch."""
    reach = 0.5 * place[2] * 1.42 * (1 + abs(place[7])) + abs(place[6]) + 1
    if place[6] == 0 and place[7] == 0:
        reach = 0.5 * place[2] + 1
    top, bottom = max(int(place[1] - reach), 0), min(int(place[1] + reach) + 2, height)
    left, right = max(int(place[0] - reach), 0), min(int(place[0] + reach) + 2, width)
    return top, bottom, left, right


@inline
def _texel_place(x, y, place, side):
    """Row and column in the window, and parameter along the chord, of a pixel centre; bends are undone."""
    dx, dy = x - place[0], y - place[1]
    along, across = dx * place[3] + dy * place[4], dy * place[3] - dx * place[4]
    t = along / place[5]
    if place[6] != 0 or place[7] != 0:
        inner = min(max(t, F(-1)), F(1))
        across = (across - place[6] * np.sin(F(np.pi) * inner)) / (1 + place[7] * inner)
        dx, dy = along * place[3] - across * place[4], along * place[4] + across * place[3]
    per_pixel = side / place[2]
    return dy * per_pixel + F(0.5) * side - F(0.5), dx * per_pixel + F(0.5) * side - F(0.5), t


@inline
def _look_up(texels, first, side, row, column, channel):
    """Interpolate a channel of a window; it is 0 outside."""
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
def _lay(texels, first, side, places, coats, opacity, wet, image, height):
    rows, columns = height.shape
    for n in range(len(first)):
        place = places[n]
        top, bottom, left, right = _box(place, rows, columns)
        below, weight = np.zeros(3, F), F(1e-6)
        if wet[n] > 0:
            for y in range(top, bottom):
                for x in range(left, right):
                    row, column, _ = _texel_place(x + F(0.5), y + F(0.5), place, side[n])
                    alpha = _look_up(texels, first[n], side[n], row, column, 3)
                    weight += alpha
                    for c in range(3):
                        below[c] += alpha * image[y, x, c]
        for y in range(top, bottom):
            for x in range(left, right):
                row, column, t = _texel_place(x + F(0.5), y + F(0.5), place, side[n])
                raw = _look_up(texels, first[n], side[n], row, column, 3)
                if raw <= F(1e-4):
                    continue
                alpha = opacity[n] * (1 - (1 - min(raw, F(1))) ** coats)
                taken = wet[n] * (F(0.5) + F(0.5) * min(max(t, F(-1)), F(1)))  # more towards the end
                for c in range(3):
                    own = _look_up(texels, first[n], side[n], row, column, c) / raw
                    own = own + taken * (below[c] / weight - own)
                    image[y, x, c] += alpha * (own - image[y, x, c])
                height[y, x] += alpha * (raw * F(1.2) - F(0.7) * height[y, x])


@function
def _own(texels, first, side, places, coats, opacity, shape):
    """Say which stroke is seen at each pixel (that which adds most to it), and how far each extends."""
    rows, columns = shape
    light, best = np.ones((rows, columns), F), np.zeros((rows, columns), F)
    labels = np.full((rows, columns), -1, np.int32)
    extent = np.zeros((len(first), 6))
    for n in range(len(first) - 1, -1, -1):
        place = places[n]
        top, bottom, left, right = _box(place, rows, columns)
        bins, count = np.zeros(BINS), 0
        for y in range(top, bottom):
            for x in range(left, right):
                row, column, t = _texel_place(x + F(0.5), y + F(0.5), place, side[n])
                cover = 1 - (1 - min(_look_up(texels, first[n], side[n], row, column, 4), F(1))) ** coats
                if cover <= F(1e-4):
                    continue
                if cover >= F(0.5):
                    count += 1
                    extent[n, 1] += x + 0.5
                    extent[n, 2] += y + 0.5
                    bins[min(max(int((t + 1.6) / 3.2 * BINS), 0), BINS - 1)] += 1
                adds = opacity[n] * cover * light[y, x]
                if adds > best[y, x]:
                    best[y, x], labels[y, x] = adds, n
                light[y, x] *= 1 - opacity[n] * cover
        extent[n, 0] = count
        if count:
            extent[n, 1] /= count
            extent[n, 2] /= count
            extent[n, 3:5] = _quantiles(bins, count)
    for y in range(rows):
        for x in range(columns):
            if light[y, x] > best[y, x]:
                labels[y, x] = -1
            elif labels[y, x] >= 0:
                extent[labels[y, x], 5] += 1
    return labels, extent


@function
def _quantiles(bins, count):
    """Parameters of the chord between which a stroke's paint lies."""
    found = np.zeros(2)
    for k in range(2):
        total, goal = 0.0, ENDS[k] * count
        for i in range(BINS):
            if total + bins[i] >= goal and bins[i] > 0:
                found[k] = (i + (goal - total) / bins[i]) / BINS * 3.2 - 1.6
                break
            total += bins[i]
    return found


def geometry_of(drawn: Drawn, composed: Composed) -> Array:
    """Describe N strokes as the network is to: (N, 6) centre x and y, direction, log width and length, visible share.

    Width and length are those of a round-ended line with as much paint as the stroke; pixels and radians.
    """
    import torch  # noqa: PLC0415

    area, x, y, low, high, visible = composed.extent.T
    chord = drawn.curve[:, 2] - drawn.curve[:, 0]
    arc = length_of(torch.as_tensor(drawn.curve)).numpy()
    extent = np.maximum(0.5 * (high - low) * arc, 1.0) / (ENDS[1] - ENDS[0])
    width = np.minimum(area / extent, extent)
    width = np.clip(np.minimum(area / np.maximum(extent - 0.215 * width, 1), extent), 0.5, None)
    share = visible / np.maximum(area, 1)
    angle = np.arctan2(chord[:, 1], chord[:, 0])
    return np.stack([x, y, angle, np.log(width), np.log(np.maximum(extent, 1)), share.clip(0, 1)], 1).astype(F)
