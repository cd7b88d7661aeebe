"""``task=guided``: paint with first strokes that follow lines."""

from pathlib import Path

import torch
from omegaconf import DictConfig

from brushexp.painting.build import build_painter
from brushexp.painting.painting_module import PaintingModule
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.runs.resume import restore_run
from brushexp.tasks.paint import paint_into
from brushexp_guides.lines import follow, load_lines


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Paint, write everything into the run's folder, and return the figures of metrics.json."""
    cfg, checkpoint = restore_run(cfg)
    return paint_into(folder, cfg, None if checkpoint else start, checkpoint, build=build_guided).metrics


@torch.no_grad()
def build_guided(cfg: DictConfig) -> PaintingModule:
    """Build the painter of a checked config, whose first strokes follow the lines of ``guides``."""
    painter = build_painter(cfg)
    assert isinstance(painter, StrokeOptimizer)
    turned = follow(painter.strokes(), load_lines(cfg.guides, painter.picture.size))
    painter.catalogue.replace(painter.renderer.convert(turned))
    painter.depth.renew(painter.strokes())
    return painter
