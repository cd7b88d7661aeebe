"""Measure a finished painting with the chosen metrics."""

import logging
import math
from collections.abc import Mapping

import numpy as np
import torch
from omegaconf import DictConfig
from torch import Tensor

from brushexp.plugins.export.base import ExportJob
from brushexp.plugins.metric.base import STANDARD, Comparison, Metric
from brushexp.registry import build_named, take_built
from brushexp.registry.blame import name_member
from brushexp.strokes.catalogue import Strokes

log = logging.getLogger(__name__)


def metrics_of(cfg: DictConfig) -> dict[str, Metric]:
    """Build the chosen metrics and return them by name; PSNR is always included."""
    chosen = {name: take_built(node) for name, node in cfg.metric.items()}
    return {"psnr": build_named("metric", "psnr", {})} | chosen


def standard_metrics() -> dict[str, Metric]:
    """Build the default metrics."""
    return {name: build_named("metric", name, {}) for name in STANDARD}


def kept_files(metrics: Mapping[str, Metric]) -> dict[str, bytes]:
    """Return the files that metrics have created, by file name."""
    return {name: data for metric in metrics.values() for name, data in metric.files.items()}


@torch.no_grad()
def measure(
    metrics: Mapping[str, Metric], picture: np.ndarray, target: np.ndarray,
    *, focus: Tensor | None = None, strokes: Strokes | None = None, job: ExportJob | None = None,
) -> dict[str, float | str | None]:  # fmt: skip
    """Compare two 8-bit RGB pictures (H, W, 3); return the metrics by name, as written to metrics.json.

    ``job`` is the export job that draws the first picture, without light or paper.

    Logs a warning for metrics that are NaN.
    """
    image, goal = (torch.from_numpy(one).permute(2, 0, 1).to(torch.float32) / 255 for one in (picture, target))
    comparison = Comparison(image, goal, focus, strokes, job)
    numbers: dict[str, float | str | None] = {}
    for name, metric in metrics.items():
        if all(getattr(comparison, field) is not None for field in metric.needs):
            value = metric(comparison)
            if value is not None and math.isnan(value):
                who = name_member("metric", metric, name)
                log.warning("%s is not a number (NaN) for this painting; metrics.json has null", who)
            numbers |= {metric.label or name: value, **metric.remarks}
    return numbers
