"""What a finished painting leaves in its folder."""

import logging
import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from brushexp.compositing.mixing import mixing
from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.color.base import ColorSpace
from brushexp.plugins.color.rgb import Rgb
from brushexp.plugins.export.base import LARGEST_SIDE_PIXELS, ExportJob
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import build, build_named, plain_config, plugin_of
from brushexp.shading.light import BOUNDS, Light
from brushexp.strokes.storage import Saved
from brushexp.system.reading import in_short, yaml_of

log = logging.getLogger(__name__)


def renderer_of(saved: Saved) -> Renderer:
    """The renderer that a catalogue was made with: looked up by name, because a file must not name code to run."""
    return build_named("renderer", saved.renderer, painted_with(saved)["renderer"])


def space_of(saved: Saved) -> ColorSpace:
    """The colour space that a catalogue was painted in: a registered one, because a file must not name code to run."""
    node = painted_with(saved).get("color", {})
    if not node:
        return Rgb()
    if not isinstance(node, dict) or "_target_" not in node or plugin_of(plain_config(node)).family != "color":
        raise UserError(f"color is {in_short(node)} in the config of the catalogue; write color: {{}} there for rgb")
    space: ColorSpace = build(plain_config(node))
    return space


def painted_with(saved: Saved) -> dict[str, Any]:
    """The settings that a catalogue was painted with; options of its renderer are under ``renderer``."""
    try:
        settings = yaml_of(saved.config)
        options = settings.get("renderer", {})
        if not isinstance(options, dict):
            raise UserError(f"renderer is {in_short(options)}; write renderer: {{}} there")
        plain_config(options)
    except UserError as error:
        raise UserError(f"the config of the catalogue cannot be read ({error}); mend it, or make it empty") from error
    options = {str(key): value for key, value in options.items() if not str(key).startswith("_")}
    return {**settings, "renderer": options}


def light_of(saved: Saved) -> Light:
    """The lamp that a catalogue was painted under; none where its settings do not name one."""
    given = painted_with(saved).get("light") or {}
    if not isinstance(given, dict):
        raise UserError(f"light is {in_short(given)} in the config of the catalogue; write light: {{}} there for none")
    known = {item.name: given[item.name] for item in fields(Light) if item.name in given}
    for name, value in known.items():
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise UserError(f"light.{name} in the config of the catalogue is {in_short(value)}; a number is needed")
        BOUNDS[name].check(f"light.{name}", value)
    return Light(**known)


def with_renderer(saved: Saved, chosen: DictConfig | None, path: str) -> tuple[Saved, Renderer]:
    """The renderer to draw with, and the catalogue, from ``path``, as if it had been painted with it.

    ``chosen`` is the config of a renderer; None for the one that the catalogue was made with.
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
    settings = painted_with(saved) | {"renderer": OmegaConf.to_container(chosen, resolve=True)}
    config = OmegaConf.to_yaml(OmegaConf.create(settings))
    return replace(saved, renderer=name, renderer_hash=renderer.weights_hash, config=config), renderer


def export_job(
    saved: Saved, renderer: Renderer, blend: Blend, name: str, resolution: int | None = None, source: str = ""
) -> ExportJob:
    """A catalogue, from ``source``, as exporters take it; ``name`` is that of the renderer.

    Its paint is mixed in the colour space that it was painted in. It is crisp at any size: the strokes are scaled, not
    the picture. ``resolution`` is the longer side in pixels, ``LARGEST_SIDE_PIXELS`` at most; None means as it was
    painted.
    """
    side = resolution or max(saved.size)
    if side > LARGEST_SIDE_PIXELS:
        raise UserError(f"resolution={side} is more than {LARGEST_SIDE_PIXELS} pixels; choose a smaller one")
    blend, painting = mixing(blend, space_of(saved)), (saved.strokes, saved.depth, saved.size, saved.background)
    job = ExportJob(*painting, renderer, blend, name, source, saved.seed, saved.config, light_of(saved))
    return job.scaled(side / max(saved.size))


def summary_line(folder: Path, metrics: dict[str, object]) -> str:
    """One line per result: where the painting is, of how many strokes, how long it took, how near it is."""
    psnr, ssim, seconds = metrics["psnr"], metrics.get("ssim"), metrics["seconds"]
    quality = f"{psnr:.2f} dB" if isinstance(psnr, float) and math.isfinite(psnr) else "identical to the target"
    if "psnr_lit" in metrics:
        quality += f" ({metrics['psnr_lit']:.2f} dB in the light)"
    if ssim is not None:
        quality += f", SSIM {ssim:.3f}"
    strokes = f"{metrics['n_strokes']} strokes in {seconds:.1f} s"
    total = "" if metrics["seconds_total"] is None else f" ({metrics['seconds_total']:.1f} s in all)"
    return f"{folder / 'painting.png'}: {strokes}{total}, {quality}"
