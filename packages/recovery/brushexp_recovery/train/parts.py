"""Crop parts of held-out paintings, to which classifiers are fitted."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.model.unet import TRAINED_WIDTH
from brushexp_recovery.synthesis.ageing import weather
from brushexp_recovery.synthesis.hand import Random
from brushexp_recovery.synthesis.paintings import KnownPainting
from brushexp_recovery.train.crops import ZOOMS, typical_width

Array = NDArray[Any]

PART_SIDE = 640  # side in pixels after zooming
ZOOM_SPREAD = 0.15  # spread of the logarithm of scales


class PaintingPart(NamedTuple):
    """A part of a painting, and the scale that suits its strokes."""

    image: Array  # (H, W, 3) float32 in [0, 1]
    labels: Array  # (H, W) visible stroke, or -1 for the ground
    zoom: float  # scale at which its strokes are about as wide as in training


def cut_part(painting: KnownPainting, is_weathered: bool, random: Random) -> PaintingPart:
    """Crop a square part of a painting whose side is at most `PART_SIDE` pixels after zooming."""
    zoom = TRAINED_WIDTH / typical_width(painting) * np.exp(random.normal(0, ZOOM_SPREAD))
    zoom = float(np.clip(zoom, *ZOOMS))
    height, width = painting.labels.shape
    side = min(round(PART_SIDE / zoom), height, width)
    top, left = int(random.integers(height - side + 1)), int(random.integers(width - side + 1))
    place = slice(top, top + side), slice(left, left + side)
    image = painting.image[place].astype(np.float32) / 255
    image = weather(image, random).astype(np.float32) if is_weathered else image
    return PaintingPart(image, painting.labels[place].astype(int), zoom)
