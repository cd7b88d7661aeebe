"""``task=simulate``: make a set of simulated strokes to train renderers on."""

from __future__ import annotations

import logging
import shlex
import time
from pathlib import Path

import numpy as np
import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.plugins.engine.base import Engine
from brushexp.registry import build
from brushexp.system.files import write_picture
from brushexp.training.dataset import StrokeSet, origin_of
from brushexp.training.sheets import stroke_sheet
from brushexp.training.writer import StrokeWriter

SHOWN_STROKES, SHOWN_COLUMNS = 60, 10  # on the contact sheet, and in a row of it

log = logging.getLogger(__name__)


def run(cfg: DictConfig, start: float) -> dict[str, object]:
    """Write ``n`` strokes to ``path`` and ``strokes.png`` into the run's folder; continue what is there already."""
    folder = Path(HydraConfig.get().runtime.output_dir)
    path = folder / "strokes" if cfg.path is None else Path(cfg.path)
    engine: Engine = build(cfg.engine)
    before = time.monotonic()
    with StrokeWriter(path, origin_of(cfg.engine, engine), cfg.seed, cfg.n) as writer:
        todo = cfg.n - writer.done
        if writer.done:
            log.info("%d of %d strokes are there already%s", writer.done, cfg.n, "; going on" if todo else "")
        try:
            writer.simulate(engine)
        except (UserError, KeyboardInterrupt):
            log.warning("%d of %d strokes are kept; continue with: %s", writer.done, cfg.n, command(path))
            raise
    seconds = time.monotonic() - before
    strokes = StrokeSet(path)
    pictures = strokes.pictures(np.arange(min(SHOWN_STROKES, len(strokes))))
    sheet = stroke_sheet(torch.from_numpy(pictures).permute(0, 3, 1, 2) / 255, SHOWN_COLUMNS)
    write_picture(folder / "strokes.png", sheet)
    size = sum(shard.path.stat().st_size for shard in strokes.shards)
    log.info("%s: %d strokes, %.1f MB, in %.1f s; %s", path, cfg.n, size / 1e6, seconds, folder / "strokes.png")
    return {
        "n": cfg.n,
        "seconds": seconds,
        "seconds_total": time.monotonic() - start,
        "strokes_per_second": todo / seconds if todo else None,
        "bytes": size,
        "status": "completed",
    }


def command(path: Path) -> str:
    """What to type to continue."""
    kept = [text for text in HydraConfig.get().overrides.task if text.partition("=")[0] not in ("path", "output")]
    return shlex.join(["python", "run.py", *kept, f"path={path}"])
