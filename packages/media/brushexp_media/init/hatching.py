"""Draw hatching: short parallel lines that turn to follow the forms in a picture."""

import math

import numpy as np

from brushexp.contracts.pictures import along_edges, sample_at, structure_tensor
from brushexp_media.picture.lines import follow_flow

Array = np.ndarray
ANGLES = (-0.9, -0.7, -0.4)  # angles of hatching in radians, starting with that of the half tones
BEGIN = 0.0, 0.3, 0.15, 0.45  # depths from which four successive rows are drawn
FORM, TURN = 0.02, 0.4  # standard deviation of the blur of forms in longer sides; turn of hatching with forms, radians
WEAK = 0.5  # strength of a form, relative to the mean, below which hatchings follow it less
UNEVEN = 0.05  # standard deviation of these depths
EVEN = 0.02  # margin of darkness that still counts as dark, so that even areas are not omitted
LONGER = 0.45  # standard deviation of the logarithm of the length of hatching lines


def forms(picture: Array) -> Array:
    """Compute the angle (H, W), in radians and at most `TURN`, by which hatching turns to follow a picture's forms."""
    tensor = structure_tensor(picture, FORM * max(picture.shape))
    angle = (along_edges(tensor) - ANGLES[0] + math.pi / 2) % math.pi - math.pi / 2
    strength = tensor[0] + tensor[2]
    turned: Array = angle.clip(-TURN, TURN) * (strength / max(WEAK * strength.mean(), np.finfo(float).tiny)).clip(0, 1)
    return turned


def rows_drawn(dark: Array, tone: float) -> float:
    """Compute the area in pixels where ``dark`` (H, W) exceeds ``tone``, weighted by the share of rows drawn there."""
    deeper = _depth(dark[dark > tone], tone)
    return float(np.mean([(deeper > begin).sum() for begin in BEGIN]))


def hatching(
    dark: Array, tone: float, angle: float, turned: Array, gap: float, length: float, random: np.random.Generator
) -> Array:
    """Draw curves (n, 3, 2) where ``dark`` (H, W) exceeds ``tone``: every fourth row at first, all rows in the darkest.

    Rows are ``gap`` pixels apart. Their direction is ``angle`` plus ``turned`` (H, W), in radians.
    """
    height, width = dark.shape
    half = 0.5 * math.hypot(height, width)
    u, v = np.meshgrid(np.arange(-half, half, 0.8 * length), np.arange(-half, half, gap))
    begin = np.resize(BEGIN, len(v))[:, None] + UNEVEN * random.standard_normal(u.shape)
    u = u + length * (random.uniform(-0.5, 0.5, len(v))[:, None] + 0.15 * random.standard_normal(u.shape))
    v = v + 0.4 * gap * random.standard_normal(v.shape)
    c, s = math.cos(angle), math.sin(angle)
    places = np.stack([width / 2 + c * u - s * v, height / 2 + s * u + c * v], -1).reshape(-1, 2)
    inner = ((places >= 0) & (places < (width, height))).all(1)
    places, begin = places[inner], begin.reshape(-1)[inner]
    places = places[_depth(sample_at(dark, *places.T), tone) > begin.clip(0)]
    reach = 0.5 * length * random.lognormal(-0.4, LONGER, len(places))
    return follow_flow(places, angle + turned, reach, dark, tone)


def _depth(dark: Array, tone: float) -> Array:
    """Compute how far darkness exceeds ``tone``, on a scale from 0 at ``tone`` to 1 at black."""
    depth: Array = (dark - tone) / max(1 - tone, EVEN)
    return depth
