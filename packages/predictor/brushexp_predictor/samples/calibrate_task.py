"""``task=calibrate``: measure the coverage of sample intervals, and scale the intervals to 90 % coverage."""

import logging
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import lightning as L
import numpy as np
import torch
from omegaconf import DictConfig
from torch import Tensor

from brushexp.contracts.files import as_shown, showing, write_text
from brushexp.contracts.members import InLayers
from brushexp.contracts.painting import StrokeOptimizer, standard_components
from brushexp.contracts.results import csv_table, markdown_table
from brushexp.contracts.strokes import Catalogue
from brushexp_predictor.lay.decoding import FORMS
from brushexp_predictor.lay.network import PREDICTORS, load_predictor
from brushexp_predictor.lay.predicting import Sample, paint_samples, sample_of
from brushexp_predictor.samples.conformal import COVERAGE, write_scalings
from brushexp_predictor.samples.coverage import KINDS, Report, coverage_of, examine, fit, join, scale_intervals
from brushexp_predictor.samples.known import PICTURES, known_painting

PSNR_TOLERANCE = 1.0  # dB
RESTART_STEPS = 15  # gradient steps of each restart from another seed, for comparison with samples
FEWEST_RESTARTS = 2  # minimum number of restarts, even if time is short

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write the intervals, and tables of their coverage before and after scaling, into the run's folder."""
    weights = PREDICTORS.path_of(cfg.checkpoint)
    network = load_predictor(cfg.checkpoint)
    of_samples, of_restarts, spreads = [], list[Report](), []
    with showing("sampling known paintings") as show:
        for number in range(cfg.paintings):
            show(number / cfg.paintings, f"painting {number + 1} of {cfg.paintings}")
            known = known_painting(cfg.seed, number, cfg.side)
            begin = time.process_time()
            samples = list(paint_samples(network, known.picture, known.told, cfg.samples, number, cfg.temperature))
            seconds = time.process_time() - begin
            of_samples.append(examine(known, number, samples))
            spreads.append(np.ptp([sample.psnr for sample in samples]))
            if cfg.restarts:
                others = list(restart(known.picture, known.told, seconds, number))
                of_restarts.append(examine(known, number, others))
    rows = _compare(of_samples, "samples") + (_compare(of_restarts, "restarts") if of_restarts else [])
    about = {
        "hash": PREDICTORS.read_recipe(weights)["hash"], "temperature": cfg.temperature, "samples": cfg.samples,
        "share": COVERAGE, "paintings": cfg.paintings, "side": cfg.side, "seed": cfg.seed,
    }  # fmt: skip
    name = weights.with_suffix(".intervals.json").name
    for path in (folder, *([weights.parent] if cfg.keep else [])):
        write_scalings(path / name, fit(join(of_samples)), about)
    write_text(folder / "coverage.csv", csv_table(rows, significant=4))
    short = [{key: f"{value:.3g}" if isinstance(value, float) else value for key, value in row.items()} for row in rows]
    text = markdown_table(short, align="lllrrrrrrl")
    write_text(folder / "coverage.md", text + "\n")
    log.info("%s: %s, coverage.csv, coverage.md", as_shown(folder), name)
    return {
        **{f"coverage_{row['of']}_{row['measure']}": row["scaled"] for row in rows if row["by"] == "samples"},
        "psnr_spread": float(np.mean(spreads)),
        "psnr_within_1_db": float(np.mean(np.array(spreads) <= PSNR_TOLERANCE)),
        "seconds_total": time.monotonic() - start,
    }


def _compare(reports: Sequence[Report], by: str) -> list[dict[str, Any]]:
    """Tabulate the coverage of each measure's intervals, before and after scaling by fits to other pictures."""
    test, after, rows = join(reports), join(leave_one_out(reports)), []
    for (of, name), kind in KINDS.items():
        plain, fitted = (coverage_of(report[of, name], kind) for report in (test, after))
        unit = "factor" if kind.is_factor else kind.unit
        rows.append({
            "by": by, "of": of, "measure": name, "known": plain.known, "plain": plain.share, "width": plain.width,
            "scaled": fitted.share, "error": fitted.error, "scaled width": fitted.width, "unit": unit,
        })  # fmt: skip
    return rows


def leave_one_out(reports: Sequence[Report]) -> list[Report]:
    """Scale the intervals for each picture's paintings with scalings fitted to the paintings of all other pictures."""
    apart = []
    for picture in range(min(len(PICTURES), len(reports))):
        own = reports[picture :: len(PICTURES)]
        others = [report for number, report in enumerate(reports) if number % len(PICTURES) != picture]
        apart.append(scale_intervals(join(own), fit(join(others))))
    return apart


def restart(target: Tensor, n: int, seconds: float, seed: int = 0, steps: int = RESTART_STEPS) -> Iterator[Sample]:
    """Paint a target (3, H, W) repeatedly by gradient descent, until ``seconds`` of CPU time have been used.

    Each painting takes ``steps`` from ``init=layers``, with a new seed. Only the time for placing strokes and for the
    steps is counted, not Lightning's start-up.
    """
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    used, number = 0.0, 0
    while used < seconds or number < FEWEST_RESTARTS:
        begin = time.process_time()
        first = InLayers()(target, n, torch.Generator().manual_seed(1_000_003 * seed + number))
        parts = standard_components(steps=steps)
        used += time.process_time() - begin
        catalogue = Catalogue(first, parts.optimizer.units)
        painter = StrokeOptimizer(catalogue, parts, target, target.mean((1, 2)), seed=seed + number)
        trainer = L.Trainer(
            max_epochs=-1, accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False,
            enable_model_summary=False,
        )  # fmt: skip
        trainer.fit(painter)
        used += painter.schedule.cpu_seconds
        number += 1
        with torch.no_grad():
            bottom_up = painter.front_to_back.flip(0)
            strokes = painter.strokes().map(Tensor.detach)[bottom_up]
        yield sample_of(FORMS["plain"], strokes, target)
