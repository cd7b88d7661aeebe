"""``task=calibrate``: how often the intervals of samples hold the truth, and what makes them hold it in 90 %."""

import logging
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import DictConfig

from brushexp.reporting.tables import csv_table, markdown_table
from brushexp.strokes.catalogue import Strokes
from brushexp.system.files import write_text
from brushexp.system.progress import showing
from brushexp_predictor.conformal import write_scalings
from brushexp_predictor.coverage import KINDS, Report, coverage_of, examine, fit, join, scaled
from brushexp_predictor.doubts import SHARE
from brushexp_predictor.known import PICTURES, known_painting
from brushexp_predictor.model import PREDICTORS, load_predictor
from brushexp_predictor.network import StrokePredictor
from brushexp_predictor.restarts import restart
from brushexp_predictor.sampling import Sample, paint_samples

NEAR = 1.0  # dB

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write the intervals, and tables of what they hold before and after, into the run's folder."""
    weights = PREDICTORS.path_of(cfg.checkpoint)
    network = load_predictor(cfg.checkpoint)
    of_samples, of_restarts, spreads = [], [], []
    with showing("sampling known paintings") as show:
        for number in range(cfg.paintings):
            show(number / cfg.paintings, f"painting {number + 1} of {cfg.paintings}")
            one, other, spread = _examine(cfg, network, number)
            of_samples.append(one)
            of_restarts.append(other)
            spreads.append(spread)
    rows = _compare(of_samples, "samples")
    if cfg.restarts:
        rows += _compare([one for one in of_restarts if one is not None], "restarts")
    about = {
        "hash": PREDICTORS.read_recipe(weights)["hash"], "temperature": cfg.temperature, "samples": cfg.samples,
        "share": SHARE, "paintings": cfg.paintings, "side": cfg.side, "seed": cfg.seed,
    }  # fmt: skip
    name = weights.with_suffix(".intervals.json").name
    for path in (folder, *([weights.parent] if cfg.keep else [])):
        write_scalings(path / name, fit(join(of_samples)), about)
    write_text(folder / "coverage.csv", csv_table(rows, significant=4))
    text = markdown_table([{key: _short(value) for key, value in row.items()} for row in rows], align="lllrrrrrrl")
    write_text(folder / "coverage.md", text + "\n")
    log.info("%s: %s, coverage.csv, coverage.md", folder, name)
    return {
        **{f"coverage_{row['of']}_{row['measure']}": row["scaled"] for row in rows if row["by"] == "samples"},
        "psnr_spread": float(np.mean(spreads)),
        "psnr_within_1_db": float(np.mean(np.array(spreads) <= NEAR)),
        "seconds_total": time.monotonic() - start,
    }


def _examine(cfg: DictConfig, network: StrokePredictor, number: int) -> tuple[Report, Report | None, float]:
    """Sample one painting; what was found, the same of restarts, and by how many dB its samples differ."""
    known = known_painting(cfg.seed, number, cfg.side)
    begin = time.process_time()
    samples = list(paint_samples(network, known.picture, known.told, cfg.samples, number, cfg.temperature))
    seconds = time.process_time() - begin
    psnr = [sample.psnr for sample in samples]
    restarts = list(restart(known.picture, known.told, seconds, number)) if cfg.restarts else []
    others = examine(known, number, strokes_of(restarts)) if restarts else None
    return examine(known, number, strokes_of(samples)), others, max(psnr) - min(psnr)


def strokes_of(samples: Sequence[Sample]) -> list[Strokes]:
    """Return the strokes of samples."""
    return [sample.strokes for sample in samples]


def _compare(reports: Sequence[Report], by: str) -> list[dict[str, Any]]:
    """Tell how many truths intervals hold, before and after they are fitted to other pictures: a row a measure."""
    test, after, rows = join(reports), join(left_out(reports)), []
    for of, kinds in KINDS.items():
        for name, kind in kinds.items():
            plain, fit_ = (coverage_of(report[of][name], kind) for report in (test, after))
            unit = "factor" if kind.is_factor else kind.unit
            rows.append({
                "by": by, "of": of, "measure": name, "known": plain.known, "plain": plain.share, "width": plain.width,
                "scaled": fit_.share, "error": fit_.error, "scaled width": fit_.width, "unit": unit,
            })  # fmt: skip
    return rows


def left_out(reports: Sequence[Report]) -> list[Report]:
    """Scale the intervals of each picture's paintings, which come in turn, by what those of all others say."""
    apart = []
    for picture in range(min(len(PICTURES), len(reports))):
        own = reports[picture :: len(PICTURES)]
        others = [report for number, report in enumerate(reports) if number % len(PICTURES) != picture]
        apart.append(scaled(join(own), fit(join(others))))
    return apart


def _short(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
