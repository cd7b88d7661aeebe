"""``task=compare``: put finished runs beside each other, from wherever they are."""

from __future__ import annotations

import logging
import time
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.results.anytime import write_anytime
from brushexp.results.curves import write_curves
from brushexp.results.page.sweep_page import write_sweep_page
from brushexp.results.pareto import write_front
from brushexp.results.runs import gather, paintings
from brushexp.results.table import write_table

log = logging.getLogger(__name__)


def run(cfg: DictConfig, start: float) -> dict[str, object]:
    """Write page, table, front, curves and quality at equal time of the runs in ``cfg.runs`` into this run's folder."""
    folder = Path(HydraConfig.get().runtime.output_dir).resolve()
    found = gather([Path(path) for path in cfg.runs], folder)
    results = paintings(found)
    written = write_front(folder, results) if results else None
    if written is None:
        raise UserError(
            f"runs={','.join(cfg.runs)}: {len(results)} of {len(found)} runs are finished paintings, and no two of "
            "them are of one picture with different settings; add more with 'runs=[...]'"
        )
    if len(results) < len(found):
        log.info("%d of %d runs are left out: no paintings, or not finished", len(found) - len(results), len(found))
    write_table(folder, results)
    write_anytime(folder, results)
    write_curves(folder, results)
    write_sweep_page(folder, results)
    log.info("%s: %d runs compared", written[0], len(results))
    return {"runs": len(results), "seconds_total": time.monotonic() - start, "status": "completed"}
