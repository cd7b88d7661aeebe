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
from brushexp_predictor.conformal import Scalings, write_scalings
from brushexp_predictor.coverage import KINDS, Report, coverage_of, examine, fit, join, scaled
from brushexp_predictor.doubts import SHARE
from brushexp_predictor.known import FITTED, TESTED, known_painting
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
    total = cfg.paintings + cfg.tested
    with showing("sampling known paintings") as show:
        for number in range(total):
            show(number / total, f"painting {number + 1} of {total}")
            one, other, spread = _examine(cfg, network, number)
            of_samples.append(one)
            of_restarts.append(other)
            spreads.append(spread)
    scalings, rows = _compare(of_samples, cfg.paintings, "samples")
    if cfg.restarts:
        rows += _compare([one for one in of_restarts if one is not None], cfg.paintings, "restarts")[1]
    about = {
        "hash": PREDICTORS.read_recipe(weights)["hash"], "temperature": cfg.temperature, "samples": cfg.samples,
        "share": SHARE, "paintings": cfg.paintings, "side": cfg.side, "seed": cfg.seed,
    }  # fmt: skip
    name = weights.with_suffix(".intervals.json").name
    for path in (folder, *([weights.parent] if cfg.keep else [])):
        write_scalings(path / name, scalings, about)
    write_text(folder / "coverage.csv", csv_table(rows, significant=4))
    text = markdown_table([{key: _short(value) for key, value in row.items()} for row in rows], align="lllrrrrrrl")
    write_text(folder / "coverage.md", text + "\n")
    log.info("%s: %s, coverage.csv, coverage.md", folder, name)
    return {
        **{f"coverage_{row['of']}_{row['measure']}": row["scaled"] for row in rows if row["by"] == "samples"},
        "psnr_spread": float(np.mean(spreads[cfg.paintings :])),
        "psnr_within_1_db": float(np.mean(np.array(spreads[cfg.paintings :]) <= NEAR)),
        "seconds_total": time.monotonic() - start,
    }


def _examine(cfg: DictConfig, network: StrokePredictor, number: int) -> tuple[Report, Report | None, float]:
    """Sample one painting; what was found, the same of restarts, and by how many dB its samples differ."""
    is_test = number >= cfg.paintings
    known = known_painting(2 * cfg.seed + is_test, number, TESTED if is_test else FITTED, cfg.side)
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


def _compare(reports: Sequence[Report], fitted: int, by: str) -> tuple[Scalings, list[dict[str, Any]]]:
    """Fit intervals to the first reports; coverage of the others before and after, a row for each measure."""
    scalings, test = fit(join(reports[:fitted])), join(reports[fitted:])
    after, rows = scaled(test, scalings), []
    for of, kinds in KINDS.items():
        for name, kind in kinds.items():
            plain, fit_ = (coverage_of(report[of][name], kind) for report in (test, after))
            unit = "factor" if kind.is_factor else kind.unit
            rows.append({
                "by": by, "of": of, "measure": name, "known": plain.known, "plain": plain.share, "width": plain.width,
                "scaled": fit_.share, "error": fit_.error, "scaled width": fit_.width, "unit": unit,
            })  # fmt: skip
    return scalings, rows


def _short(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
