"""Measure how different a painting is from its target to the eye."""

import numpy as np
from torch import Tensor

from brushexp.contracts import register
from brushexp.contracts.families import Comparison, Metric
from brushexp.contracts.pictures import to_lab


def median_difference(image: Tensor, target: Tensor) -> float:
    """Compute the median over pixels of CIEDE2000 between two pictures (3, H, W) of sRGB in [0, 1]."""
    from skimage.color import deltaE_ciede2000  # noqa: PLC0415  (slow to import)

    labs = (to_lab(picture.flatten(1).T.double().cpu().numpy()) for picture in (image, target))
    return float(np.median(deltaE_ciede2000(*labs)))


@register("metric", "ciede2000")
class ColorDifference(Metric):
    """Median over the pixels of the colour difference CIEDE2000; 1 is just noticed side by side."""

    title = "CIEDE2000"
    digits = 2
    higher_is_better = False
    matters = 0.1

    def __call__(self, comparison: Comparison) -> float | None:
        return median_difference(comparison.image, comparison.target)
