"""Describe a face in a picture: its position, size and tilt, and the positions of its eyes and mouth."""

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np


class Landmark(IntEnum):
    """Row indices of a face's landmarks; right and left are from the person's point of view."""

    RIGHT_EYE = 0
    LEFT_EYE = 1
    NOSE = 2
    RIGHT_MOUTH = 3
    LEFT_MOUTH = 4


@dataclass(frozen=True)
class Face:
    """A face centred at (``x``, ``y``), in pixels from the upper left corner of the picture.

    ``side`` is the square root of the bounding box's area, in pixels, ``score`` is the detector's confidence, 0 to 1,
    and ``landmarks`` (5, 2) holds the x and y coordinates of each `Landmark`. If the landmarks are unknown, this array
    is empty, (0, 2).
    """

    x: float
    y: float
    side: float
    score: float
    landmarks: np.ndarray

    @property
    def eyes(self) -> np.ndarray:
        """Centres (2, 2: x, y) of the two eyes, right eye first."""
        return self.landmarks[[Landmark.RIGHT_EYE, Landmark.LEFT_EYE]]

    @property
    def mouth(self) -> np.ndarray:
        """Centre (2: x, y) of the mouth."""
        corners: np.ndarray = self.landmarks[[Landmark.RIGHT_MOUTH, Landmark.LEFT_MOUTH]]
        return corners.mean(0)

    @property
    def tilt(self) -> float:
        """Tilt of the head, in radians clockwise from upright, derived from the positions of the eyes and the mouth."""
        right, down = self.mouth - self.eyes.mean(0)
        return math.atan2(-right, down)
