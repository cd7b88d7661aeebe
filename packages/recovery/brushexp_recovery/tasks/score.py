"""``task=score``: anybody's strokes against the truth of a painting."""

import logging
from pathlib import Path

from omegaconf import DictConfig

from brushexp_recovery.benchmark.score_files import score_strokes

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Score ``cfg.strokes`` against ``cfg.truth``; the figures go into metrics.json."""
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
