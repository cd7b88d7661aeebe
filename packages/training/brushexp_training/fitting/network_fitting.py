"""Train a network as its config specifies, and save its weights with a recipe."""

import logging
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from datetime import timedelta
from pathlib import Path
from types import MappingProxyType
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Timer, WeightAveraging
from lightning.pytorch.loggers import Logger
from omegaconf import DictConfig, OmegaConf
from torch.optim.swa_utils import get_ema_multi_avg_fn

from brushexp.contracts import UserError, plugin_of
from brushexp.contracts.families import RENDERERS
from brushexp.contracts.files import as_shown, write_json
from brushexp.contracts.machine import device_of, peak_memory
from brushexp.contracts.runs import Status, conclude, fit, make_trackers, make_trainer, restore_run
from brushexp_training.fitting.network_module import NetworkModule
from brushexp_training.fitting.renderer_module import RendererModule, RendererSettings
from brushexp_training.stroke_sets.datamodule import StrokeData
from brushexp_training.stroke_sets.stroke_data import data_recipe

LOGGED_FIGURES = ("psnr_alpha", "psnr_color", "accuracy", "auc", "f1", "precision")

log = logging.getLogger(__name__)


class NetworkJob(ABC):
    """Base class for jobs that train a network; it holds the network, its data and the files of the run."""

    module: NetworkModule
    data: L.LightningDataModule
    callbacks: Sequence[L.Callback] = ()
    pictures: Mapping[str, Path] = MappingProxyType({})  # pictures for the trackers, by name
    weights: Path  # file that `finish` writes
    use: str  # command that paints with these weights
    provenance: Mapping[str, Any]  # `provenance_of` the settings of the training
    blank = False  # whether the network has learned nothing, set by `finish`

    @abstractmethod
    def finish(self) -> dict[str, object]:
        """Write the weights with their recipe, and return the network's figures on held-out strokes."""


def train_network(
    begin: Callable[[DictConfig, Path, torch.device], NetworkJob], cfg: DictConfig, folder: Path, start: float
) -> dict[str, object]:
    """Train a network, write it and its figures into the run's folder, and return the metrics."""
    cfg, checkpoint = restore_run(cfg)
    device = device_of(cfg.device)
    trackers = make_trackers(cfg, folder)  # before simulating strokes, because a tracker may refuse its options
    L.seed_everything(cfg.seed, verbose=False)
    job = begin(cfg, folder, device)
    module = job.module
    with trackers:
        failure = fit_network(module, job.data, cfg, folder, device, [trackers], job.callbacks, checkpoint)
        (folder / "metrics.json").unlink(missing_ok=True)  # describes weights that are being replaced
        metrics = {
            **job.finish(),
            "steps": module.global_step,
            "strokes_seen": module.seen,
            "strokes_per_second": module.seen / module.seconds if module.seconds else None,
            "seconds": module.seconds,
            "cpu_seconds": module.cpu_seconds,
            "seconds_total": None if checkpoint else time.monotonic() - start,  # a resumed run has several starts
            "peak_memory_mb": peak_memory(),
            "device": str(device),
            "provenance": job.provenance,
            "status": module.stop or Status.COMPLETED,
        }
        write_json(folder / "metrics.json", metrics)
        trackers.report(metrics, pictures=job.pictures, files={"weights": job.weights})
    conclude(module, folder, cfg, failure, module.global_step)
    figures = ", ".join(f"{key} {metrics[key]:.4g}" for key in LOGGED_FIGURES if key in metrics)
    took = f"{module.global_step} steps in {module.seconds:.1f} s"
    log.info("%s: %s on held-out strokes, %s", as_shown(job.weights), figures, took)
    if job.blank:
        log.warning("the network has learned nothing: it draws all strokes alike; set minutes=60, or lr=2e-4")
    else:
        log.info("paint with it: %s", job.use)
    return metrics


class MovingAverage(WeightAveraging):
    """Callback that maintains an exponential moving average of the weights, which is used for validation.

    The average replaces the weights at the end of the training or after a failure. Each step keeps a fraction ``decay``
    < 1 of the old average; early averages, which consist mostly of random weights, are forgotten faster.
    """

    def __init__(self, decay: float) -> None:
        def average(averages: Any, weights: Any, count: Any) -> None:
            warm_decay = min(decay, (1 + int(count)) / (10 + int(count)))
            get_ema_multi_avg_fn(warm_decay)(averages, weights, count)

        super().__init__(multi_avg_fn=average)
        self.in_place = False  # whether the average currently replaces the weights for validation

    def on_validation_epoch_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        super().on_validation_epoch_start(trainer, pl_module)
        self.in_place = True

    def on_validation_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        super().on_validation_epoch_end(trainer, pl_module)
        self.in_place = False

    def on_exception(self, trainer: L.Trainer, pl_module: L.LightningModule, exception: BaseException) -> None:
        if self._average_model is not None and not self.in_place:
            self._copy_average_to_current(pl_module)
        self._average_model = None  # prevents further exchanges


class Stopwatch(Timer):
    """Timer that ends a training run after ``minutes``.

    A subclass is needed because a Trainer accepts only one callback of each class, and ``trainer.max_time`` adds a
    Timer.
    """


def _check_validations(options: DictConfig, batches: int) -> None:
    """Raise UserError if an epoch has fewer batches than the interval between validations."""
    limit, interval = options.limit_train_batches, options.val_check_interval
    if limit is not None:
        batches = min(batches, limit) if isinstance(limit, int) else int(limit * batches)
    if isinstance(interval, int) and interval > batches > 0:
        wrong = f"trainer.val_check_interval={interval} is more than the batches of an epoch, {batches}"
        raise UserError(f"{wrong}; try trainer.val_check_interval={batches}")


def fit_network(
    module: NetworkModule,
    data: L.LightningDataModule,
    cfg: DictConfig,
    folder: Path,
    device: torch.device,
    loggers: Sequence[Logger],
    callbacks: Sequence[L.Callback] = (),
    checkpoint: Path | None = None,
) -> BaseException | None:
    """Train until the first limit in the config is reached; see `fit`.

    The network is then validated unless it has already been validated at that step.
    """
    batches = len(data.train_dataloader())
    _check_validations(cfg.trainer, batches)
    options = {"log_every_n_steps": min(cfg.trainer.log_every_n_steps, batches)}
    options |= {} if cfg.epochs is None else {"max_epochs": cfg.epochs}
    timers: list[Timer] = [Stopwatch(None if cfg.minutes is None else timedelta(minutes=cfg.minutes), verbose=False)]
    if cfg.trainer.max_time is not None:
        timers.append(Timer(cfg.trainer.max_time, verbose=False))  # the Trainer makes no timer if another exists
    cfg = OmegaConf.merge(cfg, {"trainer": options | {"max_time": None}})  # type: ignore[assignment]
    beside = [*timers, *([MovingAverage(cfg.ema)] if cfg.ema else []), *callbacks]
    trainer = make_trainer(cfg, device, folder, loggers, beside, checkpoints="resume" in cfg, num_sanity_val_steps=0)
    failure = None if cfg.epochs == 0 else fit(trainer, module, data, checkpoint)
    if module.validated != module.global_step:
        try:
            trainer.validate(module, data, verbose=False)
        except Exception as error:
            if failure is None:
                raise
            log.error("the weights are written without figures: %s", error)
    return failure


def renderer_settings(cfg: DictConfig) -> RendererSettings:
    """Collect the settings for training a renderer.

    Configs for fine-tuning have no settings for a critic, so the critic stays off.
    """
    names = ("lr", "detail", "tone", "critic", "critic_lr", "critic_weight", "critic_width")
    return RendererSettings(**{name: cfg[name] for name in names if name in cfg})


def training_recipe(module: NetworkModule, cfg: DictConfig, provenance: Mapping[str, Any]) -> dict[str, object]:
    """Return the part of a recipe that describes the training: settings, all of ``trainer.*``, and provenance."""
    recipe: dict[str, object] = {key: cfg[key] for key in ("batch_size", "lr", "epochs", "minutes", "ema", "seed")}
    recipe |= {"precision": cfg.trainer.precision, "steps": module.global_step, "seconds": module.seconds}
    trainer = OmegaConf.to_container(cfg.trainer, resolve=True, enum_to_str=True)
    recipe |= {"trainer": trainer, "provenance": provenance}
    if "detail" in cfg:
        recipe |= {"detail": cfg.detail, "tone": cfg.tone}
    if cfg.get("critic"):
        recipe |= {key: cfg[key] for key in ("critic_lr", "critic_weight", "critic_width")}
    return recipe


def save_renderer(
    path: Path, module: RendererModule, data: StrokeData, cfg: DictConfig, provenance: Mapping[str, Any],
    figures: dict[str, Any], options: dict[str, Any] | None = None, training: dict[str, Any] | None = None,
) -> str:  # fmt: skip
    """Write a trained renderer with its recipe, and return the hash of its weights.

    ``options`` override the renderer's options in the config; options that are null in the config are taken from the
    checkpoint that training started from. ``training`` is added to the training settings in the recipe.
    """
    chosen: Any = OmegaConf.to_container(cfg.renderer, resolve=True, enum_to_str=True)
    checkpoint = cfg.renderer.get("checkpoint")
    inherited = {} if checkpoint is None else RENDERERS.read_recipe(RENDERERS.path_of(checkpoint))["options"]
    completed = {str(key): inherited.get(key) if value is None else value for key, value in chosen.items()}
    recipe = {
        "options": completed | (options or {}),
        "data": data_recipe(data, cfg),
        "training": training_recipe(module, cfg, provenance) | {"started_from": checkpoint} | (training or {}),
        "figures": figures,
    }
    return RENDERERS.save(path, plugin_of(cfg.renderer).name, module.renderer, recipe)
