"""``task=train``: teach a renderer what simulated strokes look like, or a discriminator which strokes are valid."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cache, partial
from itertools import islice
from pathlib import Path

import lightning as L
import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from brushexp.app.network_fitting import effort, fit_network, renderer_settings, training_recipe
from brushexp.app.resuming import interrupted_run
from brushexp.app.stroke_data import data_recipe, stroke_data
from brushexp.app.tracking import trackers_of
from brushexp.errors import UserError
from brushexp.plugins.loss.discriminator import NAME, Discriminator
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.renderer.weights_file import RENDERERS
from brushexp.registry import build, build_named, plugin_of
from brushexp.system.callbacks import INTERRUPTED
from brushexp.system.checkpoint import plain_options
from brushexp.system.device import device_of
from brushexp.system.files import write_json
from brushexp.training.benchmark import evaluate
from brushexp.training.datamodule import StrokeData
from brushexp.training.dataset import Split
from brushexp.training.discriminator_module import DiscriminatorModule, ShapeData, save_discriminator
from brushexp.training.evaluation import effl0_distance
from brushexp.training.monitoring import FrechetDistance, HeldOutSheet
from brushexp.training.network_module import NetworkModule
from brushexp.training.renderer_module import RendererModule

DISTILLED_WINDOW = 256  # pixels of a window that a renderer may look at before training
TEST_STROKES = 1000  # at most, for the figures at the end
USED_BY_DISCRIMINATOR = (
    *("task", "model", "experiment", "logger", "callbacks", "trainer", "seed", "device", "threads", "output"),
    *("batch_size", "epochs", "minutes", "lr", "ema", "checkpoint_every", "resume"),
)

log = logging.getLogger(__name__)


class Job(ABC):
    """One network to train.

    Attributes:
        module: with the network.
        data: what it learns from.
        callbacks: beside those of every fit.
        pictures: files of the run that trackers get, by name.
        weights: the file that will be written.
    """

    module: NetworkModule
    data: L.LightningDataModule
    callbacks: Sequence[L.Callback] = ()
    pictures: dict[str, Path]
    weights: Path

    @abstractmethod
    def __init__(self, cfg: DictConfig, folder: Path, device: torch.device) -> None: ...

    @abstractmethod
    def finish(self) -> dict[str, object]:
        """Measure the network, write it with its recipe, and return its numbers."""


def run(cfg: DictConfig, start: float) -> dict[str, object]:
    """Train one network, write it and its numbers into the run's folder, and return those of metrics.json."""
    folder = Path(HydraConfig.get().runtime.output_dir)
    resumed = None
    if cfg.get("resume") is not None:
        resumed, cfg = interrupted_run(Path(cfg.resume), cfg)
    if cfg.model == NAME and resumed is None:
        check_used(HydraConfig.get().overrides.task)
    device = device_of(cfg.device)
    trackers = trackers_of(cfg, folder)  # says now what they lack, and not when the strokes have been simulated
    L.seed_everything(cfg.seed, verbose=False)
    job = JOBS[cfg.model](cfg, folder, device)
    with trackers:
        options = {"callbacks": job.callbacks, "resumed": resumed}
        fit_network(job.module, job.data, cfg, folder, device, trackers.loggers, **options)  # type: ignore[arg-type]
        metrics = {**job.finish(), **effort(job.module, cfg, start, device)}
        write_json(folder / "metrics.json", metrics)
        trackers.report(metrics, pictures=job.pictures, files={"weights": job.weights})
    if job.module.stop == INTERRUPTED:
        step = job.module.global_step
        log.warning("interrupted at step %d; continue with: python run.py task=train resume=%s", step, folder)
        raise KeyboardInterrupt
    return metrics


class RendererJob(Job):
    """Train a renderer on strokes of an engine."""

    data: StrokeData
    module: RendererModule

    def __init__(self, cfg: DictConfig, folder: Path, device: torch.device) -> None:
        self.cfg, self.device = cfg, device
        self.data = stroke_data(cfg)
        self.module = RendererModule(first_renderer(cfg, self.data), self.data.origin.window, renderer_settings(cfg))
        self.name = plugin_of(cfg.renderer).name
        self.callbacks = [HeldOutSheet(folder), *([FrechetDistance(cfg.fid)] if cfg.fid else [])]
        self.pictures = {"validation": folder / "validation.png"}
        self.weights = folder / f"{self.name}.safetensors"

    def finish(self) -> dict[str, object]:
        module, cfg, name = self.module, self.cfg, self.name
        n = min(TEST_STROKES, sum(len(Split.TEST.numbers(len(found))) for found in self.data.sets) or TEST_STROKES)
        batches = islice(self.data.test_dataloader(), -(-n // cfg.batch_size))
        renderer = module.renderer.eval()
        tested = evaluate(renderer, batches, module.window, [effl0_distance(self.device)])
        options = OmegaConf.to_container(cfg.renderer, resolve=True, enum_to_str=True)
        assert isinstance(options, dict)
        recipe = {
            "options": plain_options({str(key): value for key, value in options.items()}),
            "data": data_recipe(self.data, cfg),
            "training": training_recipe(module, cfg) | {"started_from": cfg.renderer.get("checkpoint")},
            "figures": {"validation": module.figures, "test": tested},
        }
        digest = RENDERERS.save(self.weights, name, renderer.cpu(), recipe)
        log.info(
            "%s: alpha %.2f dB, colour %.2f dB on held-out strokes, %d steps in %.1f s; paint with it: "
            "python run.py renderer=%s renderer.checkpoint=%s",
            *(self.weights, tested["psnr_alpha"], tested["psnr_color"]),
            *(module.global_step, module.seconds, name, self.weights),
        )
        return {
            **tested,
            "renderer": name,
            "renderer_hash": digest,
            "parameters": sum(parameter.numel() for parameter in renderer.parameters()),
            "bytes": self.weights.stat().st_size,
            "picture": "validation.png",
        }


class DiscriminatorJob(Job):
    """Train a discriminator on strokes of the prior."""

    module: DiscriminatorModule

    def __init__(self, cfg: DictConfig, folder: Path, device: torch.device) -> None:
        self.cfg = cfg
        self.data = ShapeData(batch_size=cfg.batch_size, seed=cfg.seed)
        self.module = DiscriminatorModule(Discriminator(), cfg.lr)
        self.pictures = {}
        self.weights = folder / f"{NAME}.safetensors"

    def finish(self) -> dict[str, object]:
        module, recipe = self.module, training_recipe(self.module, self.cfg)
        figures = save_discriminator(module.network, self.weights, self.cfg.seed, recipe)
        log.info(
            "%s: accuracy %.4f and AUC %.4f on held-out strokes, %d steps in %.1f s; paint with it: "
            "python run.py 'loss=[mse,discriminator]' loss.discriminator.checkpoint=%s",
            *(self.weights, figures["accuracy"], figures["auc"], module.global_step, module.seconds, self.weights),
        )
        return figures


def check_used(overrides: Sequence[str]) -> None:
    """Stop when the command line sets something that a discriminator has no use for.

    Raises:
        UserError: with the override to drop.
    """
    for override in overrides:
        key = override.lstrip("+~").partition("=")[0]
        if key.partition(".")[0] not in USED_BY_DISCRIMINATOR:
            raise UserError(
                f"{override} means nothing to model=discriminator, which learns from the prior of strokes alone; "
                f"drop it (there are: {', '.join(sorted(USED_BY_DISCRIMINATOR))})"
            )


def first_renderer(cfg: DictConfig, data: StrokeData) -> Renderer:
    """The renderer to be trained; one without weights may first look at strokes of the engine, enlarged."""
    renderer: Renderer = build(cfg.renderer)
    if cfg.renderer.get("checkpoint") is None:
        origin = data.origin
        options = {**origin.engine_config, "window": max(DISTILLED_WINDOW, origin.window)}
        engine = cache(partial(build_named, "engine", origin.engine, options))  # not made if nothing is distilled
        seed = data.sets[0].seed if data.sets else cfg.seed
        renderer.distil(lambda parameters, first: engine()(parameters, seed=seed, first=first).images)
    return renderer


JOBS: dict[str, type[Job]] = {"renderer": RendererJob, NAME: DiscriminatorJob}
