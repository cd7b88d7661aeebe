"""Describe a face in a picture: its position, size and tilt, and the positions of its eyes and mouth."""

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np


class Landmark(IntEnum):
    """Rows of the landmarks of a face; right and left are from the person's point of view."""

    RIGHT_EYE = 0
    LEFT_EYE = 1
    NOSE = 2
    RIGHT_MOUTH = 3
    LEFT_MOUTH = 4


@dataclass(frozen=True)
class Face:
    """A face whose middle is at (``x``, ``y``), in pixels from the upper left corner of the picture.

    ``side`` is the square root of the area of its box in pixels, ``score`` the confidence of the detector, 0 to 1, and
    ``landmarks`` (5, 2) has x and y of each `Landmark`; it is empty, (0, 2), if only the position is known.
    """

    x: float
    y: float
    side: float
    score: float
    landmarks: np.ndarray

    @property
    def eyes(self) -> np.ndarray:
        """Centres (2, 2: x, y) of the eyes, right eye first."""
        return self.landmarks[[Landmark.RIGHT_EYE, Landmark.LEFT_EYE]]

    @property
    def mouth(self) -> np.ndarray:
        """Centre (2: x, y) of the mouth."""
        corners: np.ndarray = self.landmarks[[Landmark.RIGHT_MOUTH, Landmark.LEFT_MOUTH]]
        return corners.mean(0)

    @property
    def tilt(self) -> float:
        """Angle of the head, in radians clockwise from upright, measured from the eyes to the mouth."""
        right, down = self.mouth - self.eyes.mean(0)
        return math.atan2(-right, down)
