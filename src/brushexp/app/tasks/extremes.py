"""``task=extremes``: draw and optimise extreme scenes with every renderer, blend and precision, and judge each cell."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from pathlib import Path

import lightning as L
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig
from rich.console import Console
from rich.progress import track

from brushexp.errors import UserError
from brushexp.stress.matrix import Cell, Choice, choice_of, count, examine
from brushexp.stress.report import as_csv, as_markdown, counts, draw
from brushexp.stress.verdict import Verdict
from brushexp.system.files import write_json, write_text
from brushexp.system.process import peak_memory

NOTICES = 10  # lines in the log of a run, where there is no terminal for a bar
NAMED = 5  # broken cells that the last message names

log = logging.getLogger(__name__)


def run(cfg: DictConfig, start: float) -> dict[str, object]:
    """Write the matrix as extremes.csv, extremes.md and extremes.png, and count the verdicts.

    Raises:
        UserError: if a cell is broken; the files are there all the same.
    """
    folder = Path(HydraConfig.get().runtime.output_dir)
    L.seed_everything(cfg.seed, verbose=False)
    choice = choice_of(cfg.renderers, cfg.blends, cfg.dtypes, cfg.scenes)
    cells = list(shown(choice, cfg.patience))
    write_text(folder / "extremes.csv", as_csv(cells))
    write_text(folder / "extremes.md", as_markdown(cells))
    draw(cells, folder / "extremes.png")
    metrics: dict[str, object] = {
        **counts(cells),
        "seconds_total": time.monotonic() - start,
        "peak_memory_mb": peak_memory(),
        "picture": "extremes.png",
        "status": "completed",
    }
    write_json(folder / "metrics.json", metrics)
    log.info("%s; %s", ", ".join(f"{n} {name.removeprefix('n_')}" for name, n in counts(cells).items()), folder)
    broken = [cell for cell in cells if cell.judgement.verdict is Verdict.broken]
    if broken:
        names = "; ".join(f"{cell.name}: {cell.judgement.note}" for cell in broken[:NAMED])
        raise UserError(
            f"{len(broken)} of {len(cells)} cells are broken: {names}; all of them are in {folder / 'extremes.md'}"
        )
    return metrics


def shown(choice: Choice, patience: float) -> Iterator[Cell]:
    """The cells, with a bar where there is a terminal, and some lines in the log where there is none."""
    console, total = Console(stderr=True), count(choice)
    cells = track(
        examine(choice, patience), "examining", total, console=console, transient=True, disable=not console.is_terminal
    )
    for done, cell in enumerate(cells, 1):
        if not console.is_terminal and done * NOTICES // total > (done - 1) * NOTICES // total:
            log.info("%d of %d cells; the last one: %s", done, total, cell.name)
        yield cell
