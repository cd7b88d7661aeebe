"""Measure the mean absolute difference."""

from brushexp.plugins.metric.base import Comparison, Metric
from brushexp.registry import register


@register("metric", "l1")
class AbsoluteDifference(Metric):
    """Mean absolute difference over pixels and channels (L1), 0 to 1."""

    title = "L1"
    higher_is_better = False
    matters = 0.0005

    def __call__(self, comparison: Comparison) -> float:
        return float((comparison.image - comparison.target).abs().mean())
