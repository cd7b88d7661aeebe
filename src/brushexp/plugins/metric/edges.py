"""Measure how well edges are preserved."""

import torch

from brushexp.plugins.metric.base import Comparison, Metric
from brushexp.registry import register


@register("metric", "edges")
class EdgeError(Metric):
    """Mean absolute error (L1) of the differences between neighbouring pixels; it is small if edges are preserved.

    It is undefined for a picture that consists of a single pixel.
    """

    title = "error of edges"
    higher_is_better = False
    matters = 0.0005

    def __call__(self, comparison: Comparison) -> float | None:
        difference = comparison.image - comparison.target
        slopes = [difference.diff(dim=axis).abs().flatten() for axis in (1, 2)]
        return float(torch.cat(slopes).mean()) if any(map(len, slopes)) else None
