"""``task=prune``: make a trained renderer smaller and faster, and see what that costs."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import lightning as L
import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf, open_dict

from brushexp.app.resuming import CHECKPOINT
from brushexp.app.stroke_data import data_recipe, stroke_data
from brushexp.app.tasks.evaluate import (
    COLUMNS,
    as_csv,
    check_origin,
    cost,
    first_strokes,
    frozen,
    held_out,
    number_of,
    sheet_of_strokes,
    shown,
    write_sheet,
)
from brushexp.app.tasks.train import PRECISIONS, fit
from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.renderer.neural import Neural
from brushexp.plugins.renderer.weights_file import checkpoint_path, read_recipe, save_checkpoint
from brushexp.registry import build, plugin_of
from brushexp.system.callbacks import INTERRUPTED
from brushexp.system.checkpoint import plain_options
from brushexp.system.device import device_of
from brushexp.system.files import write_json, write_text
from brushexp.system.process import peak_memory
from brushexp.training.benchmark import judge
from brushexp.training.datamodule import StrokeData
from brushexp.training.evaluation import effl0_distance
from brushexp.training.pruning import check_prunable, prune
from brushexp.training.trainer import RendererTrainer, Training

SPLIT = "test"
BATCHES = 4  # of training strokes, by which channels are ranked
JUDGED = ("l2", "psnr_alpha", "psnr_color", "fid_effl0")
DIGITS = {  # columns of the Markdown table
    **{"ratio": 2, "parameters": 0, "file_mb": 2, "strokes_per_second": 0, "strokes_per_second_backward": 0},
    **{"l2_before": 6, "l2": 6, "psnr_alpha_before": 2, "psnr_alpha": 2, "fid_effl0_before": 2, "fid_effl0": 2},
}

log = logging.getLogger(__name__)

Row = dict[str, float]


def run(cfg: DictConfig, start: float) -> dict[str, object]:
    """Prune by every ratio, fine-tune, judge; the table is renewed after each."""
    folder = Path(HydraConfig.get().runtime.output_dir)
    check_ratios(cfg.ratios)
    device = device_of(cfg.device)
    L.seed_everything(cfg.seed, verbose=False)
    plan = training_of(cfg)
    checkpoint = cfg.renderer.get("checkpoint")
    trained = build(cfg.renderer).to(device)
    check_prunable(trained)
    if checkpoint is None:
        raise UserError("there are no trained weights to prune; give those of task=train: renderer.checkpoint=...")
    data = stroke_data(cfg)
    check_origin(cfg, data.origin)
    job = Job(cfg, folder, data, plan, device)
    rows: list[Row] = []
    renderers: dict[str, Renderer] = {}
    for ratio in cfg.ratios:
        row, renderers[f"{100 * ratio:g} % pruned"] = job.carry_out(trained, ratio)
        rows.append(row)
        write_text(folder / "pruning.csv", as_csv(rows))
        write_text(folder / "pruning.md", as_markdown(rows))
    examples = first_strokes(held_out(data, SPLIT, job.n), COLUMNS)
    write_sheet(folder / "strokes.png", sheet_of_strokes(renderers, examples, data.origin))
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


class Job:
    """What is the same for every ratio.

    Args:
        cfg: the config.
        folder: of the run.
        data: strokes to train and judge on.
        plan: of the fine-tuning.
        device: where to train.
    """

    def __init__(self, cfg: DictConfig, folder: Path, data: StrokeData, plan: Training, device: torch.device) -> None:
        self.cfg, self.folder, self.data, self.plan, self.device = cfg, folder, data, plan, device
        self.blend: Blend = build(cfg.blend)
        self.n = number_of(data, SPLIT, cfg.n)
        self.threads = torch.get_num_threads()
        self.begun = time.monotonic()

    def carry_out(self, trained: Neural, ratio: float) -> tuple[Row, Renderer]:
        """Prune by ``ratio``, fine-tune, judge, and write the checkpoint."""
        folder = self.folder / f"ratio_{100 * ratio:g}"
        folder.mkdir(exist_ok=True)
        pruned = prune(trained, ratio, islice(self.data.train_dataloader(), BATCHES))
        before = self.figures(frozen(pruned, self.device))
        log.info("%g %% pruned: alpha %.2f dB before fine-tuning", 100 * ratio, before["psnr_alpha"])
        module = RendererTrainer(pruned.requires_grad_(True), self.data.origin.window, self.plan)
        with open_dict(self.cfg):
            self.cfg.checkpoint_every = None  # what is interrupted is begun anew
        fit(module, self.data, self.cfg, folder, self.device, None)
        (folder / CHECKPOINT).unlink(missing_ok=True)
        path = self.folder / f"{plugin_of(self.cfg.renderer).name}_{100 * ratio:g}.safetensors"
        tuned = module.averaged
        assert isinstance(tuned, Neural)
        self.save(path, tuned, module, ratio)
        if module.stop == INTERRUPTED:
            log.warning("interrupted; %s was not trained to the end", path)
            raise KeyboardInterrupt
        after = self.figures(frozen(tuned, self.device))
        torch.set_num_threads(self.threads)  # the first kernel of an engine may have set it to all cores
        row: Row = {"ratio": ratio, **cost(tuned, self.blend, self.data.origin.window)}
        row["file_mb"] = path.stat().st_size / 1e6
        row |= {f"{name}_before": before[name] for name in JUDGED} | {name: after[name] for name in JUDGED}
        log.info(
            "%s: %d parameters, %.2f MB, %.0f strokes/s, L2 %.6f, alpha %.2f dB (before fine-tuning %.2f dB), "
            "FID (effl0, %d strokes) %.2f; paint with it: python run.py renderer=%s renderer.checkpoint=%s",
            path,
            row["parameters"],
            row["file_mb"],
            row["strokes_per_second"],
            row["l2"],
            row["psnr_alpha"],
            row["psnr_alpha_before"],
            self.n,
            row["fid_effl0"],
            plugin_of(self.cfg.renderer).name,
            path,
        )
        return row, tuned

    def figures(self, renderer: Renderer) -> dict[str, float]:
        """Of held-out strokes."""
        batches = shown(held_out(self.data, SPLIT, self.n), self.n, self.data.batch_size)
        return judge(renderer, batches, self.data.origin.window, [effl0_distance(self.n, self.device)])

    def save(self, path: Path, renderer: Neural, module: RendererTrainer, ratio: float) -> None:
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
                "before": read_recipe(checkpoint_path(checkpoint)).get("training"),
                **{key: self.cfg[key] for key in ("batch_size", "lr", "epochs", "minutes", "ema", "precision", "seed")},
                "steps": module.step,
                "seconds": module.seconds,
            },
            "figures": {"validation": module.figures},
        }
        save_checkpoint(path, plugin_of(self.cfg.renderer).name, renderer, recipe)


def training_of(cfg: DictConfig) -> Training:
    """What the config says about fine-tuning."""
    if cfg.precision not in PRECISIONS:
        raise UserError(f"precision={cfg.precision} is not one of {', '.join(PRECISIONS)}; try precision=bfloat16")
    names = ("lr", "epochs", "minutes", "ema")
    return Training(bfloat16=PRECISIONS[cfg.precision], **{name: cfg[name] for name in names})


def check_ratios(ratios: Sequence[float]) -> None:
    """Stop if a ratio leaves nothing, or none is given."""
    if not ratios or not all(0 <= ratio < 1 for ratio in ratios):
        raise UserError(f"ratios={list(ratios)} are not shares from 0 to below 1; try 'ratios=[0,0.25,0.5]'")


def as_markdown(rows: Sequence[Row]) -> str:
    """The table, rounded."""
    lines = [list(DIGITS), ["---:" for _ in DIGITS]]
    lines += [[f"{row[key]:.{digits}f}" for key, digits in DIGITS.items()] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
