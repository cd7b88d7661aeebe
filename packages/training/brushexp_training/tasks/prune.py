"""``task=prune``: make a trained renderer smaller and faster, and measure the loss in quality."""

import logging
import time
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import lightning as L
import numpy as np
import torch
from omegaconf import DictConfig

from brushexp.contracts import build, plugin_of
from brushexp.contracts.families import RENDERERS, Renderer
from brushexp.contracts.files import as_shown, write_picture, write_text
from brushexp.contracts.machine import device_of
from brushexp.contracts.results import csv_table, markdown_table
from brushexp.contracts.runs import Status, conclude, make_trackers, provenance_of
from brushexp_training.evaluation.benchmark import device_of_weights, evaluate, speed_and_size
from brushexp_training.evaluation.evaluation import HeldOutSheet, effl0_distance
from brushexp_training.fitting.network_fitting import fit_network, renderer_settings, save_renderer
from brushexp_training.fitting.renderer_module import RendererModule
from brushexp_training.renderers.inverse_vgg import InverseVGG
from brushexp_training.renderers.pruning import prune
from brushexp_training.stroke_sets.datamodule import StrokeData
from brushexp_training.stroke_sets.dataset import Split
from brushexp_training.stroke_sets.stroke_data import measured_count, stroke_data
from brushexp_training.stroke_sets.stroke_sheets import COLUMNS, sheet_of_strokes

RANKING_BATCHES = 4  # number of batches of training strokes by which channels are ranked
COMPARED = ("l2", "psnr_alpha", "psnr_color", "fid_effl0")  # metrics compared before and after fine-tuning
DIGITS = {  # columns of the Markdown table
    **{"ratio": 2, "parameters": 0, "file_mb": 2, "strokes_per_second": 0, "strokes_per_second_backward": 0},
    **{"l2_before": 6, "l2": 6, "psnr_alpha_before": 2, "psnr_alpha": 2, "fid_effl0_before": 2, "fid_effl0": 2},
}

log = logging.getLogger(__name__)

Row = dict[str, float]


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Prune a renderer by each ratio, fine-tune and measure the result, and update the table after each ratio."""
    device = device_of(cfg.device)
    L.seed_everything(cfg.seed, verbose=False)
    provenance = provenance_of(cfg)
    trained = build(cfg.renderer).to(device)
    data = stroke_data(cfg)
    begun, n = time.monotonic(), measured_count(data, Split.TEST, cfg.n)
    rows: list[Row] = []
    renderers: dict[str, Renderer] = {}
    for ratio in cfg.ratios:
        row, renderers[f"{100 * ratio:g} % pruned"] = carry_out(cfg, provenance, folder, data, n, trained, ratio)
        rows.append(row)
        write_text(folder / "pruning.csv", csv_table(rows))
        columns = [{key: row[key] for key in DIGITS} for row in rows]
        write_text(folder / "pruning.md", markdown_table(columns, DIGITS, escape=False) + "\n")
    examples = data.first_batch(Split.TEST, min(COLUMNS, n))
    write_picture(folder / "strokes.png", np.asarray(sheet_of_strokes(renderers, examples, data.origin)))
    metrics: dict[str, object] = {
        "n": n,
        "threads": torch.get_num_threads(),
        "device": str(device),
        "seconds": time.monotonic() - begun,
        "picture": "strokes.png",
        "pruned": rows,
    }
    log.info("%s, %s", as_shown(folder / "pruning.md"), as_shown(folder / "strokes.png"))
    return metrics


def carry_out(
    cfg: DictConfig,
    provenance: Mapping[str, Any],
    whole: Path,
    data: StrokeData,
    n: int,
    trained: InverseVGG,
    ratio: float,
) -> tuple[Row, Renderer]:
    """Prune a copy of ``trained`` by ``ratio``, fine-tune it, measure it on ``n`` strokes, and write its checkpoint."""
    name, path = f"{100 * ratio:g}", whole / f"{plugin_of(cfg.renderer).name}_{100 * ratio:g}.safetensors"
    folder, window, device = whole / f"ratio_{name}", data.origin.window, device_of_weights(trained)
    folder.mkdir(exist_ok=True)

    def measure() -> dict[str, float]:
        frozen = pruned.to(device).eval().requires_grad_(False)
        return evaluate(frozen, data.first(Split.TEST, n), n, window, [effl0_distance(device)])

    pruned = prune(trained, ratio, islice(data.train_dataloader(), RANKING_BATCHES))
    before = measure()
    module = RendererModule(pruned.requires_grad_(True), window, renderer_settings(cfg))
    with make_trackers(cfg, folder) as trackers:
        failure = fit_network(module, data, cfg, folder, device, [trackers], [HeldOutSheet(folder)])
        started = RENDERERS.read_recipe(RENDERERS.path_of(cfg.renderer.checkpoint)).get("training")
        figures, more = {"validation": module.figures}, {"pruned": ratio, "before": started}
        save_renderer(path, module, data, cfg, provenance, figures, {"channels": pruned.widths}, more)
        numbers = {**module.figures, "steps": module.global_step, "status": module.stop or Status.COMPLETED}
        trackers.report(numbers, pictures={"validation": folder / "validation.png"})
    conclude(module, folder, cfg, failure, module.global_step)
    after = measure()
    row: Row = {"ratio": ratio, **speed_and_size(pruned, build(cfg.blend), window)}
    row["file_mb"] = path.stat().st_size / 1e6
    row |= {f"{key}_before": before[key] for key in COMPARED} | {key: after[key] for key in COMPARED}
    log.info(
        "%s: %d parameters, %.0f strokes/s, alpha %.2f dB (before fine-tuning %.2f dB)",
        *(path, row["parameters"], row["strokes_per_second"], after["psnr_alpha"], before["psnr_alpha"]),
    )
    return row, pruned
