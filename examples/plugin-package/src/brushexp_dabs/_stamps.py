"""Stamp dabs along quadratic Bezier curves in compiled code; each worker paints a whole stroke on a separate canvas.

Lengths are in pixels of that canvas, which is finer than the picture; the picture is the canvas averaged over blocks.
"""

import numpy as np
import torch

from brushexp.contracts.families import Simulated
from brushexp.contracts.kernels import function
from brushexp.contracts.strokes import Strokes

F = np.float32
U = np.uint64
FARTHEST_POINT, WIDEST_STROKE = 4.0, 4.0  # half-windows and windows: what is farther away or wider is brought to here
PIECES = 64  # straight pieces that measure the length of a curve: 0.02 % too short where it turns back on itself
DRAWS = 3  # random numbers of a dab: two offsets and a radius
GOLDEN = U(0x9E3779B97F4A7C15)

Array = np.ndarray


def curves_of(strokes: Strokes, side: int) -> tuple[Array, Array]:
    """Return the points (n, 6) and the thickness (n,) of strokes in pixels of a canvas ``side`` wide, float64."""
    points = torch.cat([strokes.start, strokes.control, strokes.end], dim=1).double()
    width = strokes.width.double().clamp(0, WIDEST_STROKE)
    return ((points.clamp(-FARTHEST_POINT, FARTHEST_POINT) + 1) * (0.5 * side)).numpy(), (width * side).numpy()


def one_colour(strokes: Strokes, alpha: Array) -> Simulated:
    """Make simulated strokes, each of one colour, from their alpha (n, S, S), which is also their height."""
    cover = torch.from_numpy(alpha)
    color = strokes.color.clamp(0, 1)[:, :, None, None].expand(-1, -1, *cover.shape[1:])
    return Simulated(torch.cat([color, cover[:, None]], dim=1), cover)


@function
def dabs(begin, end, curve, radius, per_radius, look, pressure, seed, number, block, alpha):  # type: ignore[no-untyped-def]
    """Paint randomly displaced soft dabs at equal steps along the curves with indices ``begin`` to ``end - 1``.

    ``look`` contains hardness, opaque, opaque_by_pressure, opaque_linearize, offset_by_random and radius_by_random.
    ``pressure`` contains the pressure in the middle, the pressure at both ends, and the fractions of the length at
    which the middle begins and ends. ``seed`` and the strokes' ``number`` (n,) are uint64.
    """
    side = alpha.shape[1] * block
    for i in range(begin, end):
        bare = np.ones((side, side), F)
        _dab_along(bare, curve[i], radius[i], per_radius, look, pressure, _mix(_mix(seed) + GOLDEN * number[i]))
        _average(bare, block, alpha[i])


@function
def _dab_along(bare, curve, radius, per_radius, look, pressure, key):  # type: ignore[no-untyped-def]
    way = np.zeros(PIECES + 1)
    x, y = curve[0], curve[1]
    for k in range(1, PIECES + 1):
        u, v = _point(curve, k / PIECES)
        way[k] = way[k - 1] + np.sqrt((u - x) ** 2 + (v - y) ** 2)
        x, y = u, v
    count = max(int(way[PIECES] / radius * per_radius + 0.5), 1)  # a stroke without length leaves one dab
    piece = 0
    for j in range(count):
        share = (j + 0.5) / count
        reached = share * way[PIECES]
        while piece < PIECES - 1 and way[piece + 1] < reached:
            piece += 1
        step = way[piece + 1] - way[piece]
        x, y = _point(curve, (piece + (reached - way[piece]) / step if step > 0 else 0.0) / PIECES)
        force = pressure_at(share, *pressure)
        spread = look[4] * force * radius
        x += spread * _gauss(key, DRAWS * j)
        y += spread * _gauss(key, DRAWS * j + 1)
        size = radius * np.exp(look[5] * _gauss(key, DRAWS * j + 2))
        opacity = opacity_of(force, look[1], look[2], look[3], per_radius) * min((radius / size) ** 2, 1.0)
        _dab(bare, x, y, size, opacity, look[0])


@function
def pressure_at(share, middle, ends, head, tail):  # type: ignore[no-untyped-def]
    """Compute the pressure at a fraction of the stroke's length; it rises up to ``head`` and falls after ``tail``."""
    rise = min(share / head, 1.0) if head > 0 else 1.0
    sink = min((1 - share) / (1 - tail), 1.0) if tail < 1 else 1.0
    return ends + (middle - ends) * min(rise, sink)


@function
def opacity_of(pressure, opaque, by_pressure, linearize, per_radius):  # type: ignore[no-untyped-def]
    """Compute the opacity of one dab by libmypaint's formula, (opaque + by_pressure * pressure) * pressure.

    With ``linearize`` = 0, each dab has this opacity. With 1, the dabs that overlap at a point of the axis, which are
    those within a length of two radii, reach this opacity together.
    """
    wanted = min(max((opaque + by_pressure * pressure) * pressure, 0.0), 1.0)
    over_each_other = 1 + linearize * max(2 * per_radius - 1, 0.0)
    return 1 - (1 - wanted) ** (1 / over_each_other)


@function
def profile(square, hardness):  # type: ignore[no-untyped-def]
    """Compute a dab's opacity at a squared distance from its centre, in radii; ``hardness`` is neither 0 nor 1."""
    if square > 1:
        return F(0)
    if square <= hardness:
        return F(1) - square * (F(1) / hardness - F(1))
    return hardness / (F(1) - hardness) * (F(1) - square)


@function
def _dab(bare, x, y, radius, opacity, hardness):  # type: ignore[no-untyped-def]
    """Multiply ``bare`` by a dab's transparency; a radius below 1 pixel becomes 1 pixel, with lower opacity."""
    drawn = max(radius, 1.0)
    faint, hard, scale = F(opacity * (radius / drawn) ** 2), F(hardness), F(1 / drawn**2)
    side = len(bare)
    left, right = _pixels(x, drawn, side)
    top, bottom = _pixels(y, drawn, side)
    for row in range(top, bottom):
        dy = F(row + 0.5 - y)
        for column in range(left, right):
            dx = F(column + 0.5 - x)
            bare[row, column] *= F(1) - faint * profile((dx * dx + dy * dy) * scale, hard)


@function
def _pixels(middle, reach, side):  # type: ignore[no-untyped-def]
    """Find the range of pixels, first and last + 1, whose centres are within ``reach`` of ``middle``."""
    low, high = np.ceil(middle - reach - 0.5), np.floor(middle + reach - 0.5) + 1
    return int(min(max(low, 0), side)), int(min(max(high, 0), side))


@function
def _point(curve, t):  # type: ignore[no-untyped-def]
    a, b, c = (1 - t) * (1 - t), 2 * t * (1 - t), t * t
    return a * curve[0] + b * curve[2] + c * curve[4], a * curve[1] + b * curve[3] + c * curve[5]


@function
def _average(bare, block, alpha):  # type: ignore[no-untyped-def]
    over = F(1) / F(block * block)
    for row in range(len(alpha)):
        for column in range(len(alpha)):
            total = F(0)
            for v in range(block):
                for u in range(block):
                    total += bare[row * block + v, column * block + u]
            alpha[row, column] = max(F(1) - total * over, F(0))


@function
def _mix(word):  # type: ignore[no-untyped-def]
    """Mix the bits of a 64-bit integer (SplitMix64; Steele, Lea and Flood, 2014)."""
    word = (word ^ (word >> U(30))) * U(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> U(27))) * U(0x94D049BB133111EB)
    return word ^ (word >> U(31))


@function
def _gauss(key, counter):  # type: ignore[no-untyped-def]
    """Return a stroke's nearly normal random number ``counter``: a sum of four uniforms, between -3.5 and 3.5."""
    word = _mix(key + GOLDEN * U(counter + 1))
    low, high = U(0xFFFF), U(16)
    total = (word & low) + ((word >> high) & low) + ((word >> U(32)) & low) + (word >> U(48))
    return (np.float64(total) + 2.0) / 65536.0 * np.sqrt(3.0) - 2.0 * np.sqrt(3.0)
