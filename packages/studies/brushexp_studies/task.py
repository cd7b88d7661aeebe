"""``task=compare``: compare finished runs from any folders."""

import logging
from pathlib import Path

from omegaconf import DictConfig

from brushexp.contracts import UserError
from brushexp.contracts.files import as_shown
from brushexp.contracts.pages import write_sweep_page
from brushexp.contracts.results import gather, over_seeds, write_run_tables
from brushexp_studies.comparison import write_front_and_curves
from brushexp_studies.pareto import EVERY_RUN, trade_of

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Compare ``cfg.runs``; write a page, tables, fronts, curves and quality at equal time into this run's folder."""
    runs = gather([Path(path) for path in cfg.runs], folder)
    paintings = runs[runs["run", "image"].fillna("") != ""]
    if paintings.empty and trade_of(runs, cfg.cost, cfg.fronts) is not None:  # networks, for example
        paintings = runs.copy()
        paintings["run", "image"] = EVERY_RUN
    if paintings.empty or over_seeds(paintings).groupby("image").size().max() < 2:
        raise UserError(
            f"runs={','.join(cfg.runs)}: {len(paintings)} of {len(runs)} runs are finished paintings, and no two "
            "of them show one picture with different settings; add more with 'runs=[...]'"
        )
    if omitted := len(runs) - len(paintings):
        log.info("%d of %d runs are left out: not paintings, or not finished", omitted, len(runs))
    front = write_front_and_curves(folder, paintings, cfg.cost, cfg.fronts)
    write_run_tables(folder, paintings)
    write_sweep_page(folder, paintings)
    log.info("%s: %d runs compared", as_shown(front or folder), len(paintings))
    return {"runs": len(paintings)}
