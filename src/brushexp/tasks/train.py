"""``task=train``: teach a renderer what simulated strokes look like, or a discriminator which strokes are valid."""

import json
import logging
import shlex
import time
from functools import cache, partial
from pathlib import Path

import lightning as L
import torch
from brushexp_discriminator.discriminator_module import DiscriminatorModule, ShapeData, save_discriminator
from brushexp_discriminator.loss import NAME, Discriminator
from omegaconf import DictConfig, OmegaConf

from brushexp.bounds import Bounds
from brushexp.plugins.engine.base import Engine
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import build, build_named, plugin_of, plugins
from brushexp.runs.resume import resumed
from brushexp.runs.tracking import make_trackers
from brushexp.runs.trainer import conclude
from brushexp.system.device import device_of
from brushexp.system.files import write_json
from brushexp.system.runtime import peak_memory
from brushexp.training.benchmark import evaluate
from brushexp.training.datamodule import StrokeData
from brushexp.training.dataset import Origin, Split
from brushexp.training.evaluation import FrechetDistance, HeldOutSheet, effl0_distance
from brushexp.training.fresh_start import FreshStart
from brushexp.training.network_fitting import fit_network, renderer_settings, save_renderer, training_recipe
from brushexp.training.renderer_module import RendererModule
from brushexp.training.stroke_data import stroke_data

DISTILLED = {"window": 1024, "supersample": 1}  # options of an engine whose strokes a renderer looks at
MAIN_FIGURES = ("psnr_alpha", "psnr_color", "accuracy", "auc")  # in the log
TEST_STROKES = 2500  # at most, for the figures at the end

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Train one network, write it and its numbers into the run's folder, and return those of metrics.json."""
    cfg, checkpoint = resumed(cfg)
    device = device_of(cfg.device)
    trackers = make_trackers(cfg, folder)  # says now what they lack, and not when the strokes have been simulated
    L.seed_everything(cfg.seed, verbose=False)
    job = JOBS[cfg.model](cfg, folder, device)
    module = job.module
    with trackers:
        failure = fit_network(module, job.data, cfg, folder, device, [trackers], job.callbacks, checkpoint)
        (folder / "metrics.json").unlink(missing_ok=True)  # of weights that are being replaced
        metrics = {
            **job.finish(),
            "steps": module.global_step,
            "strokes_seen": module.seen,
            "strokes_per_second": module.seen / module.seconds if module.seconds else None,
            "seconds": module.seconds,
            "cpu_seconds": module.cpu_seconds,
            "seconds_total": None if checkpoint else time.monotonic() - start,  # a run that went on has no one start
            "peak_memory_mb": peak_memory(),
            "device": str(device),
            "status": module.stop or "completed",
        }
        write_json(folder / "metrics.json", metrics)
        trackers.report(metrics, pictures=job.pictures, files={"weights": job.weights})
    conclude(module, folder, cfg, failure, module.global_step)
    figures = ", ".join(f"{key} {metrics[key]:.4g}" for key in MAIN_FIGURES if key in metrics)
    log.info(
        "%s: %s on held-out strokes, %d steps in %.1f s; paint with it: %s",
        *(job.weights, figures, module.global_step, module.seconds, job.use),
    )
    return metrics


class RendererJob:
    """Train a renderer on strokes of an engine."""

    def __init__(self, cfg: DictConfig, folder: Path, device: torch.device) -> None:
        self.cfg, self.device, self.name = cfg, device, plugin_of(cfg.renderer).name
        self.data = stroke_data(cfg)
        self.module = RendererModule(first_renderer(cfg, self.data), self.data.origin.window, renderer_settings(cfg))
        self.callbacks: list[L.Callback] = [HeldOutSheet(folder), *([FrechetDistance(cfg.fid)] if cfg.fid else [])]
        if cfg.renderer.get("checkpoint") is None:
            self.callbacks.append(FreshStart(partial(build, cfg.renderer)))
        self.pictures = {"validation": folder / "validation.png"}
        self.weights = folder / f"{self.name}.safetensors"
        self.use = f"brushexp renderer={self.name} {with_weights(cfg.renderer, self.weights)}"

    def finish(self) -> dict[str, object]:
        """Write the network with its recipe, measure it, and return its numbers."""
        module, n = self.module, self.data.count(Split.TEST, TEST_STROKES)
        figures: dict[str, object] = {"validation": module.figures}
        save_renderer(self.weights, module, self.data, self.cfg, figures)  # whatever may fail below
        renderer = module.renderer.eval().to(self.device)  # at the end of a fit it is on the processor
        tested = evaluate(renderer, self.data.first(Split.TEST, n), n, module.window, [effl0_distance(self.device)])
        figures["test"] = tested
        return {
            **tested,
            "renderer": self.name,
            "renderer_hash": save_renderer(self.weights, module, self.data, self.cfg, figures),
            "parameters": sum(parameter.numel() for parameter in renderer.parameters()),
            "bytes": self.weights.stat().st_size,
            "picture": "validation.png",
        }


class DiscriminatorJob:
    """Train a discriminator on strokes of the prior."""

    def __init__(self, cfg: DictConfig, folder: Path, device: torch.device) -> None:
        self.cfg = cfg
        self.data = ShapeData(batch_size=cfg.batch_size, seed=cfg.seed)
        self.module = DiscriminatorModule(Discriminator(), cfg.lr)
        self.callbacks: list[L.Callback] = []
        self.pictures: dict[str, Path] = {}
        self.weights = folder / f"{NAME}.safetensors"
        self.use = f"brushexp 'loss=[mse,discriminator]' loss.discriminator.checkpoint={self.weights}"

    def finish(self) -> dict[str, object]:
        """Measure the network, write it with its recipe, and return its numbers."""
        recipe = training_recipe(self.module, self.cfg)
        return save_discriminator(self.module.network, self.weights, self.cfg.seed, recipe)


def with_weights(node: DictConfig, weights: Path) -> str:
    """The words that give a renderer these weights, and the options of its node that are not the usual ones."""
    usual = OmegaConf.structured(plugin_of(node).config)
    given = {str(key): value for key, value in {**node, "checkpoint": str(weights)}.items() if value != usual[key]}
    typed = {key: value if isinstance(value, str) else json.dumps(value, default=list) for key, value in given.items()}
    return shlex.join(f"renderer.{key}={value}" for key, value in typed.items())


def first_renderer(cfg: DictConfig, data: StrokeData) -> Renderer:
    """The renderer to be trained; one without weights may first look at strokes of the engine, enlarged."""
    renderer: Renderer = build(cfg.renderer)
    if cfg.renderer.get("checkpoint") is None:
        engine = cache(partial(enlarged, data.origin))  # not made if nothing is distilled
        seed = data.sets[0].seed if data.sets else cfg.seed
        renderer.distil(lambda parameters, first: engine()(parameters, seed=seed, first=first))
    return renderer


def enlarged(origin: Origin) -> Engine:
    """What made some strokes, as it paints them in the window `DISTILLED`, or in the largest that it takes."""
    options = {key: DISTILLED.get(key, value) for key, value in origin.engine_config.items()}
    bounds = next((found.bounds.get("window") for found in plugins("engine") if found.name == origin.engine), None)
    if "window" in options and isinstance(bounds, Bounds):
        options["window"] = int(min(options["window"], bounds.high))
    engine: Engine = build_named("engine", origin.engine, options)
    return engine


JOBS: dict[str, type[RendererJob] | type[DiscriminatorJob]] = {"renderer": RendererJob, NAME: DiscriminatorJob}
