"""``task=tubes``: optimise strokes under what a table has."""

from dataclasses import replace
from pathlib import Path

import torch
from omegaconf import DictConfig
from torch import Tensor

from brushexp.painting.build import build_painter, target_of
from brushexp.painting.painting_module import PaintingModule
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.runs.resume import restore_run
from brushexp.tasks.paint import paint_picture
from brushexp_tubes.constraint import Constraint
from brushexp_tubes.mixtures import Mixtures, all_mixtures, choose_mixtures, within_tones
from brushexp_tubes.paints import load_tubes
from brushexp_tubes.table import StageOrder, Table


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Paint, write everything into the run's folder, and return the figures of metrics.json."""
    cfg, checkpoint = restore_run(cfg)
    begun = None if checkpoint else start
    return paint_picture(cfg, folder, begun, checkpoint, build=build_constrained).metrics


@torch.no_grad()
def build_constrained(cfg: DictConfig) -> PaintingModule:
    """Build the painter of a checked config, whose strokes stay within what the table has."""
    picture, candidates = target_of(cfg), all_mixtures(load_tubes(cfg.tubes))
    target = within_tones(picture, candidates)
    table = table_for(cfg, target, candidates)
    painter = build_painter(cfg, target)
    assert isinstance(painter, StrokeOptimizer)
    painter.limit = Constraint(painter, table)
    order = StageOrder(table)
    painter.components, painter.depth.order = replace(painter.components, order=order), order
    painter.catalogue.replace(table.dealt(painter.catalogue()))
    painter.depth.renew(painter.strokes())
    return painter


def table_for(cfg: DictConfig, target: Tensor, candidates: Mixtures) -> Table:
    """Choose the mixtures for a target (3, H, W), and scale the brushes to it."""
    return table_with(cfg, choose_mixtures(candidates, target, cfg.mixtures), target.shape[2])


def table_with(cfg: DictConfig, mixtures: Mixtures, width: int) -> Table:
    """Make a table with mixtures, and the brushes of a config scaled to a picture so many pixels wide."""
    brushes = torch.tensor(sorted(set(cfg.brushes), reverse=True)) * width / (10 * cfg.width_cm)
    return Table(mixtures, brushes, cfg.load)
