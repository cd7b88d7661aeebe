"""What a finished painting leaves in its folder."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml  # type: ignore[import-untyped,unused-ignore]
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.export.base import ExportJob
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import build, build_named, plugin_of
from brushexp.strokes.storage import Saved

log = logging.getLogger(__name__)
LARGEST_SIDE_PIXELS = 65_536  # of the longer side of a picture that is written


def renderer_of(saved: Saved) -> Renderer:
    """The renderer that a catalogue was made with: looked up by name, because a file must not name code to run."""
    try:
        node = config_of(saved).get("renderer", {})
        if not isinstance(node, Mapping | DictConfig):
            raise UserError(f"renderer is {str(node)!r} in the config of the catalogue; write renderer: {{}} there")
        options: dict[str, Any] = {str(key): value for key, value in node.items() if not str(key).startswith("_")}
    except OmegaConfBaseException as error:  # ${...} that stands for nothing
        raise _not_settings(error) from error
    renderer: Renderer = build_named("renderer", saved.renderer, options)
    return renderer


def config_of(saved: Saved) -> DictConfig:
    """The settings that a catalogue was painted with.

    Raises:
        UserError: if they are not what a run writes.
    """
    try:
        return DictConfig(OmegaConf.create(saved.config))
    except (yaml.YAMLError, OmegaConfBaseException, ValueError) as error:
        raise _not_settings(error) from error


def _not_settings(error: Exception) -> UserError:
    reason = " ".join(str(error).split())
    return UserError(f"the config of the catalogue cannot be read ({reason}); mend it, or make it empty")


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


def export_job(
    saved: Saved, renderer: Renderer, blend: Blend, name: str, resolution: int | None = None, source: str = ""
) -> ExportJob:
    """A catalogue as exporters take it, crisp at any size: the strokes are scaled, not the picture.

    Args:
        saved: the catalogue.
        renderer: draws its strokes.
        blend: lays them over each other.
        name: of the renderer.
        resolution: longer side in pixels; None means as it was painted.
        source: where the catalogue came from.

    Raises:
        UserError: if the picture would have more than ``LARGEST_SIDE_PIXELS`` pixels on a side.
    """
    height, width = saved.size
    resolution = resolution or max(height, width)
    if resolution > LARGEST_SIDE_PIXELS:
        raise UserError(f"resolution={resolution} is more than {LARGEST_SIDE_PIXELS} pixels; choose a smaller one")
    zoom = resolution / max(height, width)
    size = (max(1, round(height * zoom)), max(1, round(width * zoom)))
    strokes = saved.strokes.moved(zoom=zoom)
    made = (saved.seed, saved.config)
    return ExportJob(strokes, saved.depth, size, saved.background, renderer, blend, name, source, *made)


def summary_line(folder: Path, metrics: dict[str, object]) -> str:
    """One line per result: where the painting is, how good, how long."""
    psnr, ssim, seconds = metrics["psnr"], metrics["ssim"], metrics["seconds"]
    quality = f"{psnr:.2f} dB" if isinstance(psnr, float) and math.isfinite(psnr) else "identical to the target"
    if ssim is not None:
        quality += f", SSIM {ssim:.3f}"
    strokes = f"{metrics['n_strokes']} strokes in {seconds:.1f} s"
    return f"{folder / 'painting.png'}: {quality}, {strokes} ({metrics['seconds_total']:.1f} s in all)"
