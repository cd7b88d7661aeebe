"""``task=train``: train a renderer on simulated strokes."""

import json
import shlex
from functools import cache, partial
from pathlib import Path

import lightning as L
import torch
from omegaconf import DictConfig, OmegaConf

from brushexp.contracts import Bounds, build, build_named, plugin_of, plugins
from brushexp.contracts.families import Engine, Renderer
from brushexp.contracts.runs import provenance_of
from brushexp_training.evaluation.benchmark import draw_batch, evaluate
from brushexp_training.evaluation.evaluation import FrechetDistance, HeldOutSheet, effl0_distance
from brushexp_training.fitting.network_fitting import NetworkJob, renderer_settings, save_renderer, train_network
from brushexp_training.fitting.renderer_module import ALIVE, FreshStart, RendererModule, share_drawn
from brushexp_training.stroke_sets.datamodule import StrokeData
from brushexp_training.stroke_sets.dataset import Origin, Split
from brushexp_training.stroke_sets.stroke_data import stroke_data

DISTILLED = {"window": 1024, "supersample": 1}  # options of the engine from which a renderer is distilled
LOOKED_AT = 64  # number of held-out strokes that show whether a network has learned anything
TEST_STROKES = 2500  # maximum number of strokes on which the final figures are measured


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Train a renderer, write it and its figures into the run's folder, and return the metrics."""
    return train_network(RendererJob, cfg, folder, start)


class RendererJob(NetworkJob):
    """Job that trains a renderer on an engine's strokes."""

    module: RendererModule
    data: StrokeData

    def __init__(self, cfg: DictConfig, folder: Path, device: torch.device) -> None:
        self.cfg, self.device, self.name = cfg, device, plugin_of(cfg.renderer).name
        self.provenance = provenance_of(cfg)
        self.data = stroke_data(cfg)
        self.module = RendererModule(first_renderer(cfg, self.data), self.data.origin.window, renderer_settings(cfg))
        self.callbacks: list[L.Callback] = [HeldOutSheet(folder), *([FrechetDistance(cfg.fid)] if cfg.fid else [])]
        if cfg.renderer.get("checkpoint") is None:
            self.callbacks.append(FreshStart(partial(build, cfg.renderer), cfg.fresh_starts))
        self.pictures = {"validation": folder / "validation.png"}
        self.weights = folder / f"{self.name}.safetensors"
        self.use = f"brushexp renderer={self.name} {renderer_words(cfg.renderer, self.weights)}"

    def finish(self) -> dict[str, object]:
        module, n = self.module, self.data.count(Split.TEST, TEST_STROKES)
        figures: dict[str, object] = {"validation": module.figures}
        self._save(figures)  # before anything below can fail
        renderer = module.renderer.eval().to(self.device)  # a fit leaves it on the CPU
        tested = evaluate(renderer, self.data.first(Split.TEST, n), n, module.window, [effl0_distance(self.device)])
        figures["test"] = tested
        share = share_drawn(*draw_batch(renderer, self.data.first_batch(Split.TEST, LOOKED_AT), module.window))
        self.blank = share is not None and share < ALIVE
        return {
            **tested,
            "renderer": self.name,
            "renderer_hash": self._save(figures),
            "parameters": sum(parameter.numel() for parameter in renderer.parameters()),
            "bytes": self.weights.stat().st_size,
            "picture": "validation.png",
        }

    def _save(self, figures: dict[str, object]) -> str:
        return save_renderer(self.weights, self.module, self.data, self.cfg, self.provenance, figures)


def renderer_words(node: DictConfig, weights: Path) -> str:
    """Return the command-line arguments that load a renderer's weights.

    They include all options that differ from their defaults.
    """
    defaults = OmegaConf.structured(plugin_of(node).config)
    chosen = {str(key): value for key, value in {**node, "checkpoint": str(weights)}.items() if value != defaults[key]}
    typed = {key: value if isinstance(value, str) else json.dumps(value, default=list) for key, value in chosen.items()}
    return shlex.join(f"renderer.{key}={value}" for key, value in typed.items())


def first_renderer(cfg: DictConfig, data: StrokeData) -> Renderer:
    """Build the renderer to train.

    A renderer without a checkpoint may first be distilled from large strokes of the engine.
    """
    renderer: Renderer = build(cfg.renderer)
    if cfg.renderer.get("checkpoint") is None:
        engine = cache(partial(large_engine, data.origin))  # built only if the renderer requests strokes
        renderer.distil(lambda parameters, first: engine()(parameters, seed=data.first_seed, first=first))
    return renderer


def large_engine(origin: Origin) -> Engine:
    """Build the engine that simulated the strokes, but with the options in `DISTILLED`.

    The window is limited to the largest one that the engine supports.
    """
    options = {key: DISTILLED.get(key, value) for key, value in origin.engine_config.items()}
    bounds = next((one.bounds.get("window") for one in plugins("engine") if one.name == origin.engine), None)
    if "window" in options and isinstance(bounds, Bounds):
        options["window"] = int(min(options["window"], bounds.high))
    return build_named("engine", origin.engine, options)
