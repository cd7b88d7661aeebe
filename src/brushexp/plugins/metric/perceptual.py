"""Measure the distance between pictures in the feature space of the bundled network."""

from brushexp.features.distance import perceptual_distance
from brushexp.plugins.metric.base import Comparison, Metric
from brushexp.registry import register


@register("metric", "perceptual")
class PerceptualDistance(Metric):
    """Perceptual distance in the feature space of a small bundled network; 0 for identical pictures."""

    title = "perceptual distance"
    higher_is_better = False
    matters = 0.005
    remarks = {"perceptual_backbone": "effl0"}  # noqa: RUF012

    def __call__(self, comparison: Comparison) -> float:
        return perceptual_distance(comparison.image, comparison.target)
