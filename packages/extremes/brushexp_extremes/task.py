"""``task=extremes``: draw and optimise extreme scenes with every renderer, blend and precision, and check each cell."""

import logging
import time
from pathlib import Path

import lightning as L
from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.reporting.tables import csv_table
from brushexp.system.files import write_json, write_text
from brushexp.system.progress import with_progress
from brushexp.system.runtime import peak_memory
from brushexp_extremes.check import BROKEN
from brushexp_extremes.matrix import cells_in, chosen_axes, counts_of, draw_matrix, examine

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write the matrix as extremes.csv and extremes.png, and only then a UserError if a cell is broken."""
    L.seed_everything(cfg.seed, verbose=False)
    axes = chosen_axes(renderers=cfg.renderers, blends=cfg.blends, dtypes=cfg.dtypes, scenes=cfg.scenes)
    cells = list(with_progress(examine(axes, cfg.patience), cells_in(axes), "examining cells"))
    write_text(folder / "extremes.csv", csv_table(cells, significant=3))
    draw_matrix(cells, folder / "extremes.png")
    counts = counts_of(cells)
    metrics: dict[str, object] = {
        **{f"n_{verdict}": count for verdict, count in counts.items()},
        "seconds_total": time.monotonic() - start,
        "peak_memory_mb": peak_memory(),
        "picture": "extremes.png",
        "status": "completed",
    }
    write_json(folder / "metrics.json", metrics)
    log.info("%s; %s", ", ".join(f"{count} {verdict}" for verdict, count in counts.items()), folder)
    broken = [cell for cell in cells if cell["verdict"] == BROKEN]
    if broken:
        first = "{scene} ({kind}, renderer={renderer}, blend={blend}, {dtype}): {note}".format(**broken[0])
        raise UserError(
            f"{len(broken)} of {len(cells)} cells are broken, the first is {first}; see {folder / 'extremes.csv'}"
        )
    return metrics
