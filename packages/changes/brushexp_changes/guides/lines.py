"""Align strokes with nearby lines."""

from dataclasses import dataclass

import numpy as np
import torch
from torch.nn import functional

from brushexp.contracts import UserError
from brushexp.contracts.pictures import FarStructure, along_edges, load_picture, sample_at
from brushexp.contracts.strokes import Strokes, curve_of, direction_of, length_of, point_at

REACH = 0.05  # distance from a line at which line and stroke weigh the same, as a fraction of the longer side
LEAST_SAY = 0.1  # weight of the lines below which a stroke is not changed
INK = 0.2  # difference from white above which a pixel belongs to a line; JPEG leaves artefacts around lines
SMOOTH = ((0.003, 1.0), (REACH, 0.01))  # smoothing radii as fractions of the longer side, and weights
SUBSTEPS = 4  # steps from the centre of a stroke to each end
Array = np.ndarray


@dataclass(frozen=True)
class Lines:
    """Line directions ``doubled`` (2, H, W), at doubled angles, and weights ``say`` (H, W): 1 on a line, 0 far away."""

    say: Array
    doubled: Array

    def directions(self, points: Array, own: Array) -> Array:
        """Blend directions ``own`` (n, 2), at doubled angles, with line directions at ``points``, as unit vectors."""
        say = sample_at(self.say, *points.T)[:, None]
        x, y = (say * sample_at(self.doubled, *points.T).T + (1 - say) * own).T
        angle = 0.5 * np.arctan2(y, x)
        return np.stack([np.cos(angle), np.sin(angle)], 1)


def load_lines(path: str, size: tuple[int, int]) -> Lines:
    """Load a picture of lines for a canvas of ``size`` (H, W); raise UserError if it does not contain lines."""
    picture = load_picture(path, max(size), "guides")
    picture = functional.interpolate(picture[None], size, mode="bilinear", align_corners=False)[0]
    ink = (1 - picture).amax(0).numpy().astype(np.float64)
    if not (ink > INK).any():
        raise UserError(f"guides={path} is white or transparent all over; draw lines on it in any colour")
    if (ink > INK).all():
        raise UserError(f"guides={path} has no white or transparent ground; draw lines on white or on transparent")
    return lines_of(ink)


def lines_of(ink: Array) -> Lines:
    """Estimate line directions from the ink of lines (H, W), 0 to 1."""
    from scipy.ndimage import distance_transform_edt  # noqa: PLC0415  (slow to import)

    side = max(ink.shape)
    tensor = FarStructure(ink[None])([(max(reach * side, 1.0), weight) for reach, weight in SMOOTH])
    angle = along_edges(tensor)
    say = np.exp2(-((distance_transform_edt(ink <= INK) / (REACH * side)) ** 2))
    return Lines(say, np.stack([np.cos(2 * angle), np.sin(2 * angle)]))


@torch.no_grad()
def follow(strokes: Strokes, lines: Lines) -> Strokes:
    """Align strokes near lines, keeping their centres, lengths, widths and colours; others stay bit-identical."""
    half = torch.full((len(strokes),), 0.5)
    middles = point_at(curve_of(strokes), half.to(strokes.position)).double().cpu().numpy()
    rows = torch.from_numpy(np.flatnonzero(sample_at(lines.say, *middles.T) > LEAST_SAY)).to(strokes.position.device)
    near, middle = strokes[rows], middles[rows.cpu().numpy()]
    own, length = (f(curve_of(near)).double().cpu().numpy() for f in (direction_of, length_of))
    first = lines.directions(middle, own)
    start, end = (_trace(lines, middle, own, way * first, length / 2) for way in (-1, 1))
    points = torch.from_numpy(np.stack([start, 2 * middle - (start + end) / 2, end], 1)).to(near.position)
    offsets = (points - near.position[:, None]) / (0.5 * near.scale)[:, None, None]
    shape = dict(zip(("start", "control", "end"), offsets.clamp(-1, 1).unbind(1), strict=True))
    return strokes.with_rows(rows, Strokes(**(dict(near.items()) | shape), brush=near.brush))


def _trace(lines: Lines, point: Array, own: Array, ahead: Array, reach: Array) -> Array:
    """Follow the lines from points (n, 2) for ``reach`` (n,) pixels, starting in directions ``ahead`` (n, 2)."""
    for _ in range(SUBSTEPS):
        point = point + ahead * (reach / SUBSTEPS)[:, None]
        turned = lines.directions(point, own)
        ahead = turned * np.where((turned * ahead).sum(1) < 0, -1, 1)[:, None]
    return point
