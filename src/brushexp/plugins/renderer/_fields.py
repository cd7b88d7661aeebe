"""Coordinates of pixels along and across a stroke, as smooth planes that a network can look at.

They are approximate (a network corrects them) so that they need no search for the nearest point: the curve is taken as
a parabola over its chord, whose lean along the chord is undone to first order. Valid strokes, whose control points lie
near the middle, deviate little from that.
"""

import math

import torch
from torch import Tensor

from brushexp.strokes.prior import WIDTH

WAVES = 4  # cosines and sines across the stroke, of 1/2, 1, 2, 4 periods per half width: what streaks are made of
PLANES = 3 + 2 * WAVES
SHORTEST = 1e-4  # least squared length that is divided by, half-windows; valid strokes have 0.007
THINNEST = 1e-3  # half width that is divided by, half-windows; valid strokes have 0.03
FARTHEST = 3.0  # half widths from the axis


def stroke_planes(parameters: Tensor, side: int) -> Tensor:
    """Planes (n, PLANES, side, side) of strokes (n, 10) as `strokes.prior.parameters_of` writes them.

    Along the chord from -1 (start) to 1 (end); across it in half widths; how far beyond an end, in half widths; and
    waves across, which fade away from the stroke. Differentiable in the parameters.
    """
    line = (torch.arange(side, device=parameters.device, dtype=parameters.dtype) + 0.5) * (2 / side) - 1
    start, control, end, width, _ = parameters[:, :, None, None].split([2, 2, 2, 1, 3], dim=1)  # (n, ., 1, 1)
    half = WIDTH[0] + 0.5 * (WIDTH[1] - WIDTH[0]) * (width + 1)  # a width in windows is a half width in half-windows
    half = half.clamp_min(THINNEST)
    chord, lift = end - start, control - start
    square = chord.square().sum(1, keepdim=True).clamp_min(SHORTEST)
    length = square.sqrt()
    dx, dy = chord[:, :1], chord[:, 1:]
    x, y = line[None, None, None, :] - start[:, :1], line[None, None, :, None] - start[:, 1:]
    along = (x * dx + y * dy) / square  # (n, 1, side, side)
    lean = (lift * chord).sum(1, keepdim=True) / square - 0.5
    bend = (dx * lift[:, 1:] - dy * lift[:, :1]) / length
    t = along.clamp(0, 1)
    t = (t - 2 * lean * t * (1 - t)).clamp(0, 1)
    slope = 2 * bend / length * (1 - 2 * t)
    across = ((dx * y - dy * x) / length - 2 * bend * t * (1 - t)) / half * torch.rsqrt(1 + slope.square())
    beyond = ((along - 0.5).abs() - 0.5).clamp_min(0) * length / half
    v = across.clamp(-FARTHEST, FARTHEST)
    near = torch.exp(-0.25 * v.square())
    planes = [2 * along.clamp(-0.5, 1.5) - 1, v, beyond.clamp_max(FARTHEST)]
    cosine, sine = torch.cos(0.5 * math.pi * v), torch.sin(0.5 * math.pi * v)
    for _ in range(WAVES):
        cosine, sine = cosine.square() - sine.square(), 2 * sine * cosine  # of twice the angle
        planes += [near * cosine, near * sine]
    return torch.cat(planes, dim=1)
