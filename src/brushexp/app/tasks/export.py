"""``task=export``: a saved painting as pictures of any size, vectors, tables and more, without optimising."""

from __future__ import annotations

import logging
import time
from dataclasses import replace
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from brushexp.errors import UserError
from brushexp.painting.outputs import config_of, export_job, renderer_of
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import build, plugin_of
from brushexp.strokes.storage import Saved, load_catalogue

log = logging.getLogger(__name__)


def run(cfg: DictConfig, start: float) -> dict[str, object]:
    """Write a catalogue in every form of ``cfg.to`` into the run's folder."""
    exporters = {name: build(node) for name, node in cfg.to.items()}
    saved, renderer = with_renderer(load_catalogue(Path(cfg.catalogue)), cfg.get("renderer"), cfg.catalogue)
    job = export_job(saved, renderer, build(cfg.blend), saved.renderer, cfg.resolution, cfg.catalogue)
    folder = Path(HydraConfig.get().runtime.output_dir)
    before = time.monotonic()
    for name, exporter in exporters.items():
        begin = time.monotonic()
        try:
            paths = exporter.write(job, folder)
        except MemoryError as error:
            height, width = job.size
            raise UserError(
                f"to={name}: no memory for {width} x {height} pixels; choose a smaller resolution"
            ) from error
        seconds = time.monotonic() - begin
        for path in paths:
            log.info("%s: %s (%.1f s)", path, in_bytes(path.stat().st_size), seconds)
    return {
        "n_strokes": len(job.strokes),
        "height": job.size[0],
        "width": job.size[1],
        "seconds": time.monotonic() - before,
        "seconds_total": time.monotonic() - start,
        "status": "completed",
    }


def with_renderer(saved: Saved, chosen: DictConfig | None, path: str) -> tuple[Saved, Renderer]:
    """The renderer to draw with, and the catalogue as if it had been painted with it.

    Args:
        saved: the catalogue.
        chosen: config of a renderer; None for the one that the catalogue was made with.
        path: of the catalogue, for the log.
    """
    renderer: Renderer = renderer_of(saved) if chosen is None else build(chosen)
    name = saved.renderer if chosen is None else plugin_of(chosen).name
    if name == saved.renderer and renderer.weights_hash != saved.renderer_hash:
        log.warning(
            "%s was painted with other weights of renderer=%s, so the picture will differ; "
            "give those with renderer=%s renderer.checkpoint=...",
            path, saved.renderer, saved.renderer,
        )  # fmt: skip
    if chosen is None:
        return saved, renderer
    config = OmegaConf.merge(config_of(saved), {"renderer": None})
    config.renderer = OmegaConf.to_container(chosen, resolve=True)
    return replace(
        saved, renderer=name, renderer_hash=renderer.weights_hash, config=OmegaConf.to_yaml(config)
    ), renderer


def in_bytes(count: int) -> str:
    """A number of bytes as people read it."""
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{count / 1e3:.1f} kB" if count >= 1e3 else f"{count} bytes"
