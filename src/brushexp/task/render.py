"""``task=render``: paint a saved catalogue at any size, crisp, without optimising."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from brushexp.checks import Render, check_keys
from brushexp.errors import UserError
from brushexp.files import write_picture
from brushexp.paint.outputs import render
from brushexp.registry import build, build_named, plugin_of
from brushexp.renderer.base import Renderer
from brushexp.strokes.storage import Saved, load_catalogue

LARGEST = 65_536  # pixels of the longer side

log = logging.getLogger(__name__)


def run(cfg: DictConfig, start: float) -> dict[str, object]:
    """Write ``painting.png`` of a catalogue into the run's folder."""
    check_keys(cfg, Render)
    saved = load_catalogue(Path(cfg.catalogue))
    resolution = cfg.resolution or max(saved.size)
    if resolution > LARGEST:
        raise UserError(f"resolution={resolution} is more than {LARGEST} pixels; choose a smaller one")
    chosen = cfg.get("renderer")
    renderer = renderer_of(saved) if chosen is None else build(chosen)
    same = chosen is None or plugin_of(chosen).name == saved.renderer
    if same and renderer.weights_hash != saved.renderer_hash:
        log.warning(
            "%s was painted with other weights of renderer=%s, so the picture will differ; "
            "give those with renderer=%s renderer.checkpoint=...",
            cfg.catalogue, saved.renderer, saved.renderer,
        )  # fmt: skip
    before = time.monotonic()
    picture = render(saved, renderer, build(cfg.blend), resolution)
    path = Path(HydraConfig.get().runtime.output_dir) / "painting.png"
    write_picture(path, picture.numpy())
    seconds = time.monotonic() - before
    height, width = picture.shape[:2]
    log.info("%s: %d strokes on %d x %d pixels in %.1f s", path, len(saved.strokes), width, height, seconds)
    return {
        "n_strokes": len(saved.strokes),
        "seconds": seconds,
        "seconds_total": time.monotonic() - start,
        "status": "completed",
    }


def renderer_of(saved: Saved) -> Renderer:
    """The renderer that a catalogue was made with: looked up by name, because a file must not name code to run."""
    config = OmegaConf.create(saved.config)
    node = config.get("renderer", {}) if isinstance(config, DictConfig) else {}
    options: dict[str, Any] = {str(key): value for key, value in node.items() if not str(key).startswith("_")}
    renderer: Renderer = build_named("renderer", saved.renderer, options)
    return renderer
