"""Measure the peak signal-to-noise ratio."""

from brushexp.pictures.similarity import psnr_of
from brushexp.plugins.metric.base import Comparison, Metric
from brushexp.registry import register


@register("metric", "psnr")
class PeakSignalToNoise(Metric):
    """PSNR (peak signal-to-noise ratio) over all pixels of the 8-bit pictures; infinite for identical pictures."""

    title, unit, digits = "PSNR", "dB", 2
    higher_is_better = True
    matters = 0.1

    def __call__(self, comparison: Comparison) -> float:
        return psnr_of(float((comparison.image - comparison.target).double().square().mean()))
