"""``task=repaint``: optimise the strokes of a painting that lie in one region."""

from pathlib import Path

from omegaconf import DictConfig

from brushexp.painting.build import build_painter
from brushexp.painting.painting_module import PaintingModule
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.runs.resume import restore_run
from brushexp.tasks.paint import paint_into
from brushexp_repaint.as_painted import as_painted, fence_of, saved_job


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Repaint the region, write everything into the run's folder, and return the figures of metrics.json."""
    cfg, checkpoint = restore_run(cfg)
    settings = as_painted(cfg, saved_job(cfg))
    return paint_into(folder, settings, None if checkpoint else start, checkpoint, build=build_repainter).metrics


def build_repainter(cfg: DictConfig) -> PaintingModule:
    """Build the painter of a checked config, whose strokes stay inside the region."""
    painter, job = build_painter(cfg), saved_job(cfg)
    assert isinstance(painter, StrokeOptimizer)
    painter.picture.background.copy_(job.saved.background)
    painter.limit = fence_of(cfg, job)
    return painter
