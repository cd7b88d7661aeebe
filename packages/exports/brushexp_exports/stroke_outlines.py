"""Convert strokes to polygons that outline round-ended lines along their curves."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts.families import ExportJob
from brushexp.contracts.pictures import hex_of
from brushexp.contracts.strokes import curve_of, length_of, point_at

PIECES = 16  # number of pieces per curve
CAP = 6  # number of points between the sides at each round end
AT_ONCE = 4096  # number of strokes outlined in one batch
LEAST_STEP = 1e-9  # length in pixels below which a chord has no direction
Array = np.ndarray


class OutlinedStroke(NamedTuple):
    """A stroke with its outline and measurements, in pixels, with x to the right and y down."""

    number: int  # number in the catalogue
    order: int  # 0 is the bottom stroke
    outline: Array  # (P, 2), counterclockwise for the viewer; the first point is not repeated
    length: float  # length from tip to tip
    width: float
    direction: float  # degrees clockwise from horizontal, 0 to 180
    color: str  # "#rrggbb"
    opacity: float


def outlined_strokes(job: ExportJob) -> Iterator[OutlinedStroke]:
    """Yield the outlined strokes of a painting, bottom to top."""
    order = 0
    for number in job.bottom_up.cpu().split(AT_ONCE):
        strokes = job.strokes[number.to(job.strokes.position.device)].map(lambda value: value.detach().cpu().double())
        curve, width = curve_of(strokes), (strokes.width * strokes.scale).numpy()
        length = length_of(curve).numpy() + width
        way = (curve[:, 2] - curve[:, 0]).numpy()
        direction = np.degrees(np.arctan2(way[:, 1], way[:, 0])) % 180
        color = strokes.color.numpy()
        outlines = outline_lines(curve, width)
        for row, stroke in enumerate(number.tolist()):
            yield OutlinedStroke(
                stroke,
                order,
                outlines[row],
                float(length[row]),
                float(width[row]),
                float(direction[row]),
                hex_of(color[row]),
                float(strokes.opacity[row]),
            )
            order += 1


def outline_lines(curve: Tensor, width: Array) -> Array:
    """Compute outlines (N, P, 2) of round-ended lines of ``width`` (N,) along quadratic Bezier curves (N, 3, 2)."""
    t = torch.linspace(0, 1, PIECES + 1, dtype=torch.float64)
    points = point_at(curve[:, None], t).numpy()
    step = np.gradient(points, axis=1)
    angle = np.arctan2(step[..., 1], step[..., 0])
    angle = np.where(np.hypot(step[..., 0], step[..., 1]) < LEAST_STEP, 0.0, angle)
    turn = np.pi * np.linspace(0, 1, CAP + 2)[1:-1]
    parts = [
        _beside(points, angle + np.pi / 2, width),
        _beside(points[:, -1:], angle[:, -1:] + np.pi / 2 - turn, width),
        _beside(points[:, ::-1], angle[:, ::-1] - np.pi / 2, width),
        _beside(points[:, :1], angle[:, :1] - np.pi / 2 - turn, width),
    ]
    return np.concatenate(parts, 1)


def _beside(points: Array, angle: Array, width: Array) -> Array:
    """Shift ``points`` by half the line width in the direction of ``angle``."""
    return points + 0.5 * width[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
