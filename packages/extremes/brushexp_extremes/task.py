"""``task=extremes``: draw and optimise extreme scenes with every renderer, blend and precision, and check each cell."""

import logging
import time
from pathlib import Path

import lightning as L
from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.system.files import write_json, write_text
from brushexp.system.progress import with_progress
from brushexp.system.runtime import peak_memory
from brushexp_extremes.check import Outcome
from brushexp_extremes.matrix import cells_in, chosen_axes, examine
from brushexp_extremes.report import draw_matrix, matrix_csv, matrix_text, outcome_counts, outcomes_in_words

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write the matrix as extremes.csv, extremes.md and extremes.png, and only then a UserError if a cell is broken."""
    L.seed_everything(cfg.seed, verbose=False)
    axes = chosen_axes(renderers=cfg.renderers, blends=cfg.blends, dtypes=cfg.dtypes, scenes=cfg.scenes)
    cells = list(with_progress(examine(axes, cfg.patience), cells_in(axes), "examining cells"))
    write_text(folder / "extremes.csv", matrix_csv(cells))
    write_text(folder / "extremes.md", matrix_text(cells))
    draw_matrix(cells, folder / "extremes.png")
    metrics: dict[str, object] = {
        **outcome_counts(cells),
        "seconds_total": time.monotonic() - start,
        "peak_memory_mb": peak_memory(),
        "picture": "extremes.png",
        "status": "completed",
    }
    write_json(folder / "metrics.json", metrics)
    log.info("%s; %s", outcomes_in_words(cells), folder)
    broken = [cell for cell in cells if cell.check.outcome is Outcome.broken]
    if broken:
        first = broken[0]
        raise UserError(
            f"{len(broken)} of {len(cells)} cells are broken, the first is {first.scene} ({first.kind}, renderer="
            f"{first.renderer}, blend={first.blend}, {first.dtype}): {first.check.note}; see {folder / 'extremes.md'}"
        )
    return metrics
