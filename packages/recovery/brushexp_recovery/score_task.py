"""``task=score``: anybody's strokes against the truth of a painting."""

import logging
from pathlib import Path

from omegaconf import DictConfig

from brushexp_recovery.api import score

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Score ``cfg.strokes`` against ``cfg.truth``; the figures go into metrics.json."""
    figures = score(cfg.truth, cfg.strokes)
    log.info(
        "F1 %.3f, recall %.3f, precision %.3f: %d found for %d",
        *(figures[name] for name in ("f1", "recall", "precision", "predicted", "truth")),
    )
    return figures
