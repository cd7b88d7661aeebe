"""``task=train``: teach a renderer what simulated strokes look like, or a discriminator which strokes are valid."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import fields
from functools import cache, partial
from itertools import islice
from pathlib import Path

import lightning as L
import torch
from hydra.core.hydra_config import HydraConfig
from lightning.pytorch.loggers import Logger
from omegaconf import DictConfig, OmegaConf

from brushexp.app.resuming import CHECKPOINT, interrupted_run
from brushexp.app.schema import Task
from brushexp.app.stroke_data import data_recipe, stroke_data
from brushexp.app.tracking import trackers_of
from brushexp.errors import UserError
from brushexp.plugins.loss.discriminator import NAME, Discriminator
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.renderer.weights_file import save_checkpoint
from brushexp.registry import build, build_named, plugin_of
from brushexp.system.checkpoint import plain_options
from brushexp.system.device import device_of
from brushexp.system.files import write_json
from brushexp.system.process import interruptible, peak_memory
from brushexp.training.benchmark import judge
from brushexp.training.datamodule import StrokeData
from brushexp.training.dataset import Split
from brushexp.training.discriminator import Plan
from brushexp.training.discriminator import Training as TrainingOfDiscriminator
from brushexp.training.discriminator import save as save_discriminator
from brushexp.training.evaluation import effl0_distance
from brushexp.training.progress import INTERRUPTED, Checkpoints, HeldOutPictures, ProgressBar
from brushexp.training.trainer import RendererTrainer, Training

DISTILLED = 256  # pixels of a window that a renderer may look at before training
JUDGED = 1000  # test strokes at most
PRECISIONS = {"float32": False, "bfloat16": True}

log = logging.getLogger(__name__)


def run(cfg: DictConfig, start: float) -> dict[str, object]:
    """Train one model, write it and its numbers into the run's folder, and return those of metrics.json."""
    folder = Path(HydraConfig.get().runtime.output_dir)
    resumed = None
    if cfg.get("resume") is not None:
        resumed, cfg = interrupted_run(Path(cfg.resume), cfg)
    if cfg.model not in MODELS:
        raise UserError(f"model={cfg.model} is not one of {', '.join(MODELS)}; try model=renderer")
    trackers_of(cfg, folder)  # says now what they lack, and not when the strokes have been simulated
    device = device_of(cfg.device)
    L.seed_everything(cfg.seed, verbose=False)
    return MODELS[cfg.model](cfg, folder, start, device, resumed)


def run_renderer(
    cfg: DictConfig, folder: Path, start: float, device: torch.device, resumed: Path | None
) -> dict[str, object]:
    """Train a renderer on strokes of an engine."""
    training = training_of(cfg)
    data = stroke_data(cfg)
    module = RendererTrainer(first_renderer(cfg, data), data.origin.window, training)
    fit(module, data, cfg, folder, device, resumed)
    metrics = finish(module, data, cfg, folder, start, device)
    if module.stop == INTERRUPTED:
        log.warning("interrupted at step %d; continue with: python run.py task=train resume=%s", module.step, folder)
        raise KeyboardInterrupt
    return metrics


def run_discriminator(
    cfg: DictConfig, folder: Path, start: float, device: torch.device, resumed: Path | None
) -> dict[str, object]:
    """Train a discriminator on strokes of the prior; as this takes a minute, it is not resumed."""
    check_used(HydraConfig.get().overrides.task)
    plan = Plan(**{field.name: cfg[field.name] for field in fields(Plan)})
    training = TrainingOfDiscriminator(Discriminator().to(device), plan)
    promise = "stopping after this step; what is trained so far will be written"
    with trackers_of(cfg, folder) as trackers:
        with interruptible(partial(setattr, training, "stop", INTERRUPTED), promise):
            training.run(trackers.loggers)
        metrics = finish_discriminator(training, folder, start)
        trackers.report(metrics, files={"weights": folder / f"{NAME}.safetensors"})
    if training.stop == INTERRUPTED:
        log.warning("interrupted at step %d; %s.safetensors was not trained to the end", training.step, NAME)
        raise KeyboardInterrupt
    return metrics


def check_used(overrides: Sequence[str]) -> None:
    """Stop when the command line sets something that a discriminator has no use for.

    Raises:
        UserError: with the override to drop.
    """
    used = {"task", "model", "logger", "experiment", *(field.name for field in [*fields(Task), *fields(Plan)])}
    for override in overrides:
        key = override.lstrip("+~").partition("=")[0]
        if key.partition(".")[0] not in used:
            raise UserError(
                f"{override} means nothing to model=discriminator, which learns from the prior of strokes alone; "
                f"drop it (there are: {', '.join(sorted(used))})"
            )


def training_of(cfg: DictConfig) -> Training:
    """What the config says about training."""
    if cfg.precision not in PRECISIONS:
        raise UserError(f"precision={cfg.precision} is not one of {', '.join(PRECISIONS)}; try precision=bfloat16")
    names = ("lr", "epochs", "minutes", "ema", "critic", "critic_lr", "critic_weight", "critic_width")
    return Training(bfloat16=PRECISIONS[cfg.precision], **{name: cfg[name] for name in names})


def first_renderer(cfg: DictConfig, data: StrokeData) -> Renderer:
    """The renderer to be trained; one without weights may first look at strokes of the engine, enlarged."""
    renderer: Renderer = build(cfg.renderer)
    if cfg.renderer.get("checkpoint") is None:
        origin = data.origin
        options = {**origin.engine_config, "window": max(DISTILLED, origin.window)}
        engine = cache(partial(build_named, "engine", origin.engine, options))  # not made if nothing is distilled
        seed = data.sets[0].seed if data.sets else cfg.seed
        renderer.distil(lambda parameters, first: engine()(parameters, seed=seed, first=first).images)
    return renderer


def fit(
    module: RendererTrainer,
    data: StrokeData,
    cfg: DictConfig,
    folder: Path,
    device: torch.device,
    resumed: Path | None,
) -> None:
    """Train until an end is reached, then measure what will be kept; of both the trackers are told."""
    with trackers_of(cfg, folder) as trackers:
        train(module, data, cfg, folder, device, resumed, trackers.loggers)
        trackers.report(
            {**module.figures, "steps": module.step, "status": module.stop or "completed"},
            pictures={"validation": folder / "validation.png"},
        )


def train(
    module: RendererTrainer,
    data: StrokeData,
    cfg: DictConfig,
    folder: Path,
    device: torch.device,
    resumed: Path | None,
    loggers: Sequence[Logger],
) -> None:
    """The training of `fit`."""
    trainer = L.Trainer(
        accelerator="gpu" if device.type == "cuda" else "cpu",
        devices=[device.index or 0] if device.type == "cuda" else 1,
        max_epochs=-1 if cfg.epochs is None else cfg.epochs,
        logger=loggers,
        callbacks=[ProgressBar(), HeldOutPictures(folder), Checkpoints(folder / CHECKPOINT, cfg.checkpoint_every)],
        log_every_n_steps=1,
        num_sanity_val_steps=0,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
    )
    with interruptible(
        partial(setattr, module, "stop", INTERRUPTED),
        "stopping after this step; what is trained so far will be written",
    ):
        if cfg.epochs != 0:
            trainer.fit(module, data, ckpt_path=None if resumed is None else str(resumed))
    if module.judged != module.step:
        trainer.validate(module, data, verbose=False)


def finish(
    module: RendererTrainer, data: StrokeData, cfg: DictConfig, folder: Path, start: float, device: torch.device
) -> dict[str, object]:
    """Write the renderer with its recipe, and the numbers."""
    name = plugin_of(cfg.renderer).name
    options = OmegaConf.to_container(cfg.renderer, resolve=True, enum_to_str=True)
    assert isinstance(options, dict)
    path = folder / f"{name}.safetensors"
    recipe = {
        "options": plain_options({str(key): value for key, value in options.items()}),
        "data": data_recipe(data, cfg),
        "training": training_recipe(module, cfg),
    }
    n = min(JUDGED, sum(len(Split.TEST.numbers(len(strokes))) for strokes in data.sets) or JUDGED)
    batches = islice(data.test_dataloader(), -(-n // cfg.batch_size))
    tested = judge(module.averaged, batches, module.window, [effl0_distance(n, device)])
    recipe["figures"] = {"validation": module.figures, "test": tested}
    digest = save_checkpoint(path, name, module.averaged.cpu(), recipe)
    metrics: dict[str, object] = {
        **tested,
        "renderer": name,
        "renderer_hash": digest,
        "parameters": sum(parameter.numel() for parameter in module.renderer.parameters()),
        "bytes": path.stat().st_size,
        **effort(module, cfg.batch_size, start, device),
        "picture": "validation.png",
    }
    write_json(folder / "metrics.json", metrics)
    log.info(
        "%s: alpha %.2f dB, colour %.2f dB on held-out strokes, %d steps in %.1f s; paint with it: "
        "python run.py renderer=%s renderer.checkpoint=%s",
        path,
        tested["psnr_alpha"],
        tested["psnr_color"],
        module.step,
        module.seconds,
        name,
        path,
    )
    if module.stop != INTERRUPTED:
        (folder / CHECKPOINT).unlink(missing_ok=True)
    return metrics


def finish_discriminator(training: TrainingOfDiscriminator, folder: Path, start: float) -> dict[str, object]:
    """Write the discriminator with its recipe, and the numbers."""
    path = folder / f"{NAME}.safetensors"
    metrics: dict[str, object] = {
        **save_discriminator(training, path),
        **effort(training, training.plan.batch_size, start, training.network.threshold.device),
    }
    write_json(folder / "metrics.json", metrics)
    log.info(
        "%s: accuracy %.4f and AUC %.4f on held-out strokes, %d steps in %.1f s; paint with it: "
        "python run.py 'loss=[mse,discriminator]' loss.discriminator.checkpoint=%s",
        path,
        metrics["accuracy"],
        metrics["auc"],
        training.step,
        training.seconds,
        path,
    )
    return metrics


def effort(
    training: RendererTrainer | TrainingOfDiscriminator, batch_size: int, start: float, device: torch.device
) -> dict[str, object]:
    """What a training took, for metrics.json."""
    seen = training.step * batch_size
    return {
        "steps": training.step,
        "strokes_seen": seen,
        "strokes_per_second": seen / training.seconds if training.seconds else None,
        "seconds": training.seconds,
        "seconds_total": time.monotonic() - start,
        "peak_memory_mb": peak_memory(),
        "device": str(device),
        "status": training.stop or "completed",
    }


def training_recipe(module: RendererTrainer, cfg: DictConfig) -> dict[str, object]:
    """How it was trained."""
    kept = ("batch_size", "lr", "epochs", "minutes", "ema", "precision", "seed")
    recipe: dict[str, object] = {key: cfg[key] for key in kept}
    if cfg.critic:
        recipe |= {key: cfg[key] for key in ("critic_lr", "critic_weight", "critic_width")}
    return {**recipe, "started_from": cfg.renderer.get("checkpoint"), "steps": module.step, "seconds": module.seconds}


MODELS = {"renderer": run_renderer, "discriminator": run_discriminator}
