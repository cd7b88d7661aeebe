"""Measure the peak signal-to-noise ratio, weighted by the focus."""

from brushexp.pictures.similarity import psnr_of
from brushexp.plugins.metric.base import Comparison, Metric
from brushexp.registry import register


@register("metric", "psnr_focus")
class FocusedSignalToNoise(Metric):
    """PSNR with the squared error weighted by the focus; omitted if there is no focus."""

    title, unit, digits = "PSNR in focus", "dB", 2
    higher_is_better = True
    matters = 0.1
    needs = ("focus",)

    def __call__(self, comparison: Comparison) -> float:
        assert comparison.focus is not None
        weights = comparison.focus.cpu().double()
        squares = (comparison.image - comparison.target).double().square()
        return psnr_of(float((squares * weights / weights.mean()).mean()))
