"""A photograph as it might have been taken too: a little larger or smaller, turned, recompressed, darker or lighter."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.raster.jpeg import compress_as_jpeg

Array = NDArray[Any]

ZOOMS = (0.8, 1.25)  # smallest and largest
TURN = 2.0  # degrees to either side
QUALITY = (70, 95)  # of JPEG
TONE = 0.04  # by which brightness and contrast change at most


@dataclass(frozen=True)
class View:
    """A change of a photograph; the first of `views_of` changes nothing."""

    zoom: float = 1.0
    turn: float = 0.0  # degrees, clockwise as it is seen
    quality: int | None = None  # of JPEG; None as it is
    gain: float = 1.0
    lift: float = 0.0

    def matrix(self, size: tuple[int, int]) -> Array:
        """Return the map (2, 3) of places x, y of a photograph (H, W) to those of the view, about its middle."""
        angle = math.radians(self.turn)
        turned = self.zoom * np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        middle = 0.5 * np.array(size[::-1])
        return np.column_stack([turned, self.zoom * middle - turned @ middle])

    def size(self, size: tuple[int, int]) -> tuple[int, int]:
        """Return height and width of the view of a photograph (H, W)."""
        return max(round(self.zoom * size[0]), 1), max(round(self.zoom * size[1]), 1)

    def of(self, image: Array) -> Array:
        """Change a photograph (H, W, 3) in [0, 1]."""
        if self == View():
            return image
        moved = self.moved(gaussian_blur(image, (blur := 0.5 * max(1 / self.zoom - 1, 0), blur, 0)), order=1)
        changed = np.clip(self.gain * moved + self.lift, 0, 1)
        return changed if self.quality is None else compress_as_jpeg(changed, self.quality)

    def moved(self, image: Array, order: int) -> Array:
        """Turn and enlarge a picture (H, W) or (H, W, 3); what lies beyond its edges mirrors it."""
        from skimage.transform import warp  # noqa: PLC0415  (slow to import)

        full = np.vstack([self.matrix(image.shape[:2]), [0, 0, 1]])
        centre = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # pixel centres lie at halves here, at wholes there
        back = np.linalg.inv(centre) @ np.linalg.inv(full) @ centre
        shape = self.size(image.shape[:2])
        moved: Array = warp(image, back, output_shape=shape, order=order, mode="reflect", preserve_range=True)
        return moved

    def back(self, curve: Array, size: tuple[int, int]) -> Array:
        """Map places (..., 2) of the view to those of the photograph (H, W)."""
        matrix = self.matrix(size)
        places: Array = (curve - matrix[:, 2]) @ np.linalg.inv(matrix[:, :2]).T
        return places


def views_of(count: int, seed: int) -> list[View]:
    """Choose ``count`` views, the same for the same seed: the photograph as it is, then others.

    Their scales and turns are spread evenly over all between the limits; qualities and tones are drawn.
    """
    random = np.random.default_rng(seed)
    low, high = np.log(ZOOMS)
    views = [View()]
    for number in range(1, count):
        scale, turn = (number * 0.7549) % 1, (number * 0.5698) % 1  # any number is evenly spread (Roberts, 2018)
        views.append(View(
            float(np.exp(low + scale * (high - low))), TURN * (2 * turn - 1),
            int(random.integers(*QUALITY)), float(1 + random.uniform(-TONE, TONE)), float(random.uniform(-TONE, TONE)),
        ))  # fmt: skip
    return views
