"""Path data of SVG (W3C, SVG 1.1, section 8): curves, and outlines of strokes whose width tapers.

Coordinates are whole numbers of units of ``10 ** -digits`` pixels, so that relative ones add up exactly.
"""

from collections.abc import Iterator

import torch
from torch import Tensor

PIECES = 5  # cubic curves that make each long side of a tapered stroke
TURN = 1e-3  # of the parameter: how near to its sharpest bend a curve that folds is sampled, on either side
SWING = 8.0  # radians per unit of the parameter: sides of a curve that turns faster are drawn as if it were this


def number(units: int, digits: int) -> str:
    """A number of units as short as it can be written: ``.5`` and not ``0.50``."""
    text = f"{units / 10**digits:.{digits}f}"
    if digits:
        text = text.rstrip("0").rstrip(".")
    return text.replace("0.", ".", 1) if text.startswith(("0.", "-0.")) else text


def packed(units: list[int], digits: int) -> str:
    """Numbers after each other; a minus separates them as well as a space."""
    return " ".join([number(value, digits) for value in units]).replace(" -", "-")


def line(points: list[int], digits: int) -> str:
    """A quadratic Bezier curve (x and y of start, control, end); of a point something that has a direction."""
    sx, sy, cx, cy, ex, ey = points
    start = f"M{packed([sx, sy], digits)}"
    if sx == cx == ex and sy == cy == ey:
        return f"{start}h{number(1, digits)}"
    return f"{start}q{packed([cx - sx, cy - sy, ex - sx, ey - sy], digits)}"


def disc(centre: list[int], radius: int, digits: int) -> str:
    """A circle, in the direction in which `tapered` goes around a stroke."""
    arc = f"a{packed([radius, radius], digits)} 0 1 0 "
    first = f"M{packed([centre[0] - radius, centre[1]], digits)}"
    return f"{first}{arc}{packed([2 * radius, 0], digits)}{arc}{packed([-2 * radius, 0], digits)}z"


def tapered(curve: Tensor, middle: Tensor, offset: Tensor, taper: float, digits: int) -> Iterator[list[str]]:
    """Outlines of strokes that are thinner at their ends, with round ends; fill them by the rule nonzero.

    The half width at parameter t is ``middle * (1 - taper * (2 t - 1)^2) + offset``, and 0 where that is less. Each
    side is a cubic Hermite curve through ``PIECES + 1`` points. A curve that folds gets a disc where it does.

    Args:
        curve: (N, 3, 2) control points, pixels.
        middle: (N,) pixels.
        offset: (N, K) pixels.
        taper: 0 to 1.
        digits: decimals.

    Yields:
        The K outlines of each stroke; one that is a point has as its outline a disc as wide as its ends.
    """
    unit = 10**digits
    bend, folds = sharpest(curve, middle)
    t = torch.where(folds[:, None], _around_bend(bend), torch.linspace(0, 1, PIECES + 1).to(bend))
    point, velocity, normal, swing = _frame(curve, t)
    sides, ends, tips = [], [], []
    for extra in offset.unbind(1):
        wide, slope = _radius(t, middle, extra, taper)
        left = _side(t, point + wide[..., None] * normal, _along(velocity, normal, swing, wide, slope))
        right = _side(t, point - wide[..., None] * normal, _along(velocity, normal, swing, -wide, -slope))
        sides.append(torch.stack([left, right.flip(1)], dim=1))
        ends.append(wide[:, [0, -1]])
        tips.append(_radius(bend[:, None], middle, extra, taper)[0][:, 0])
    tip = _frame(curve, bend[:, None])[0][:, 0]
    tables = (torch.stack(sides, 1), torch.stack(ends, 1), torch.stack(tips, 1), curve[:, 0], tip)  # each (N, ...)
    rows = [(table * unit).round().long().tolist() for table in tables]
    is_point = ((curve - curve[:, :1]).abs().amax((1, 2)) * unit < 1).tolist()
    for shapes, caps, discs, start, fold, folded, still in zip(*rows, folds.tolist(), is_point, strict=True):
        found = []
        for sides_there, ends_there, tip_there in zip(shapes, caps, discs, strict=True):
            if still:
                found.append(disc(start, ends_there[0], digits) if ends_there[0] > 0 else "")
                continue
            text = _outline(sides_there[0], sides_there[1], ends_there, digits)
            found.append(text + disc(fold, tip_there, digits) if folded and tip_there > 0 else text)
        yield found


def sharpest(curve: Tensor, half: Tensor) -> tuple[Tensor, Tensor]:
    """Parameter (N,) where curves (N, 3, 2) bend most, and whether more tightly than ``half`` (N,) of their width."""
    start, control, end = curve.unbind(1)
    bend, forward = start - 2 * control + end, control - start
    at = -(forward * bend).sum(1) / bend.square().sum(1).clamp_min(torch.finfo(curve.dtype).tiny)
    inside = (at > 2 * TURN) & (at < 1 - 2 * TURN)
    at = at.clamp(0, 1)
    velocity = 2 * (forward + at[:, None] * bend)
    turn = 2 * (velocity[:, 0] * bend[:, 1] - velocity[:, 1] * bend[:, 0]).abs()
    return at, inside & (velocity.norm(dim=1) ** 3 <= turn * half)


def _around_bend(bend: Tensor) -> Tensor:
    """Parameters (N, PIECES + 1) of which two are on either side of ``bend`` (N,)."""
    none, all_ = torch.zeros_like(bend), torch.ones_like(bend)
    return torch.stack([none, bend / 2, bend - TURN, bend + TURN, (1 + bend) / 2, all_], dim=1)


def _frame(curve: Tensor, t: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Point, velocity and unit normal (N, T, 2) of curves (N, 3, 2) at t (N, T), and radians (N, T) it turns per t."""
    start, control, end = (point[:, None] for point in curve.unbind(1))
    bend, u = start - 2 * control + end, t[..., None]
    point = (1 - u) ** 2 * start + 2 * u * (1 - u) * control + u**2 * end
    velocity = 2 * ((1 - u) * (control - start) + u * (end - control))
    still = velocity.norm(dim=-1) <= 1e-6 * bend.norm(dim=-1)  # at an end where two control points are one
    heading = torch.where(still[..., None], bend * torch.where(u > 0.5, -1.0, 1.0), velocity)
    heading = heading / heading.norm(dim=-1, keepdim=True).clamp_min(torch.finfo(curve.dtype).tiny)
    normal = torch.stack([-heading[..., 1], heading[..., 0]], dim=-1)
    speed = velocity.square().sum(-1).clamp_min(torch.finfo(curve.dtype).tiny)
    turn = 2 * (velocity[..., 0] * bend[..., 1] - velocity[..., 1] * bend[..., 0]) / speed
    return point, velocity, normal, turn.clamp(-SWING, SWING)


def _radius(t: Tensor, middle: Tensor, extra: Tensor, taper: float) -> tuple[Tensor, Tensor]:
    """Half width (N, T) at t, and its derivative."""
    radius = middle[:, None] * (1 - taper * (2 * t - 1) ** 2) + extra[:, None]
    slope = -4 * taper * middle[:, None] * (2 * t - 1)
    return radius.clamp_min(0), torch.where(radius > 0, slope, 0.0)


def _along(velocity: Tensor, normal: Tensor, swing: Tensor, radius: Tensor, slope: Tensor) -> Tensor:
    """Derivative (N, T, 2) of a side, point + radius * normal: the normal turns against the direction of travel."""
    heading = torch.stack([normal[..., 1], -normal[..., 0]], dim=-1)
    return velocity - (radius * swing)[..., None] * heading + slope[..., None] * normal


def _side(t: Tensor, place: Tensor, derivative: Tensor) -> Tensor:
    """Control points (N, 3 * PIECES + 1, 2) of the cubic curves through ``place`` (N, T, 2) with that derivative."""
    third = t.diff(dim=1)[..., None] / 3
    after, before = place[:, :-1] + derivative[:, :-1] * third, place[:, 1:] - derivative[:, 1:] * third
    pieces = torch.stack([after, before, place[:, 1:]], dim=2).flatten(1, 2)
    return torch.cat([place[:, :1], pieces], dim=1)


def _outline(left: list[list[int]], right: list[list[int]], ends: list[int], digits: int) -> str:
    """Along one side, around the end, back along the other side and around the start."""
    text = f"M{packed(left[0], digits)}{_curves(left, digits)}{_cap(left[-1], right[0], ends[1], digits)}"
    return text + f"{_curves(right, digits)}{_cap(right[-1], left[0], ends[0], digits)}z"


def _curves(points: list[list[int]], digits: int) -> str:
    """Cubic curves after each other, relative."""
    steps = []
    for first in range(0, len(points) - 1, 3):
        x, y = points[first]
        steps += [value for px, py in points[first + 1 : first + 4] for value in (px - x, py - y)]
    return f"c{packed(steps, digits)}"


def _cap(place: list[int], to: list[int], radius: int, digits: int) -> str:
    """Half a circle from one side to the other."""
    step = [to[0] - place[0], to[1] - place[1]]
    if step == [0, 0]:
        return ""
    if radius <= 0:
        return f"l{packed(step, digits)}"
    return f"a{packed([radius, radius], digits)} 0 0 0 {packed(step, digits)}"
