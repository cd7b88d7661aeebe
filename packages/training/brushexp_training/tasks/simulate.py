"""``task=simulate``: simulate a set of strokes for training renderers."""

import logging
import time
from pathlib import Path
from shlex import quote

import numpy as np
import torch
from omegaconf import DictConfig

from brushexp.contracts import build
from brushexp.contracts.families import Engine
from brushexp.contracts.files import as_shown, write_picture
from brushexp_training.evaluation.evaluation import stroke_sheet
from brushexp_training.stroke_sets.dataset import StrokeSet, origin_of, pictures_of
from brushexp_training.stroke_sets.writer import simulate_set

SHEET_STROKES, SHEET_COLUMNS = 60, 10  # number of strokes on the contact sheet and in each row

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Simulate ``n`` strokes into ``path``, or continue a smaller set that is already there.

    A contact sheet, ``strokes.png``, is written into the run's folder.
    """
    path = folder / "strokes" if cfg.path is None else Path(cfg.path)
    engine: Engine = build(cfg.engine)
    before = time.monotonic()
    try:
        simulated = simulate_set(path, engine, origin_of(cfg.engine, engine), cfg.seed, cfg.n)
    except KeyboardInterrupt as interruption:
        words = f"interrupted; simulated strokes are kept; to continue, add to the command: {quote(f'path={path}')}"
        raise KeyboardInterrupt(words) from interruption
    seconds = time.monotonic() - before
    strokes = StrokeSet(path)
    pictures = pictures_of(strokes.shards, np.arange(min(SHEET_STROKES, len(strokes))))
    sheet = stroke_sheet(torch.from_numpy(pictures).permute(0, 3, 1, 2) / 255, SHEET_COLUMNS)
    write_picture(sheet_path := folder / "strokes.png", sheet)
    size = sum(shard.path.stat().st_size for shard in strokes.shards)
    amount = f"{cfg.n} strokes, {size / 1e6:.1f} MB, in {seconds:.1f} s"
    log.info("%s: %s; %s", as_shown(path), amount, as_shown(sheet_path))
    speed = simulated / seconds if simulated else None
    return {"n": cfg.n, "seconds": seconds, "strokes_per_second": speed, "bytes": size}
