"""``task=evaluate``: measure a renderer on strokes that it was not trained on."""

import logging
import time
from pathlib import Path

import lightning as L
import numpy as np
import torch
from omegaconf import DictConfig

from brushexp.contracts import build, build_named, plugin_of
from brushexp.contracts.families import RENDERERS, Engine
from brushexp.contracts.files import weights_hash, write_picture, write_text
from brushexp.contracts.machine import device_of
from brushexp.contracts.results import csv_table
from brushexp_training.evaluation.benchmark import draw_extremes, evaluate, speed_and_size
from brushexp_training.evaluation.evaluation import effl0_distance, inception_distance
from brushexp_training.stroke_sets.dataset import Split
from brushexp_training.stroke_sets.stroke_data import measured_count, stroke_data
from brushexp_training.stroke_sets.stroke_sheets import sheet_of_extremes, sheet_of_strokes

PICTURE_STROKES = 24  # number of strokes in strokes.png

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write a renderer's figures and pictures into the run's folder, and return the figures."""
    L.seed_everything(cfg.seed, verbose=False)
    device = device_of(cfg.device)
    name, checkpoint = plugin_of(cfg.renderer).name, cfg.renderer.get("checkpoint")
    renderer = build(cfg.renderer).to(device).eval().requires_grad_(False)
    data = stroke_data(cfg)
    window, seed = data.origin.window, data.first_seed
    engine: Engine = build_named("engine", data.origin.engine, data.origin.engine_config)
    if checkpoint is None and any(True for _ in renderer.parameters()):
        log.warning("%s has random weights; give the weights of task=train: renderer.checkpoint=...", name)
    before = time.monotonic()
    costs = {"threads": torch.get_num_threads(), **speed_and_size(renderer, build(cfg.blend), window)}
    split, distances = Split[cfg.split.upper()], [effl0_distance(device)]
    if cfg.inception is not None:
        distances.append(inception_distance(Path(cfg.inception), device))
    n = measured_count(data, split, cfg.n)
    figures = evaluate(renderer, data.first(split, n), n, window, distances)
    write_text(folder / "distances.csv", csv_table(distances[0].by_number()))
    examples = data.first_batch(split, min(PICTURE_STROKES, n))
    write_picture(folder / "strokes.png", np.asarray(sheet_of_strokes({name: renderer}, examples, data.origin)))
    extremes = draw_extremes(renderer, engine, seed)
    write_picture(folder / "outside.png", np.asarray(sheet_of_extremes(name, data.origin.engine, extremes)))
    write_text(folder / "outside.csv", csv_table(extremes.rows))
    metrics: dict[str, object] = {
        **figures,
        **costs,
        "file_mb": None if checkpoint is None else RENDERERS.path_of(checkpoint).stat().st_size / 1e6,
        "n": n,
        "finite_outside": all(row["finite"] for row in extremes.rows if row["drawn"] == "painted"),
        "renderer": name,
        "renderer_hash": weights_hash(renderer),
        "checkpoint": checkpoint,
        "data": "simulated" if cfg.data is None else ", ".join(cfg.data),
        "data_seed": seed,
        "engine": data.origin.engine,
        "split": cfg.split,
        "device": str(device),
        "seconds": time.monotonic() - before,
        "picture": "strokes.png",
    }
    log.info(
        "%s: alpha %.2f dB, bristles of thick strokes %.0f %%, FID (effl0, %d strokes) %.2f, %.0f strokes/s forward, "
        "%.0f with gradient; %s",
        *(name, figures["psnr_alpha"], 100 * figures["bristles_thick"], n, figures["fid_effl0"]),
        *(costs["strokes_per_second"], costs["strokes_per_second_backward"], folder / "strokes.png"),
    )
    return metrics
