"""Measure the perceptual colour difference between a painting and its target."""

import numpy as np
from torch import Tensor

from brushexp.contracts import register
from brushexp.contracts.families import Comparison, Metric
from brushexp.contracts.pictures import to_lab


def median_difference(image: Tensor, target: Tensor) -> float:
    """Compute the median CIEDE2000 difference between the pixels of two sRGB pictures (3, H, W) in [0, 1]."""
    from skimage.color import deltaE_ciede2000  # noqa: PLC0415  (slow to import)

    labs = (to_lab(picture.flatten(1).T.double().cpu().numpy()) for picture in (image, target))
    return float(np.median(deltaE_ciede2000(*labs)))


@register("metric", "ciede2000")
class ColorDifference(Metric):
    """Median CIEDE2000 colour difference over the pixels; a difference of 1 is just noticeable side by side."""

    title = "CIEDE2000"
    digits = 2
    higher_is_better = False
    matters = 0.1

    def __call__(self, comparison: Comparison) -> float | None:
        return median_difference(comparison.image, comparison.target)
