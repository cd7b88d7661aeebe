"""What training a network and fine-tuning a pruned one share: the fit, and what recipes and metrics say of it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path

import lightning as L
import torch
from lightning.pytorch.callbacks import Timer
from lightning.pytorch.loggers import Logger
from omegaconf import DictConfig, OmegaConf

from brushexp.app.fitting import trainer_of
from brushexp.errors import UserError
from brushexp.system.callbacks import MovingAverage
from brushexp.system.runtime import peak_memory
from brushexp.training.network_module import NetworkModule
from brushexp.training.renderer_module import RendererSettings


def fit_network(
    module: NetworkModule,
    data: L.LightningDataModule,
    cfg: DictConfig,
    folder: Path,
    device: torch.device,
    loggers: Sequence[Logger],
    *,
    callbacks: Sequence[L.Callback] = (),
    resumed: Path | None = None,
) -> None:
    """Train until the first limit of the config, then validate what will be kept, unless that is done.

    Raises:
        UserError: if there is no limit, or an option of the Trainer is wrong.
    """
    if cfg.epochs is None and cfg.minutes is None and cfg.trainer.max_steps < 0:
        raise UserError("neither epochs nor minutes is set, so training would never end; set minutes=60")
    options = {"log_every_n_steps": min(cfg.trainer.log_every_n_steps, len(data.train_dataloader()))}
    options |= {} if cfg.epochs is None else {"max_epochs": cfg.epochs}
    trainer = trainer_of(
        OmegaConf.merge(cfg, {"trainer": options}),  # type: ignore[arg-type]
        device,
        folder,
        loggers,
        [
            Timer(None if cfg.minutes is None else timedelta(minutes=cfg.minutes), verbose=False),
            *([MovingAverage(cfg.ema)] if cfg.ema else []),
            *callbacks,
        ],
        num_sanity_val_steps=0,
    )
    if cfg.epochs != 0:
        trainer.fit(module, data, ckpt_path=None if resumed is None else str(resumed))
    if module.validated != module.global_step:
        trainer.validate(module, data, verbose=False)


def renderer_settings(cfg: DictConfig) -> RendererSettings:
    """What the config says about the training of a renderer; fine-tuning has no critic."""
    names = ("lr", "critic", "critic_lr", "critic_weight", "critic_width")
    return RendererSettings(**{name: cfg[name] for name in names if name in cfg})


def training_recipe(module: NetworkModule, cfg: DictConfig) -> dict[str, object]:
    """How a network was trained, for its recipe."""
    recipe: dict[str, object] = {key: cfg[key] for key in ("batch_size", "lr", "epochs", "minutes", "ema", "seed")}
    recipe |= {"precision": cfg.trainer.precision, "steps": module.global_step, "seconds": module.seconds}
    if cfg.get("critic"):
        recipe |= {key: cfg[key] for key in ("critic_lr", "critic_weight", "critic_width")}
    return recipe


def effort(module: NetworkModule, cfg: DictConfig, start: float, device: torch.device) -> dict[str, object]:
    """What a training took, for metrics.json."""
    seen = module.global_step * cfg.batch_size
    return {
        "steps": module.global_step,
        "strokes_seen": seen,
        "strokes_per_second": seen / module.seconds if module.seconds else None,
        "seconds": module.seconds,
        "seconds_total": time.monotonic() - start,
        "peak_memory_mb": peak_memory(),
        "device": str(device),
        "status": module.stop or "completed",
    }
