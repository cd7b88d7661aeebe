"""Measure the structural similarity."""

from brushexp.pictures.similarity import RADIUS, dissimilarity, statistics
from brushexp.plugins.metric.base import Comparison, Metric
from brushexp.registry import register


@register("metric", "ssim")
class SimilarityOfStructure(Metric):
    """SSIM (structural similarity, Wang et al., 2004); 1 for identical pictures.

    SSIM is undefined for pictures smaller than its window of 11 x 11 pixels.
    """

    title = "SSIM"
    higher_is_better = True
    matters = 0.003

    def __call__(self, comparison: Comparison) -> float | None:
        image, target = comparison.image, comparison.target
        if min(image.shape[1:]) < 2 * RADIUS + 1:
            return None
        return 1 - float(dissimilarity(image, target, *statistics(target)).mean())
