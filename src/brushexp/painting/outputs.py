"""What a finished painting leaves in its folder."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml  # type: ignore[import-untyped,unused-ignore]
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.export.base import ExportJob
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import build_named
from brushexp.strokes.storage import Saved

LARGEST = 65_536  # pixels of the longer side


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
        UserError: if the picture would have more than ``LARGEST`` pixels on a side.
    """
    height, width = saved.size
    resolution = resolution or max(height, width)
    if resolution > LARGEST:
        raise UserError(f"resolution={resolution} is more than {LARGEST} pixels; choose a smaller one")
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
