"""Path data of SVG (W3C, SVG 1.1, section 8): curves, and outlines of strokes whose width tapers."""

from collections.abc import Iterator

import torch
from torch import Tensor

from brushexp.strokes.bezier import point_at

SIDE_POINTS = 24  # of each long side of a tapered stroke
TURN = 1e-3  # of the parameter: how near to its sharpest bend a curve that folds is sampled, on either side


def number(value: float, digits: int) -> str:
    """A number as short as it can be written: ``.5`` and not ``0.50``."""
    text = f"{value:.{digits}f}"
    if digits:
        text = text.rstrip("0").rstrip(".")
    return text.replace("0.", ".", 1) if text.startswith(("0.", "-0.")) else text


def packed(values: list[float], digits: int) -> str:
    """Numbers after each other; a minus separates them as well as a space."""
    return " ".join([number(value, digits) for value in values]).replace(" -", "-")


def line(points: list[float], digits: int) -> str:
    """A quadratic Bezier curve (x and y of start, control, end); of a point something that has a direction."""
    sx, sy, cx, cy, ex, ey = (round(value, digits) for value in points)
    start = f"M{packed([sx, sy], digits)}"
    if sx == cx == ex and sy == cy == ey:
        return f"{start}h{number(10**-digits, digits)}"
    return f"{start}q{packed([cx - sx, cy - sy, ex - sx, ey - sy], digits)}"


def tapered(curve: Tensor, middle: Tensor, offset: Tensor, taper: float, digits: int) -> Iterator[list[str]]:
    """Outlines of strokes that are thinner at their ends, with round ends; fill them by the rule nonzero.

    The half width at parameter t is ``middle * (1 - taper * (2 t - 1)^2) + offset``, and 0 where that is less. Sides
    are chains of chords. A curve that folds gets a disc where it does, and one that is a point is a disc.

    Args:
        curve: (N, 3, 2) control points, pixels.
        middle: (N,) pixels.
        offset: (N, K) pixels.
        taper: 0 to 1.
        digits: decimals.

    Yields:
        The K outlines of each stroke.
    """
    bend, folds = sharpest(curve, middle)
    point_like = (curve - curve[:, :1]).abs().amax((1, 2)) * 10**digits < 1
    even = torch.linspace(0, 1, SIDE_POINTS).to(curve).expand(len(curve), -1)
    t = torch.cat([even, bend[:, None] - TURN, bend[:, None] + TURN], dim=1).clamp(0, 1).sort(1).values  # (N, T)
    point, normal = point_at(curve[:, None], t)[:, None], _normal(curve, t)[:, None]  # (N, 1, T, 2)
    half = middle[:, None] * (1 - taper * (2 * torch.cat([t, bend[:, None]], dim=1) - 1) ** 2)
    half = (half[:, None] + offset[..., None]).clamp_min(0)  # (N, K, T + 1), the last one at the bend
    reach = half[..., :-1, None] * normal
    left, right = (point + reach).flatten(2), (point - reach).flip(2).flatten(2)  # (N, K, 2 T): x, y, x, y, ...
    tables = (left, right, half[..., [0, -2, -1]], point_at(curve, bend), folds | point_like)
    for lefts, rights, halves, (x, y), with_disc in zip(*(table.tolist() for table in tables), strict=True):
        found = []
        for there, back, (first, last, tip) in zip(lefts, rights, halves, strict=True):
            # Along one side, around the end, back along the other side and around the start.
            text = f"M{packed(there, digits)}A{packed([last, last], digits)} 0 0 0 {packed(back[:2], digits)}L"
            text += f"{packed(back[2:], digits)}A{packed([first, first], digits)} 0 0 0 {packed(there[:2], digits)}z"
            if with_disc and tip > 0:
                arc = f"a{packed([tip, tip], digits)} 0 1 0 "
                text += f"M{packed([x - tip, y], digits)}{arc}{packed([2 * tip, 0], digits)}"
                text += f"{arc}{packed([-2 * tip, 0], digits)}z"
            found.append(text)
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


def _normal(curve: Tensor, t: Tensor) -> Tensor:
    """Unit normal (N, T, 2) of curves (N, 3, 2) at t (N, T); at an end where control points are one, from beside it."""
    start, control, end = (point[:, None] for point in curve.unbind(1))
    beside = t.clamp(1e-4, 1 - 1e-4)[..., None]
    velocity = (1 - beside) * (control - start) + beside * (end - control)
    heading = velocity / velocity.norm(dim=-1, keepdim=True).clamp_min(torch.finfo(curve.dtype).tiny)
    return torch.stack([-heading[..., 1], heading[..., 0]], dim=-1)
