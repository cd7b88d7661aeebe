"""``task=prune``: make a trained renderer smaller and faster, and see what that costs."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import lightning as L
import numpy as np
import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf, open_dict

from brushexp.app.network_fitting import fit_network, renderer_settings, training_recipe
from brushexp.app.stroke_data import check_origin, data_recipe, stroke_data
from brushexp.app.stroke_sheets import COLUMNS, sheet_of_strokes
from brushexp.app.tracking import trackers_of
from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.renderer.neural import Neural
from brushexp.plugins.renderer.weights_file import RENDERERS
from brushexp.registry import build, plugin_of
from brushexp.results.tables import csv_table, markdown_table
from brushexp.system.callbacks import INTERRUPTED
from brushexp.system.checkpoint import plain_options
from brushexp.system.device import device_of
from brushexp.system.files import write_json, write_picture, write_text
from brushexp.system.runtime import peak_memory
from brushexp.training.benchmark import evaluate, for_painting, speed_and_size
from brushexp.training.datamodule import StrokeData
from brushexp.training.dataset import Split
from brushexp.training.evaluation import effl0_distance
from brushexp.training.monitoring import HeldOutSheet
from brushexp.training.pruning import check_prunable, prune
from brushexp.training.renderer_module import RendererModule

RANKING_BATCHES = 4  # of training strokes, by which channels are ranked
COMPARED = ("l2", "psnr_alpha", "psnr_color", "fid_effl0")  # before and after fine-tuning
DIGITS = {  # columns of the Markdown table
    **{"ratio": 2, "parameters": 0, "file_mb": 2, "strokes_per_second": 0, "strokes_per_second_backward": 0},
    **{"l2_before": 6, "l2": 6, "psnr_alpha_before": 2, "psnr_alpha": 2, "fid_effl0_before": 2, "fid_effl0": 2},
}

log = logging.getLogger(__name__)

Row = dict[str, float]


def run(cfg: DictConfig, start: float) -> dict[str, object]:
    """Prune by every ratio, fine-tune, measure; the table is renewed after each."""
    folder = Path(HydraConfig.get().runtime.output_dir)
    check_ratios(cfg.ratios)
    device = device_of(cfg.device)
    L.seed_everything(cfg.seed, verbose=False)
    trained = build(cfg.renderer).to(device)
    check_prunable(trained)
    if cfg.renderer.get("checkpoint") is None:
        raise UserError("there are no trained weights to prune; give those of task=train: renderer.checkpoint=...")
    data = stroke_data(cfg)
    check_origin(cfg, data.origin)
    job = PruningJob(cfg, folder, data, device)
    rows: list[Row] = []
    renderers: dict[str, Renderer] = {}
    for ratio in cfg.ratios:
        row, renderers[f"{100 * ratio:g} % pruned"] = job.carry_out(trained, ratio)
        rows.append(row)
        write_text(folder / "pruning.csv", csv_table(rows))
        shown = [{key: row[key] for key in DIGITS} for row in rows]
        write_text(folder / "pruning.md", markdown_table(shown, DIGITS, escape=False) + "\n")
    examples = data.first_batch(Split.TEST, min(COLUMNS, job.n))
    write_picture(folder / "strokes.png", np.asarray(sheet_of_strokes(renderers, examples, data.origin)))
    metrics: dict[str, object] = {
        "n": job.n,
        "threads": job.threads,
        "device": str(device),
        "seconds": time.monotonic() - job.begun,
        "seconds_total": time.monotonic() - start,
        "peak_memory_mb": peak_memory(),
        "picture": "strokes.png",
        "status": "completed",
    }
    write_json(folder / "metrics.json", {**metrics, "pruned": rows})
    log.info("%s, %s", folder / "pruning.md", folder / "strokes.png")
    return metrics


class PruningJob:
    """What is the same for every ratio.

    Args:
        cfg: the config.
        folder: of the run.
        data: strokes to fine-tune and measure on.
        device: where to train.
    """

    def __init__(self, cfg: DictConfig, folder: Path, data: StrokeData, device: torch.device) -> None:
        self.cfg, self.folder, self.data, self.device = cfg, folder, data, device
        self.settings, self.name = renderer_settings(cfg), plugin_of(cfg.renderer).name
        self.blend: Blend = build(cfg.blend)
        self.n = data.count(Split.TEST, cfg.n)
        self.threads = torch.get_num_threads()
        self.begun = time.monotonic()
        with open_dict(cfg):
            cfg.checkpoint_every = None  # what is interrupted is begun anew

    def carry_out(self, trained: Neural, ratio: float) -> tuple[Row, Renderer]:
        """Prune by ``ratio``, fine-tune, measure, and write the checkpoint."""
        folder = self.folder / f"ratio_{100 * ratio:g}"
        folder.mkdir(exist_ok=True)
        pruned = prune(trained, ratio, islice(self.data.train_dataloader(), RANKING_BATCHES))
        before = self.figures(for_painting(pruned, self.device))
        log.info("%g %% pruned: alpha %.2f dB before fine-tuning", 100 * ratio, before["psnr_alpha"])
        module = RendererModule(pruned.requires_grad_(True), self.data.origin.window, self.settings)
        path = self.folder / f"{self.name}_{100 * ratio:g}.safetensors"
        with trackers_of(self.cfg, folder) as trackers:
            sheet = HeldOutSheet(folder)
            fit_network(module, self.data, self.cfg, folder, self.device, trackers.loggers, callbacks=[sheet])
            self.save(path, pruned, module, ratio)
            numbers = {**module.figures, "steps": module.global_step, "status": module.stop or "completed"}
            trackers.report(numbers, pictures={"validation": folder / "validation.png"})
        if module.stop == INTERRUPTED:
            log.warning("interrupted; %s was not trained to the end", path)
            raise KeyboardInterrupt
        after = self.figures(for_painting(pruned, self.device))
        torch.set_num_threads(self.threads)  # the first kernel of an engine may have set it to all cores
        row: Row = {"ratio": ratio, **speed_and_size(pruned, self.blend, self.data.origin.window)}
        row["file_mb"] = path.stat().st_size / 1e6
        row |= {f"{name}_before": before[name] for name in COMPARED} | {name: after[name] for name in COMPARED}
        log.info(
            "%s: %d parameters, %.2f MB, %.0f strokes/s, L2 %.6f, alpha %.2f dB (before fine-tuning %.2f dB), "
            "FID (effl0, %d strokes) %.2f; paint with it: python run.py renderer=%s renderer.checkpoint=%s",
            *(path, row["parameters"], row["file_mb"], row["strokes_per_second"], row["l2"], row["psnr_alpha"]),
            *(row["psnr_alpha_before"], self.n, row["fid_effl0"], self.name, path),
        )
        return row, pruned

    def figures(self, renderer: Renderer) -> dict[str, float]:
        """Of test strokes."""
        batches = self.data.first(Split.TEST, self.n)
        return evaluate(renderer, batches, self.data.origin.window, [effl0_distance(self.device)], self.n)

    def save(self, path: Path, renderer: Neural, module: RendererModule, ratio: float) -> None:
        """Write the checkpoint; its recipe tells the widths, so that nothing else has to be typed to load it."""
        options = OmegaConf.to_container(self.cfg.renderer, resolve=True, enum_to_str=True)
        assert isinstance(options, dict)
        checkpoint = str(options["checkpoint"])
        recipe = {
            "options": plain_options(
                {str(key): value for key, value in options.items()} | {"channels": renderer.widths}
            ),
            "data": data_recipe(self.data, self.cfg),
            "training": {
                "pruned": ratio,
                "started_from": checkpoint,
                "before": RENDERERS.read_recipe(RENDERERS.path_of(checkpoint)).get("training"),
                **training_recipe(module, self.cfg),
            },
            "figures": {"validation": module.figures},
        }
        RENDERERS.save(path, self.name, renderer, recipe)


def check_ratios(ratios: Sequence[float]) -> None:
    """Stop if a ratio leaves nothing, or none is given."""
    if not ratios or not all(0 <= ratio < 1 for ratio in ratios):
        raise UserError(f"ratios={list(ratios)} are not shares from 0 to below 1; try 'ratios=[0,0.25,0.5]'")
