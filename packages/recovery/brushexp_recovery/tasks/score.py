"""``task=score``: score strokes from any method against a painting's ground truth, or against marks drawn by people."""

import logging
from pathlib import Path

from omegaconf import DictConfig

from brushexp.contracts.files import find_path
from brushexp_recovery.benchmark.score_files import score_strokes
from brushexp_recovery.marks.marks_file import is_marks
from brushexp_recovery.tasks.score_marks import score_all_marks

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Score ``cfg.strokes`` against ``cfg.truth``, and return the scores for metrics.json."""
    truth = find_path(cfg.truth)
    if truth.is_dir() or is_marks(truth):
        return score_all_marks(truth, find_path(cfg.strokes), folder, cfg.seed)
    figures = score_strokes(cfg.truth, cfg.strokes)
    log.info(
        "F1 %.3f, recall %.3f, precision %.3f: %d found for %d",
        figures["f1"],
        figures["recall"],
        figures["precision"],
        figures["predicted"],
        figures["truth"],
    )
    return figures
