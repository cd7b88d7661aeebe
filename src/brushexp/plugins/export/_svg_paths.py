"""Write the shapes and colours of strokes as SVG paths and gradients."""

from collections.abc import Iterator

import torch
from torch import Tensor

from brushexp.compositing.profile import Profile
from brushexp.strokes.bezier import point_at

SIDE_POINTS, WEDGE_POINTS = 24, 12  # points on each long side of a stroke that tapers, and of a stroke that only widens
ONE_COLOR = 1 / 255  # largest drift of a stroke drawn in one colour
LEAST_SPREAD = 0.3  # smallest ratio of a curve's sideways to lengthwise extent at which colours follow it sideways
TURN = 1e-3  # a folding curve is sampled this close to its sharpest bend, on either side, in the parameter


def hexadecimal(color: Tensor) -> list[str]:
    """Format colours (N, 3) in [0, 1] as ``#rrggbb``."""
    levels = (color * 255 + 0.5).clamp(0, 255).long().tolist()
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in levels]


def gradients(profile: Profile, number: Tensor, digits: int) -> Iterator[tuple[str, str]]:
    """Yield each stroke's linear gradient ("" unless its colour drifts) and the value of its paint attribute.

    The gradient is the linear function of x and y that best fits 2 t - 1 along the curve.
    """
    if not profile.drifts:
        yield from (("", paint) for paint in hexadecimal(profile.color))
        return
    u = torch.linspace(-1, 1, WEDGE_POINTS).to(profile.curve)
    point = point_at(profile.curve[:, None], ((u + 1) / 2).expand(len(profile.curve), -1))
    middle = point.mean(1)
    slope = torch.linalg.pinv(point - middle[:, None], rtol=LEAST_SPREAD) @ u  # (N, 2) per pixel
    half = slope / slope.square().sum(1, keepdim=True)
    ends = torch.stack([middle - half, middle + half], dim=1)
    drifts = (profile.drift.abs().amax(1) > ONE_COLOR) & ends.isfinite().all((1, 2))
    colors = zip(*(hexadecimal(profile.color + k * profile.drift) for k in (0, -1, 1)), strict=True)
    rows = zip(drifts.tolist(), number.tolist(), round_to(ends, digits).flatten(1).tolist(), colors, strict=True)
    for is_gradient, name, line, (plain, first, last) in rows:
        if not is_gradient:
            yield "", plain
            continue
        place = " ".join(f'{axis}="{at:.12g}"' for axis, at in zip(("x1", "y1", "x2", "y2"), line, strict=True))
        stops = f'<stop stop-color="{first}"/><stop offset="1" stop-color="{last}"/>'
        head = f'<linearGradient id="drift-{name}" gradientUnits="userSpaceOnUse" {place}>'
        yield f"{head}{stops}</linearGradient>\n", f"url(#drift-{name})"


def _numbers(*values: float) -> str:
    return " ".join(["%.12g"] * len(values)) % values


def curve_paths(curve: Tensor, digits: int) -> Iterator[str]:
    """Write quadratic Bezier curves (N, 3, 2) as SVG path data; a point becomes a very short line."""
    curve = round_to(curve, digits)
    further = round_to((curve[:, 1:] - curve[:, :1]).flatten(1), digits)
    for start, ends in zip(curve[:, 0].tolist(), further.tolist(), strict=True):
        yield f"M{_numbers(*start)}" + (f"q{_numbers(*ends)}" if any(ends) else f"h{_numbers(10**-digits)}")


def round_to(values: Tensor, digits: int) -> Tensor:
    """Round to ``digits`` decimals, avoiding -0."""
    return values.round(decimals=digits) + 0.0


def outline_paths(profile: Profile, middle: Tensor, offset: Tensor, digits: int) -> Iterator[list[str]]:
    """Write outlines of round-ended strokes of varying thickness, for the nonzero fill rule.

    The half width at parameter t is ``middle * (1 - taper * u^2) * (1 + widening * u) + offset``, with u = 2 t - 1, or
    0 if this is negative. The sides are polylines. A curve that folds gets a disc at the fold, and a point becomes a
    disc. Each iteration yields the K outlines of a stroke; ``middle`` (N,) and ``offset`` (N, K) are in pixels.
    """
    curve, taper, widening = profile.curve, profile.taper, profile.widening[:, None]
    bend, folds = sharpest_bend(curve, middle)
    point_like = (curve - curve[:, :1]).abs().amax((1, 2)) * 10**digits < 1
    even = torch.linspace(0, 1, SIDE_POINTS if taper else WEDGE_POINTS).to(curve).expand(len(curve), -1)
    t = torch.cat([even, bend[:, None] - TURN, bend[:, None] + TURN], dim=1).clamp(0, 1).sort(1).values  # (N, T)
    point, normal = point_at(curve[:, None], t)[:, None], _normal(curve, t)[:, None]  # (N, 1, T, 2)
    along = 2 * torch.cat([t, bend[:, None]], dim=1) - 1
    half = middle[:, None] * (1 - taper * along**2) * (1 + widening * along)
    half = (half[:, None] + offset[..., None]).clamp_min(0)  # (N, K, T + 1), the last at the bend
    reach = half[..., :-1, None] * normal
    sides = (point + reach).flatten(2), (point - reach).flip(2).flatten(2)  # (N, K, 2 T): x, y, x, y, ...
    tips = half[..., -1:] * (folds | point_like)[:, None, None]
    tables = (*sides, half[..., [0, -2]], tips, point_at(curve, bend))
    columns = [round_to(table, digits).tolist() for table in tables]
    for lefts, rights, halves, discs, (x, y) in zip(*columns, strict=True):
        outlines = []
        for side, back, (first, last), (tip,) in zip(lefts, rights, halves, discs, strict=True):
            # Along one side, around the end, back along the other side and around the start.
            text = f"M{_numbers(*side)}A{_numbers(last, last)} 0 0 0 {_numbers(*back[:2])}L"
            text += f"{_numbers(*back[2:])}A{_numbers(first, first)} 0 0 0 {_numbers(*side[:2])}z"
            if tip > 0:
                arc = f"a{_numbers(tip, tip)} 0 1 0 "
                text += f"M{_numbers(x - tip, y)}{arc}{_numbers(2 * tip, 0)}{arc}{_numbers(-2 * tip, 0)}z"
            outlines.append(text)
        yield outlines


def sharpest_bend(curve: Tensor, half: Tensor) -> tuple[Tensor, Tensor]:
    """Find the parameter (N,) of each curve's sharpest bend, and whether the bend's radius is below ``half``."""
    start, control, end = curve.unbind(1)
    bend, forward = start - 2 * control + end, control - start
    at = -(forward * bend).sum(1) / bend.square().sum(1).clamp_min(torch.finfo(curve.dtype).tiny)
    inside = (at > 2 * TURN) & (at < 1 - 2 * TURN)
    at = at.clamp(0, 1)
    velocity = 2 * (forward + at[:, None] * bend)
    turn = 2 * (velocity[:, 0] * bend[:, 1] - velocity[:, 1] * bend[:, 0]).abs()
    return at, inside & (velocity.norm(dim=1) ** 3 <= turn * half)


def _normal(curve: Tensor, t: Tensor) -> Tensor:
    """Compute unit normals (N, T, 2) of curves (N, 3, 2) at t (N, T); normals at the ends come from nearby points."""
    start, control, end = (point[:, None] for point in curve.unbind(1))
    beside = t.clamp(1e-4, 1 - 1e-4)[..., None]
    velocity = (1 - beside) * (control - start) + beside * (end - control)
    heading = velocity / velocity.norm(dim=-1, keepdim=True).clamp_min(torch.finfo(curve.dtype).tiny)
    return torch.stack([-heading[..., 1], heading[..., 0]], dim=-1)
