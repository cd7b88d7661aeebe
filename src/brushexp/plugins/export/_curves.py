"""The way of a pen along one stroke, in millimetres; points of the plane are complex numbers."""

import math

import numpy as np

Array = np.ndarray

STILL = 1e-9  # of a stroke's size: shorter legs have no direction
MOST_STEPS = 4096  # along a stroke: enough for a bend of a kilometre
MOST_POINTS = 4_000_000  # in a stroke; one so absurd that it has more is not filled


def flattened(curve: Array, tolerance: float, reach: float = 0.0) -> tuple[Array, Array]:
    """A quadratic Bezier curve as a polyline.

    A chord over a step h of the parameter is at most |P0 - 2 P1 + P2| h^2 / 4 from the curve: that gives even steps.
    More points are put where the curve turns, so that lines parallel to it are smooth as well; where it turns back on
    itself there are several points in one place, with the directions of half a circle.

    Args:
        curve: (3,) complex control points.
        tolerance: how far the polyline may be from the curve, > 0.
        reach: farthest parallel line; its corners cut off at most ``tolerance`` more.

    Returns:
        Points (M,) from the first control point to the last, M >= 2, and unit directions (M,) there.
    """
    first, last = curve[1] - curve[0], curve[2] - curve[1]
    bend = last - first
    size = max(abs(first), abs(last))
    even = min(max(1, math.ceil(math.sqrt(abs(bend) / (4 * tolerance)))), MOST_STEPS)
    ahead, behind = _directions(first, last, size)
    t = np.arange(1, even) / even
    velocity = first + t * bend
    moving = np.abs(velocity) > STILL * size
    t, velocity = t[moving], velocity[moving]
    turn = float(np.angle(behind * np.conj(ahead)))
    turns = ahead * np.exp(1j * turn * _fractions(abs(turn), reach, tolerance))
    opening, closing = _cross(first, turns), _cross(last, turns)
    t = np.concatenate([[0.0], t, opening / (opening - closing), [1.0]])
    directions = np.concatenate([[ahead], velocity / np.abs(velocity), turns, [behind]])
    turned = np.clip(np.angle(directions * np.conj(ahead)) * (1 if turn >= 0 else -1), 0, abs(turn))
    order = np.lexsort((turned, np.round(t, 9)))
    t, directions = t[order], directions[order]
    points = (1 - t) ** 2 * curve[0] + 2 * t * (1 - t) * curve[1] + t**2 * curve[2]
    return points, directions


def hatched(
    curve: Array,
    width: float,
    pen: float,
    tolerance: float,
    passes: int | None = None,
    near: float = 0.0,
    far: float = math.inf,
) -> Array:
    """One unbroken way of a pen that fills a stroke with round ends: its outline, and then lines to and fro within it.

    The pen's centre stays within (width - pen) / 2 of the curve, so that no ink leaves the stroke. The lines are
    parallel to the curve and at most ``pen`` apart; they end on the outline.

    Args:
        curve: (3,) complex control points.
        width: of the stroke.
        pen: width of the pen; a stroke that is not wider is drawn along its middle.
        tolerance: how far a line may be from where it should be.
        passes: at most so many lines beside each other, with gaps if they do not fill it; 1 is the middle alone.
        near: lines within the outline that are nearer to the curve are left out, since nobody is there to see them;
        far: and so are those that are farther.

    Returns:
        Points (M,), M >= 2.
    """
    radius = min(0.5 * max(width - pen, 0.0), far)
    needed = math.ceil(2 * radius / pen - 1e-9) + 1
    count = min(needed, passes or needed)
    if count == 1:
        return flattened(curve, tolerance)[0]
    points, directions = flattened(curve, 0.5 * tolerance, radius)
    normals = 1j * directions
    arc = np.exp(1j * math.pi * np.concatenate([[0], _fractions(math.pi, radius, 0.5 * tolerance), [1]]))
    parts = [
        points[0] + radius * normals[0] * arc,
        points - radius * normals,
        points[-1] - radius * normals[-1] * arc,
        (points + radius * normals)[::-1],
    ]
    for k, offset in enumerate(_offsets(radius, count, near)[: MOST_POINTS // len(points)]):
        beyond = math.sqrt(radius**2 - offset**2)
        line = points + offset * normals
        line = np.concatenate([[line[0] - beyond * directions[0]], line, [line[-1] + beyond * directions[-1]]])
        parts.append(line[::-1] if k % 2 else line)
    way = np.concatenate(parts)
    moved = np.abs(np.diff(way)) > 1e-6
    return way[np.concatenate([[True], moved])] if moved.any() else way[:2]


def distance(point: complex, line: Array) -> float:
    """How far a point is from a polyline (M,)."""
    legs = np.diff(line)
    along = np.real(np.conj(legs) * (point - line[:-1])) / np.maximum(np.abs(legs) ** 2, np.finfo(float).tiny)
    return float(np.abs(point - line[:-1] - along.clip(0, 1) * legs).min())


def _offsets(radius: float, count: int, near: float) -> Array:
    """Of ``count`` even offsets from ``radius`` to its negative those between both that are at least ``near``."""
    step = 2 * radius / (count - 1)
    inner = min(count - 2, math.floor((radius - near) / step))
    if near <= 0:
        return radius - step * np.arange(1, count - 1)
    outside = radius - step * np.arange(1, inner + 1)
    return np.concatenate([outside, -outside[::-1]])


def _directions(first: complex, last: complex, size: float) -> tuple[complex, complex]:
    """Unit directions at both ends; a leg without one has that of the other, and a point looks to the right."""
    legs = [leg / abs(leg) if abs(leg) > STILL * size else None for leg in (first, last)]
    known = next((leg for leg in legs if leg is not None), 1.0 + 0j)
    ahead, behind = (known if leg is None else leg for leg in legs)
    return ahead, behind


def _fractions(turn: float, radius: float, tolerance: float) -> Array:
    """Where an arc of ``turn`` radians is divided, in (0, 1), so that its chords are within ``tolerance`` of it."""
    if radius <= 0:
        return np.empty(0)
    step = 2 * math.acos(max(0.0, 1 - tolerance / radius))
    count = min(max(1, math.ceil(turn / step)), MOST_STEPS)
    return np.arange(1, count) / count


def _cross(one: complex, other: Array) -> Array:
    return np.imag(np.conj(one) * other)
