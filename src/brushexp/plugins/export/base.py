"""Base class for exporters, which write a painting to files."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from brushexp.compositing.bands import BAND, band_of, bands, cuts, within
from brushexp.plugins.blend.base import Blend, Compositor
from brushexp.plugins.color.base import ColorSpace
from brushexp.plugins.paper.base import Paper, Rows
from brushexp.plugins.renderer.base import Renderer
from brushexp.registry import plugin_of_class
from brushexp.shading.height import heights, surface_height, typical_width
from brushexp.shading.light import UNLIT, Light, normals_of, shade_picture
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.saved import Saved
from brushexp.system.files import to_bytes
from brushexp.system.progress import with_progress

LARGEST_SIDE_PIXELS = 65_536  # limit of the longer side of written pictures
LARGE = 8 * BAND  # smallest number of pixels with a progress bar


@dataclass(frozen=True)
class ExportJob:
    """A saved painting at its export size, with everything needed to draw it."""

    saved: Saved  # strokes keep the order of the catalogue, because a renderer may choose their look by index
    renderer: Renderer
    blend: Blend
    space: ColorSpace  # colour space in which the blend composites
    light: Light = UNLIT  # lamp that lights the finished paint
    source: str = ""  # file or picture named in titles
    paper: Paper | None = None  # paper under the paint; None for a smooth ground

    @property
    def strokes(self) -> Strokes:
        """The N strokes, in pixels of `size`."""
        return self.saved.strokes

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the canvas in pixels."""
        return self.saved.size

    @property
    def bottom_up(self) -> Tensor:
        """Indices (N,) of the strokes, bottom stroke first."""
        return self.saved.depth.argsort()

    @property
    def is_bare(self) -> bool:
        """Return whether the painting consists only of the colours of its strokes, without light and paper."""
        return not self.light.depth and (self.paper is None or self.paper.is_smooth)

    def bare(self) -> "ExportJob":
        """Return the job without light and paper."""
        return replace(self, light=UNLIT, paper=None)

    def at_most(self, side: int) -> "ExportJob":
        """Return the job, scaled down to at most ``side`` pixels on the longer side if it is larger."""
        return self if side >= max(self.size) else self.scaled(side / max(self.size))

    def scaled(self, zoom: float) -> "ExportJob":
        """Return the job scaled by ``zoom``; strokes are scaled, not pixels, so the picture stays sharp."""
        return self.at_size((max(1, round(self.size[0] * zoom)), max(1, round(self.size[1] * zoom))), zoom)

    def at_size(self, size: tuple[int, int], zoom: float | None = None) -> "ExportJob":
        """Return the job at a ``size`` (H, W), with strokes scaled by ``zoom`` or by the ratio of the longer sides."""
        zoom = max(size) / max(self.size) if zoom is None else zoom
        return replace(self, saved=replace(self.saved, strokes=self.strokes.moved(zoom=zoom), size=size))

    def picture(self, flat: Tensor | None = None) -> np.ndarray:
        """Paint the picture (H, W, 3) uint8; for ``flat``, see `bands`."""
        picture = np.empty((*self.size, 3), dtype=np.uint8)
        for top, band in self.bands(flat):
            picture[top : top + band.shape[1]] = to_bytes(band)
        return picture

    def bands(self, flat: Tensor | None = None) -> Iterator[tuple[int, Tensor]]:
        """Paint the lit picture from top to bottom; yield each band's first row and its pixels (3, h, W) in [0, 1].

        This needs little more memory than the pixels of the picture. ``job.bare().bands()`` paints the colours only;
        ``flat`` (3, H, W) holds these colours if they have already been painted.
        """
        if self.light.depth:
            painting = self._shaded_bands(flat)
        elif not self.is_bare:
            parts = cuts(self.strokes, self.size, self.renderer)
            painting = ((top, self.on_paper(Rows(top, rows, self.size), flat)) for top, rows, _ in parts)
        else:
            canvas = self.size, self.saved.background, self.renderer, self.compositor
            painting = bands(self.strokes, self.bottom_up.flip(0), *canvas)
        if self.size[0] * self.size[1] < LARGE:
            return painting
        return with_progress(painting, self.size[0], "drawing", lambda item: item[1].shape[1])

    def alpha(self, top: int = 0, rows: int | None = None) -> np.ndarray | None:
        """Compute alpha (rows, W, 1) uint8, starting at row ``top``; None if the painting is opaque."""
        if self.saved.alpha is None:
            return None
        height, width = self.size
        y = (torch.arange(top, height if rows is None else top + rows) + 0.5) * (2 / height) - 1
        x = (torch.arange(width) + 0.5) * (2 / width) - 1
        places = torch.stack(torch.meshgrid(x, y, indexing="xy"), dim=-1)[None]
        share = self.saved.alpha[None, None] / 255
        return to_bytes(functional.grid_sample(share, places, padding_mode="border", align_corners=False)[0])

    def height(self) -> np.ndarray:
        """Compute the height (H, W) of paint and paper, float32, in pixels of the picture, as `heights` does."""
        height = np.empty(self.size, np.float32)
        for top, rows, band in self._heights():
            height[top : top + rows] = band[top > 0 :][:rows]
        return height

    @property
    def compositor(self) -> Compositor:
        """Compositor that blends in the painting's colour space."""
        return Compositor(self.blend, self.space)

    def _heights(self) -> Iterator[tuple[int, int, np.ndarray]]:
        """Compute the height of the paint as `heights` does, and add the relief of the paper."""
        canvas, typical = (self.size, self.renderer, self.blend), typical_width(self.strokes)
        for top, rows, _, paint in heights(self.strokes, self.bottom_up.flip(0), *canvas):
            wide = Rows(top, rows, self.size).widened(1)
            ground = None if self.paper is None else self.paper.relief(wide).numpy()
            yield top, rows, paint if ground is None else surface_height(paint, ground, typical)

    def _shaded_bands(self, flat: Tensor | None) -> Iterator[tuple[int, Tensor]]:
        for top, rows, height in self._heights():
            colors = self.on_paper(Rows(top, rows, self.size), flat)
            facing = normals_of(height, self.light.depth, slice(int(top > 0), int(top > 0) + rows))
            yield top, torch.from_numpy(shade_picture(colors.float().cpu().numpy(), facing, self.light))

    def on_paper(self, rows: Rows, flat: Tensor | None = None) -> Tensor:
        """Paint rows (3, h, W) on the paper; for ``flat``, see `bands`."""
        wide = rows if self.paper is None else rows.widened(self.paper.margin(self.size))
        colors = self._colors(wide) if flat is None else flat[:, wide.top : wide.top + wide.count]
        if self.paper is None:
            return colors
        covered = self.paper.cover(colors, self.saved.background.to(colors), wide)
        return covered[:, rows.top - wide.top :][:, : rows.count].clamp(0, 1)

    def _colors(self, rows: Rows) -> Tensor:
        place, reached = self._places
        number = torch.arange(len(place)) if reached is None else within(reached, rows.top, rows.count)
        band, canvas = (rows.top, rows.count, self.size[1]), (self.saved.background, self.renderer, self.compositor)
        return band_of(self.strokes, place, number, band, *canvas)

    @cached_property
    def _places(self) -> tuple[Tensor, Tensor | None]:
        """Compute each stroke's rank (N,), 0 for the top stroke, and the rows (N, 2) that it may touch, if known."""
        return self.bottom_up.flip(0).argsort(), self.renderer.rows(self.strokes)


class Exporter(ABC):
    """Writes a painting in a format for other programs.

    >>> class Sizes(Exporter):
    ...     def write(self, job: ExportJob, folder: Path) -> list[Path]:
    ...         (folder / "size.txt").write_text("{} x {}, {} strokes".format(*job.size, len(job.strokes)))
    ...         return [folder / "size.txt"]
    >>> from tempfile import TemporaryDirectory
    >>> from brushexp.registry import build_named
    >>> from brushexp.strokes.prior import sample_prior
    >>> saved = Saved(sample_prior(3), torch.arange(3, dtype=torch.int32), (24, 32), torch.ones(3), "analytic")
    >>> parts = [build_named(*part, {}) for part in (("renderer", "analytic"), ("blend", "tiled"), ("color", "rgb"))]
    >>> job = ExportJob(saved, *parts)
    >>> with TemporaryDirectory() as folder:
    ...     Sizes().write(job, Path(folder))[0].read_text()
    '24 x 32, 3 strokes'
    >>> [(top, tuple(band.shape)) for top, band in job.bands()]
    [(0, (3, 24, 32))]
    """

    @property
    def key(self) -> str:
        """Key of the exporter's options on the command line: ``to.`` and the registered name."""
        plugin = plugin_of_class(type(self))
        return "to" if plugin is None else plugin.path

    def check(self, count: int, size: tuple[int, int]) -> None:  # noqa: B027  (most hold anything)
        """Raise a UserError if the format cannot hold ``count`` strokes on a canvas of ``size`` (H, W)."""

    @abstractmethod
    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        """Write one or more files into ``folder`` and return their paths, main file first.

        It must not write any other files or change the job, and the same job must produce the same bytes (for a video,
        the same frames). It must also accept a painting without strokes. If the format cannot represent a painting, it
        raises a UserError that explains why.
        """
