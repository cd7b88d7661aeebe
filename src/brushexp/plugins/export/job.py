"""A saved painting, to be drawn again at any size: what every exporter receives, and how a catalogue is reopened."""

import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import torch
from omegaconf import DictConfig, OmegaConf
from torch import Tensor

from brushexp.compositing.bands import BAND, band_of, bands
from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend, Compositor
from brushexp.plugins.color.base import ColorSpace
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import build, build_named, plain_config, plugin_of
from brushexp.shading.height import heights
from brushexp.shading.light import BOUNDS, UNLIT, Light, normals_of, shaded
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.saved import Saved
from brushexp.system.files import to_bytes
from brushexp.system.progress import with_progress
from brushexp.system.reading import in_short, yaml_of

log = logging.getLogger(__name__)
LARGEST_SIDE_PIXELS = 65_536  # of the longer side of a picture that is written
LARGE = 8 * BAND  # pixels from which painting takes so long that a bar is shown


@dataclass(frozen=True)
class ExportJob:
    """A saved painting at the size in which it is drawn, with everything that draws it."""

    saved: Saved  # strokes have the numbers of the catalogue, because a renderer may choose their look by it
    renderer: Renderer
    blend: Blend
    space: ColorSpace  # in which the blend lays paint over paint
    light: Light = UNLIT  # lamp over the finished paint
    source: str = ""  # file or picture that titles name

    @property
    def strokes(self) -> Strokes:
        """N strokes in pixels of `size`."""
        return self.saved.strokes

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the canvas in pixels."""
        return self.saved.size

    @property
    def bottom_up(self) -> Tensor:
        """Numbers (N,) of the strokes, the bottom one first."""
        return self.saved.depth.argsort()

    def at_most(self, side: int) -> "ExportJob":
        """The same painting with at most ``side`` pixels on its longer side."""
        return self if side >= max(self.size) else self.scaled(side / max(self.size))

    def scaled(self, zoom: float) -> "ExportJob":
        """The same painting ``zoom`` times as large; the strokes are scaled and not the pixels, so it stays crisp."""
        size = (max(1, round(self.size[0] * zoom)), max(1, round(self.size[1] * zoom)))
        return replace(self, saved=replace(self.saved, strokes=self.strokes.moved(zoom=zoom), size=size))

    def picture(self, flat: Tensor | None = None) -> np.ndarray:
        """Paint the picture (H, W, 3) in 8 bits; `bands` explains ``flat``."""
        picture = np.empty((*self.size, 3), dtype=np.uint8)
        for top, band in self.bands(flat):
            picture[top : top + band.shape[1]] = to_bytes(band)
        return picture

    def bands(self, flat: Tensor | None = None) -> Iterator[tuple[int, Tensor]]:
        """Paint from top to bottom, under the light: first row of each band, and its pixels (3, h, W) in [0, 1].

        So a large picture takes little more memory than its pixels. ``replace(job, light=UNLIT)`` paints the colours
        alone; ``flat`` (3, H, W) are these if they are painted already.
        """
        painted = self._lit(flat) if self.light.depth else self._unlit()
        if self.size[0] * self.size[1] < LARGE:
            return painted
        return with_progress(painted, self.size[0], "painting", lambda item: item[1].shape[1])

    def height(self) -> np.ndarray:
        """Height of the paint (H, W), float32, in pixels of the picture, as `heights` defines it."""
        height = np.empty(self.size, np.float32)
        for top, rows, _, band in self._heights():
            height[top : top + rows] = band[top > 0 :][:rows]
        return height

    @property
    def _compositor(self) -> Compositor:
        return Compositor(self.blend, self.space)

    def _heights(self) -> Iterator[tuple[int, int, Tensor, np.ndarray]]:
        return heights(self.strokes, self.bottom_up.flip(0), self.size, self.renderer, self.blend)

    def _unlit(self) -> Iterator[tuple[int, Tensor]]:
        canvas = self.size, self.saved.background
        return bands(self.strokes, self.bottom_up.flip(0), *canvas, self.renderer, self._compositor)

    def _lit(self, flat: Tensor | None) -> Iterator[tuple[int, Tensor]]:
        place, made = self.bottom_up.flip(0).argsort(), (self.saved.background, self.renderer, self._compositor)
        for top, rows, number, height in self._heights():
            if flat is None:
                colors = band_of(self.strokes, place, number, (top, rows, self.size[1]), *made)
            else:
                colors = flat[:, top : top + rows]
            facing = normals_of(height, self.light.depth, slice(int(top > 0), int(top > 0) + rows))
            yield top, torch.from_numpy(shaded(colors.float().cpu().numpy(), facing, self.light))


def export_job(
    saved: Saved, renderer: Renderer | None = None, blend: Blend | None = None, *, resolution: int | None = None,
    source: str = "",
) -> ExportJob:  # fmt: skip
    """Make a saved painting a job: in the colour space and under the lamp that its settings name.

    Args:
        saved: the painting.
        renderer: what draws the strokes; None for the renderer that the painting was made with.
        blend: what lays them over each other; None for ``blend=tiled``.
        resolution: longer side in pixels, ``LARGEST_SIDE_PIXELS`` at most; None for as it was painted.
        source: file or picture that titles name.
    """
    side = resolution or max(saved.size)
    if side > LARGEST_SIDE_PIXELS:
        raise UserError(f"resolution={side} is more than {LARGEST_SIDE_PIXELS} pixels; choose a smaller one")
    renderer = renderer or renderer_of(saved)
    blend = blend or build_named("blend", "tiled", {})
    job = ExportJob(saved, renderer, blend, space_of(saved), light_of(saved), source)
    return job if resolution is None else job.scaled(side / max(saved.size))


def renderer_of(saved: Saved) -> Renderer:
    """Build the renderer that a catalogue was made with by its name, because a file must not name code to run."""
    renderer: Renderer = build_named("renderer", saved.renderer, painted_with(saved)["renderer"])
    return renderer


def with_renderer(saved: Saved, chosen: DictConfig | None, path: str) -> tuple[Saved, Renderer]:
    """Choose the renderer to draw with, and change the catalogue, from ``path``, to one that was painted with it.

    ``chosen`` is the config of a renderer; None chooses the one that the catalogue was made with.
    """
    if chosen is None:
        try:
            name, renderer = saved.renderer, renderer_of(saved)
        except UserError as error:
            raise UserError(
                f"{path} was painted with renderer={saved.renderer}, which cannot be built here: {error}; "
                "or draw it with another one: renderer=analytic"
            ) from error
    else:
        name, renderer = plugin_of(chosen).name, build(chosen)
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


def space_of(saved: Saved) -> ColorSpace:
    """Build the colour space that a catalogue was painted in: a registered one, because a file must not name code."""
    node = painted_with(saved).get("color")
    space: ColorSpace
    if not node:
        space = build_named("color", "rgb", {})
        return space
    if not isinstance(node, dict) or "_target_" not in node or plugin_of(plain_config(node)).family != "color":
        raise UserError(f"color is {in_short(node)} in the config of the catalogue; write color: {{}} there for rgb")
    space = build(plain_config(node))
    return space


def light_of(saved: Saved) -> Light:
    """Read the lamp that a catalogue was painted under; none where its settings do not name one."""
    options = painted_with(saved).get("light") or {}
    if not isinstance(options, dict):
        raise UserError(
            f"light is {in_short(options)} in the config of the catalogue; write light: {{}} there for none"
        )
    lamp = {item.name: options[item.name] for item in fields(Light) if item.name in options}
    for name, value in lamp.items():
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise UserError(f"light.{name} in the config of the catalogue is {in_short(value)}; a number is needed")
        BOUNDS[name].check(f"light.{name}", value)
    return Light(**lamp)


def painted_with(saved: Saved) -> dict[str, Any]:
    """Read the settings that a catalogue was painted with; options of its renderer are under ``renderer``."""
    try:
        settings = yaml_of(saved.config)
        options = settings.get("renderer", {})
        if not isinstance(options, dict):
            raise UserError(f"renderer is {in_short(options)}; write renderer: {{}} there")
        plain_config(options)
    except UserError as error:
        raise UserError(f"the config of the catalogue cannot be read ({error}); mend it, or make it empty") from error
    return {**settings, "renderer": {str(key): value for key, value in options.items() if str(key)[:1] != "_"}}
