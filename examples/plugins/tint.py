"""Metric plugin in a single file: ``'metric=[psnr,ssim,tint]'``."""

from brushexp.contracts import register
from brushexp.contracts.families import Comparison, Metric


@register("metric", "tint")
class Tint(Metric):
    """Difference between the mean colours of the painting and its target, as a measure of colour cast, 0 to 1."""

    title = "tint"
    higher_is_better = False
    matters = 0.002  # differences of less are none to speak of

    def __call__(self, comparison: Comparison) -> float:
        return float((comparison.image - comparison.target).mean((1, 2)).abs().max())
