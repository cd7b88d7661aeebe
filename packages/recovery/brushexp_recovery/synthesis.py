"""Strokes are laid as one would paint a picture: where, along what, how wide, in what colour, bottom to top."""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.compat.compiled import function
from brushexp_recovery.raster.blur import gaussian_blur

Array = NDArray[Any]
Random = np.random.Generator

STEPS = 12  # of a trace from the middle of a stroke to either end
SURE = 4  # of them are gone whatever lies on the way
TURN = 0.12  # radians by which a stroke turns in a step at most
BLURS = np.array([0.5, 1, 2, 4, 8, 16])  # pixels: the picture at these is what colours are picked from
CANDIDATES = 40  # places that are drawn for every stroke


@dataclass(frozen=True)
class Hand:
    """How a painter lays strokes; the defaults are of one who fills a picture in three layers, broad to fine."""

    layers: tuple[tuple[float, float], ...] = ((0.20, 1.0), (0.35, 0.62), (0.45, 0.40))  # share of strokes, width
    cover: float = 2.3  # nominal areas of all strokes together, in canvases
    aspect: tuple[float, float] = (6.5, 0.3)  # length in widths: median, and spread of its logarithm
    limits: tuple[float, float] = (3.5, 11.0)  # of the length in widths
    uneven: float = 0.15  # spread of the logarithm of widths in a layer
    directions: int = 16  # in which strokes are laid
    shaky: float = 4.0  # degrees: spread of their directions
    color: float = 1.0  # strength with which colours differ between strokes: 1 is 5, 3.5, 3.5 in CIELAB
    palette: int = 0  # number of paints; 0: as many as there are strokes
    hatch: float = 0.0  # share of the picture that is hatched in one direction a place, not along the edges
    turn: float = TURN  # radians by which a stroke may bend in each of `STEPS` steps
    sway: float = 0.0  # of S-bends, spread, in widths
    taper: float = 0.0  # spread of the change of width from end to end, as a share
    even: bool = False  # places on a grid, slightly moved, not more of them where there is detail
    clip: float = 0.0  # difference of colour, sRGB, at which a stroke ends before its time; 0: never


@dataclass(frozen=True)
class Laid:
    """N strokes on a canvas, bottom to top."""

    curve: Array  # (N, 3, 2) control points, pixels, x to the right, y down
    width: Array  # (N,) pixels
    color: Array  # (N, 3) sRGB
    sway: Array  # (N,) pixels to which side, half-way to either end, an S bends
    taper: Array  # (N,) change of width from the middle to an end, as a share


def lay_strokes(picture: Array, n: int, hand: Hand, random: Random) -> Laid:
    """Lay ``n`` strokes of ``hand`` to paint a ``picture`` (H, W, 3) in [0, 1]."""
    size = picture.shape[:2]
    counts = np.diff(np.round(np.cumsum([0.0, *(share for share, _ in hand.layers)]) * n).astype(int))
    relative = np.repeat([width for _, width in hand.layers], counts) * np.exp(hand.uneven * random.normal(size=n))
    aspect = np.clip(np.exp(np.log(hand.aspect[0]) + hand.aspect[1] * random.normal(size=n)), *hand.limits)
    area = size[0] * size[1]
    width = relative * np.sqrt(hand.cover * area / (relative**2 * (aspect + 0.8)).sum())
    pitch = np.sqrt(area / n)
    angles = hatched(flow_of(picture, max(3.0, 0.45 * pitch)), hand.hatch, random)
    detail = detail_of(picture, pitch)
    weights = [1 + layer * 0.6 * detail / max(detail.mean(), 1e-6) for layer in range(len(counts))]
    places = np.concatenate([
        on_grid(k, size, random) if hand.even else scatter(k, weight, random)
        for k, weight in zip(counts, weights, strict=True)
    ])  # fmt: skip
    curve = curves_along(angles, picture, places, 0.5 * aspect * width, hand, random)
    color = pick_colors(picture, places, width, hand, random)
    return Laid(
        curve, width, color, hand.sway * width * random.normal(size=n),
        np.clip(hand.taper * random.normal(size=n), -0.6, 0.6),
    )  # fmt: skip


def flow_of(picture: Array, sigma: float) -> Array:
    """Compute the direction (H, W) along the edges of a picture, radians, smooth where it says little."""
    gy, gx = np.gradient(gaussian_blur(picture, (1, 1, 0)), axis=(0, 1))
    products = ((a * b).sum(-1) for a, b in ((gx, gx), (gx, gy), (gy, gy)))
    xx, xy, yy = (gaussian_blur(value, sigma) + 0.3 * gaussian_blur(value, 4 * sigma) for value in products)
    return 0.5 * np.arctan2(-2 * xy, yy - xx)


def detail_of(picture: Array, pitch: float) -> Array:
    """Measure how much detail (H, W) a picture has at about ``pitch`` pixels."""
    down, right = np.gradient(gaussian_blur(picture, (1.5, 1.5, 0)), axis=(0, 1))
    return gaussian_blur(np.sqrt((down**2 + right**2).sum(-1)), 0.5 * pitch)


def hatched(angles: Array, share: float, random: Random) -> Array:
    """Replace a ``share`` of a field (H, W) of directions by patches of one direction each."""
    if share == 0:
        return angles
    height, width = angles.shape
    count = int(random.integers(3, 30))
    centres = random.random((count, 2)) * [height, width]
    rows, columns = np.mgrid[:height:4, :width:4]
    patch = ((rows[..., None] - centres[:, 0]) ** 2 + (columns[..., None] - centres[:, 1]) ** 2).argmin(-1)
    patch = patch.repeat(4, 0).repeat(4, 1)[:height, :width]
    own = np.pi * random.random(count)
    return np.where((random.random(count) < share)[patch], own[patch], angles)


def scatter(n: int, weight: Array, random: Random) -> Array:
    """Spread ``n`` places (n, 2), x and y, evenly, denser where ``weight`` (H, W) is larger."""
    if n == 0:
        return np.empty((0, 2))
    height, width = weight.shape
    pick = random.choice(height * width, CANDIDATES * n, p=(weight / weight.sum()).ravel())
    place = np.stack([pick % width, pick // width], 1) + random.random((len(pick), 2))
    local = np.sqrt(weight.mean() / weight.ravel()[pick])
    radius = 0.9 * np.sqrt(height * width / n)
    while (chosen := _thinned(place, local * radius, n))[-1] < 0:
        radius *= 0.9
    return place[chosen]


def on_grid(n: int, size: tuple[int, int], random: Random) -> Array:
    """Spread ``n`` places (n, 2), x and y, on a grid of a picture (H, W), in any order, each a little moved."""
    rows = max(1, round(np.sqrt(n * size[0] / size[1])))
    columns = -(-n // rows)
    cells = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)
    place = (cells + random.uniform(0.25, 0.75, cells.shape)) * [size[1] / max(columns, 1), size[0] / rows]
    return random.permutation(place)[:n]


@function
def _thinned(place, distance, n):  # type: ignore[no-untyped-def]
    """Choose the first ``n`` places that keep their distance from those before; -1 where there are too few."""
    chosen = np.full(n, -1)
    count = 0
    for i in range(len(place)):
        free = True
        for k in range(count):
            dx, dy = place[chosen[k], 0] - place[i, 0], place[chosen[k], 1] - place[i, 1]
            if dx * dx + dy * dy <= distance[i] * distance[i]:
                free = False
                break
        if free:
            chosen[count] = i
            count += 1
            if count == n:
                break
    return chosen


def curves_along(angles: Array, picture: Array, places: Array, half: Array, hand: Hand, random: Random) -> Array:
    """Make curves (n, 3, 2) along a field of directions, through ``places`` and ``half`` pixels to either side."""
    n = len(places)
    x, y = places.astype(int).T
    angle = angles[y, x]
    ends = [_trace(angles, picture, places, angle + turn, half, hand) - places for turn in (np.pi, 0.0)]
    sector = np.pi / hand.directions
    turn = sector * np.round(angle / sector) + np.radians(hand.shaky) * random.normal(size=n) - angle
    cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
    start, end = (
        places + np.concatenate([x * cosine - y * sine, x * sine + y * cosine], 1)
        for x, y in ((end[:, :1], end[:, 1:]) for end in ends)
    )
    return np.stack([start, 2 * places - 0.5 * (start + end), end], 1)


def _trace(angles: Array, picture: Array, places: Array, angle: Array, half: Array, hand: Hand) -> Array:
    """Go ``half`` (n,) pixels along the field from ``places`` (n, 2), towards ``angle`` (n,) at first."""
    step, place = np.maximum(half / STEPS, 1e-3)[:, None], places.copy()
    most, begun = hand.turn, picture[tuple(places.astype(int).T[::-1])]
    for number in range(STEPS):
        x = np.clip(place[:, 0].astype(int), 0, angles.shape[1] - 1)
        y = np.clip(place[:, 1].astype(int), 0, angles.shape[0] - 1)
        if hand.clip and number >= SURE:
            step = np.where(np.abs(picture[y, x] - begun).max(1, keepdims=True) > hand.clip, 0, step)
        here = angles[y, x]
        here = here + np.pi * np.round((angle - here) / np.pi)
        angle = angle + np.clip(here - angle, -most, most)
        place = place + step * np.stack([np.cos(angle), np.sin(angle)], 1)
    return place


def pick_colors(picture: Array, places: Array, width: Array, hand: Hand, random: Random) -> Array:
    """Pick colours (n, 3) from a picture as blurred as the strokes are wide; the same paint is never mixed twice."""
    from skimage.color import lab2rgb, rgb2lab  # noqa: PLC0415

    levels = np.stack([rgb2lab(gaussian_blur(picture, (blur, blur, 0))) for blur in BLURS])
    level = np.abs(np.log(BLURS)[None] - np.log(0.35 * width)[:, None]).argmin(1)
    x, y = places.astype(int).T
    color = levels[level, y, x]
    if hand.palette:
        paints = color[random.integers(0, len(color), hand.palette)]
        color = paints[((color[:, None] - paints[None]) ** 2).sum(-1).argmin(1)]
    color = color + random.normal(size=color.shape) * [5.0, 3.5, 3.5] * np.array(hand.color)
    with warnings.catch_warnings(action="ignore"):  # of colours that no screen shows
        return np.clip(lab2rgb(color[None])[0], 0.01, 0.99)
