"""Alter a photograph slightly: rescale it, rotate it, recompress it, and make it darker or lighter."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.raster.jpeg import compress_as_jpeg

Array = NDArray[Any]

ZOOMS = (0.8, 1.25)  # smallest and largest zoom
TURN = 2.0  # maximum rotation in degrees to each side
QUALITY = (70, 95)  # range of JPEG quality
TONE = 0.04  # maximum change of brightness and contrast
ZOOM_STEP, TURN_STEP = 0.7549, 0.5698  # steps that spread any number of points evenly over a square (Roberts, 2018)


@dataclass(frozen=True)
class View:
    """A transformation of a photograph; by default, the identity."""

    zoom: float = 1.0
    turn: float = 0.0  # clockwise rotation in degrees
    quality: int | None = None  # JPEG quality; None = not recompressed
    gain: float = 1.0
    lift: float = 0.0

    def matrix(self, size: tuple[int, int]) -> Array:
        """Return the matrix (2, 3) that rotates and scales points x, y of a photograph (H, W) to points of the view."""
        angle = math.radians(self.turn)
        cosine, sine = math.cos(angle), math.sin(angle)
        rotation = self.zoom * np.array([[cosine, -sine], [sine, cosine]])
        middle = 0.5 * np.array(size[::-1])
        return np.column_stack([rotation, self.zoom * middle - rotation @ middle])

    def size(self, size: tuple[int, int]) -> tuple[int, int]:
        """Return the height and width of the view of a photograph with the given height and width."""
        return max(round(self.zoom * size[0]), 1), max(round(self.zoom * size[1]), 1)

    def of(self, image: Array) -> Array:
        """Apply the transformation to a photograph (H, W, 3) in [0, 1]."""
        if self == View():
            return image
        sigma = 0.5 * max(1 / self.zoom - 1, 0)
        warped = self.warp(gaussian_blur(image, (sigma, sigma, 0)), order=1)
        changed = np.clip(self.gain * warped + self.lift, 0, 1)
        return changed if self.quality is None else compress_as_jpeg(changed, self.quality)

    def warp(self, image: Array, order: int) -> Array:
        """Rotate and scale a picture (H, W) or (H, W, 3), which is continued beyond its edges by reflection."""
        from skimage.transform import warp  # noqa: PLC0415  (slow to import)

        full = np.vstack([self.matrix(image.shape[:2]), [0, 0, 1]])
        centre = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # centres lie at halves here, at integers in SciPy
        back = np.linalg.inv(centre) @ np.linalg.inv(full) @ centre
        shape = self.size(image.shape[:2])
        warped: Array = warp(image, back, output_shape=shape, order=order, mode="reflect", preserve_range=True)
        return warped

    def back(self, curve: Array, size: tuple[int, int]) -> Array:
        """Map points (..., 2) of the view to points of the photograph (H, W)."""
        rotation, offset = np.split(self.matrix(size), [2], axis=1)
        places: Array = (curve - offset[:, 0]) @ np.linalg.inv(rotation).T
        return places


def choose_views(count: int, seed: int) -> list[View]:
    """Choose ``count`` views that depend only on the seed; the first is the unchanged photograph.

    The scales and rotations of the other views are spread evenly over their ranges; JPEG qualities and tones are
    random.
    """
    random = np.random.default_rng(seed)
    low, high = np.log(ZOOMS)
    views = [View()]
    for number in range(1, count):
        zoom, turn = (number * ZOOM_STEP) % 1, (number * TURN_STEP) % 1
        view = View(
            zoom=float(np.exp(low + zoom * (high - low))),
            turn=TURN * (2 * turn - 1),
            quality=int(random.integers(*QUALITY)),
            gain=float(1 + random.uniform(-TONE, TONE)),
            lift=float(random.uniform(-TONE, TONE)),
        )
        views.append(view)
    return views
