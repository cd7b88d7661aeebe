"""Reopen a catalogue, and draw the saved painting again at any size."""

import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from omegaconf import DictConfig, OmegaConf
from torch import Tensor
from torch.nn import functional

from brushexp.compositing.bands import BAND, band_of, bands, cuts, within
from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend, Compositor
from brushexp.plugins.color.base import ColorSpace
from brushexp.plugins.paper.base import Paper, Rows
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import build, build_named, plain_config, plugin_of
from brushexp.shading.height import heights
from brushexp.shading.light import BOUNDS, UNLIT, Light, normals_of, shade_picture
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.saved import Saved
from brushexp.system.earlier import todays_settings
from brushexp.system.files import to_bytes
from brushexp.system.progress import with_progress
from brushexp.system.reading import in_short, yaml_of

log = logging.getLogger(__name__)
LARGEST_SIDE_PIXELS = 65_536  # no picture that is written has a longer side
LARGE = 8 * BAND  # pixels from which painting shows a progress bar


@dataclass(frozen=True)
class ExportJob:
    """A saved painting at the size in which it is drawn, with everything that draws it."""

    saved: Saved  # strokes have the numbers of the catalogue, because a renderer may choose their look by it
    renderer: Renderer
    blend: Blend
    space: ColorSpace  # the blend lays paint over paint in it
    light: Light = UNLIT  # lamp over the finished paint
    source: str = ""  # file or picture that titles name
    paper: Paper | None = None  # what the paint lies on; None for a smooth ground

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

    @property
    def is_bare(self) -> bool:
        """Whether the painting is nothing but the colours of its strokes, without light and paper."""
        return not self.light.depth and (self.paper is None or self.paper.is_smooth)

    def bare(self) -> "ExportJob":
        """Take light and paper away, so that the colours of the strokes remain."""
        return replace(self, light=UNLIT, paper=None)

    def at_most(self, side: int) -> "ExportJob":
        """Shrink the painting to at most ``side`` pixels on its longer side."""
        return self if side >= max(self.size) else self.scaled(side / max(self.size))

    def scaled(self, zoom: float) -> "ExportJob":
        """Scale strokes, not pixels, by ``zoom``, so that the painting stays crisp."""
        size = (max(1, round(self.size[0] * zoom)), max(1, round(self.size[1] * zoom)))
        return replace(self, saved=replace(self.saved, strokes=self.strokes.moved(zoom=zoom), size=size))

    def picture(self, flat: Tensor | None = None) -> np.ndarray:
        """Paint the picture (H, W, 3) in 8 bits; `bands` explains ``flat``."""
        picture = np.empty((*self.size, 3), dtype=np.uint8)
        for top, band in self.bands(flat):
            picture[top : top + band.shape[1]] = to_bytes(band)
        return picture

    def bands(self, flat: Tensor | None = None) -> Iterator[tuple[int, Tensor]]:
        """Paint from top to bottom, in its light: first row of each band, and its pixels (3, h, W) in [0, 1].

        So a large picture takes little more memory than its pixels. ``job.bare()`` paints the colours alone; ``flat``
        (3, H, W) are these if they are painted already.
        """
        if self.light.depth:
            painting = self._lit(flat)
        elif not self.is_bare:
            parts = cuts(self.strokes, self.size, self.renderer)
            painting = ((top, self.on_paper(Rows(top, rows, self.size), flat)) for top, rows, _ in parts)
        else:
            canvas = self.size, self.saved.background, self.renderer, self._compositor
            painting = bands(self.strokes, self.bottom_up.flip(0), *canvas)
        if self.size[0] * self.size[1] < LARGE:
            return painting
        return with_progress(painting, self.size[0], "painting", lambda item: item[1].shape[1])

    def alpha(self, top: int = 0, rows: int | None = None) -> np.ndarray | None:
        """Compute how much of the painting is kept (rows, W, 1) uint8, from row ``top`` on; None for all of it."""
        if self.saved.alpha is None:
            return None
        height, width = self.size
        y = (torch.arange(top, height if rows is None else top + rows) + 0.5) * (2 / height) - 1
        x = (torch.arange(width) + 0.5) * (2 / width) - 1
        places = torch.stack(torch.meshgrid(x, y, indexing="xy"), dim=-1)[None]
        share = self.saved.alpha[None, None] / 255
        return to_bytes(functional.grid_sample(share, places, padding_mode="border", align_corners=False)[0])

    def height(self) -> np.ndarray:
        """Compute the height of paint and paper (H, W), float32, in pixels of the picture, as `heights` does."""
        height = np.empty(self.size, np.float32)
        for top, rows, band in self._heights():
            height[top : top + rows] = band[top > 0 :][:rows]
        return height

    @property
    def _compositor(self) -> Compositor:
        return Compositor(self.blend, self.space)

    def _heights(self) -> Iterator[tuple[int, int, np.ndarray]]:
        """Compute heights as `heights` does, on the paper."""
        canvas = self.size, self.renderer, self.blend
        for top, rows, _, paint in heights(self.strokes, self.bottom_up.flip(0), *canvas):
            wide = Rows(top, rows, self.size).widened(1)
            yield top, rows, paint if self.paper is None else paint + self.paper.relief(wide).numpy()

    def _lit(self, flat: Tensor | None) -> Iterator[tuple[int, Tensor]]:
        for top, rows, height in self._heights():
            colors = self.on_paper(Rows(top, rows, self.size), flat)
            facing = normals_of(height, self.light.depth, slice(int(top > 0), int(top > 0) + rows))
            yield top, torch.from_numpy(shade_picture(colors.float().cpu().numpy(), facing, self.light))

    def on_paper(self, rows: Rows, flat: Tensor | None = None) -> Tensor:
        """Paint rows on the paper: pixels (3, h, W); `bands` explains ``flat``."""
        wide = rows if self.paper is None else rows.widened(self.paper.margin(self.size))
        colors = self._colors(wide) if flat is None else flat[:, wide.top : wide.top + wide.count]
        if self.paper is None:
            return colors
        covered = self.paper.cover(colors, self.saved.background.to(colors), wide)
        return covered[:, rows.top - wide.top :][:, : rows.count].clamp(0, 1)

    def _colors(self, rows: Rows) -> Tensor:
        place, reached = self._places
        number = torch.arange(len(place)) if reached is None else within(reached, rows.top, rows.count)
        band, canvas = (rows.top, rows.count, self.size[1]), (self.saved.background, self.renderer, self._compositor)
        return band_of(self.strokes, place, number, band, *canvas)

    @cached_property
    def _places(self) -> tuple[Tensor, Tensor | None]:
        """Compute the place (N,) of each stroke, 0 for the top one, and the rows (N, 2) that it may touch, if known."""
        return self.bottom_up.flip(0).argsort(), self.renderer.rows(self.strokes)


def export_job(
    saved: Saved, renderer: Renderer | None = None, blend: Blend | None = None, *, resolution: int | None = None,
    source: str = "",
) -> ExportJob:  # fmt: skip
    """Make a job of a saved painting, in the colour space, on the paper and under the lamp that its settings name.

    Without ``renderer``, ``blend`` and ``resolution`` (pixels of the longer side) it has the renderer and the size that
    it was painted with, and ``blend=tiled``; titles name ``source``, a file or picture.
    """
    side = resolution or max(saved.size)
    if side > LARGEST_SIDE_PIXELS:
        raise UserError(f"resolution={side} is more than {LARGEST_SIDE_PIXELS} pixels; choose a smaller one")
    parts = renderer or renderer_of(saved), blend or build_named("blend", "tiled", {}), space_of(saved)
    job = ExportJob(saved, *parts, light_of(saved), source, _member_of(saved, "paper"))
    return job if resolution is None else job.scaled(side / max(saved.size))


def renderer_of(saved: Saved) -> Renderer:
    """Build the renderer that a catalogue was made with by its name, because a file must not name code to run."""
    return build_named("renderer", saved.renderer, recorded_settings(saved)["renderer"])


def with_renderer(saved: Saved, chosen: DictConfig | None, path: str) -> tuple[Saved, Renderer]:
    """Build the ``chosen`` renderer, or that of the catalogue at ``path``, and make it that of the catalogue."""
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
    settings = recorded_settings(saved) | {"renderer": OmegaConf.to_container(chosen, resolve=True)}
    config = OmegaConf.to_yaml(OmegaConf.create(settings))
    return replace(saved, renderer=name, renderer_hash=renderer.weights_hash, config=config), renderer


def space_of(saved: Saved) -> ColorSpace:
    """Build the colour space that a catalogue was painted in."""
    return _member_of(saved, "color") or build_named("color", "rgb", {})


def _member_of(saved: Saved, family: str) -> Any:
    """Build the member of a family that a catalogue names: a registered one, because a file must not name code."""
    node = recorded_settings(saved).get(family)
    if not node:
        return None
    if not isinstance(node, dict) or "_target_" not in node or plugin_of(plain_config(node)).family != family:
        cure = f"write {family}: {{}} there for that of old catalogues"
        raise UserError(f"{family} is {in_short(node)} in the config of the catalogue; {cure}")
    return build(plain_config(node))


def light_of(saved: Saved) -> Light:
    """Read the lamp that a catalogue was painted under; none where its settings do not name one."""
    options = recorded_settings(saved).get("light") or {}
    if not isinstance(options, dict):
        raise UserError(f"light is {in_short(options)} in the config of the catalogue; write light: {{}} for none")
    lamp = {item.name: options[item.name] for item in fields(Light) if item.name in options}
    for name, value in lamp.items():
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise UserError(f"light.{name} in the config of the catalogue is {in_short(value)}; a number is needed")
        BOUNDS[name].check(f"light.{name}", value)
    return Light(**lamp)


def recorded_settings(saved: Saved) -> dict[str, Any]:
    """Read the settings that a catalogue was painted with; options of its renderer are under ``renderer``."""
    try:
        settings = todays_settings(yaml_of(saved.config))
        options = settings.get("renderer", {})
        if not isinstance(options, dict):
            raise UserError(f"renderer is {in_short(options)}; write renderer: {{}} there")
        plain_config(options)
    except UserError as error:
        raise UserError(f"the config of the catalogue cannot be read ({error}); mend it, or make it empty") from error
    return {**settings, "renderer": {str(key): value for key, value in options.items() if str(key)[:1] != "_"}}
