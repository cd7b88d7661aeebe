"""What every exporter receives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from brushexp.compositing.bands import BAND, band_of, bands
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.renderer.base import Renderer
from brushexp.shading.height import heights
from brushexp.shading.light import UNLIT, Light, normals_of, shaded
from brushexp.strokes.catalogue import Strokes
from brushexp.system.progress import with_progress

if TYPE_CHECKING:
    from brushexp.plugins.export._sprites import Sprites

LARGEST_SIDE_PIXELS = 65_536  # of the longer side of a picture that is written
LARGE = 8 * BAND  # pixels from which painting takes so long that a bar is shown


@dataclass(frozen=True)
class ExportJob:
    """A finished painting, at the size in which it is wanted."""

    strokes: Strokes  # N, in pixels of ``size``, numbered as in the catalogue: a renderer may tell them apart by it
    depth: Tensor  # (N,) int32 ranks, 0 is the bottom stroke
    size: tuple[int, int]  # height and width of the canvas, pixels
    background: Tensor  # (3,) RGB of the bare canvas, in [0, 1]
    renderer: Renderer
    blend: Blend
    name: str  # of the renderer
    source: str  # where the catalogue came from, for titles
    seed: int = 0  # of the run that painted it
    config: str = ""  # of that run, YAML: text to show, never to run
    light: Light = UNLIT  # over the finished paint

    @property
    def bottom_up(self) -> Tensor:
        """Numbers (N,) of the strokes, the bottom one first."""
        return self.depth.argsort()

    @cached_property
    def sprites(self) -> Sprites:
        """Each stroke by itself, drawn when it is first asked for, see `sprites_of`."""
        from brushexp.plugins.export._sprites import sprites_of  # noqa: PLC0415  (it draws jobs)

        return sprites_of(self)

    @cached_property
    def pictures(self) -> tuple[np.ndarray, np.ndarray]:
        """The picture without its light and in it, (H, W, 3) uint8; drawn when they are first asked for."""
        from brushexp.plugins.export.png import pixels  # noqa: PLC0415  (it draws jobs)

        return pixels(replace(self, light=UNLIT)), pixels(self)

    def at_most(self, side: int) -> ExportJob:
        """The same painting with at most ``side`` pixels on its longer side."""
        return self if side >= max(self.size) else self.scaled(side / max(self.size))

    def scaled(self, zoom: float) -> ExportJob:
        """The same painting ``zoom`` times as large."""
        size = (max(1, round(self.size[0] * zoom)), max(1, round(self.size[1] * zoom)))
        return replace(self, strokes=self.strokes.moved(zoom=zoom), size=size)

    def bands(self, flat: Tensor | None = None) -> Iterator[tuple[int, Tensor]]:
        """The picture from top to bottom, under its light: first row of each band, and its pixels (3, h, W) in [0, 1].

        ``replace(job, light=UNLIT)`` has the colours alone; ``flat`` (3, H, W) are these if they are known.
        """
        found = self._lit(flat) if self.light.depth else self._flat()
        if self.size[0] * self.size[1] < LARGE:
            return found
        return with_progress(found, self.size[0], "painting", lambda item: item[1].shape[1])

    def height(self) -> np.ndarray:
        """Height of the paint (H, W), float32, in pixels of the picture, see `heights`."""
        height = np.empty(self.size, np.float32)
        for top, rows, _, band in self._heights():
            height[top : top + rows] = band[top > 0 :][:rows]
        return height

    def _heights(self) -> Iterator[tuple[int, int, Tensor, np.ndarray]]:
        return heights(self.strokes, self.bottom_up.flip(0), self.size, self.renderer, self.blend)

    def _flat(self) -> Iterator[tuple[int, Tensor]]:
        above = self.bottom_up.flip(0)
        return bands(self.strokes, above, self.size, self.background, self.renderer, self.blend)

    def _lit(self, known: Tensor | None) -> Iterator[tuple[int, Tensor]]:
        place = self.bottom_up.flip(0).argsort()
        for top, rows, number, height in self._heights():
            if known is None:
                band = (top, rows, self.size[1])
                flat = band_of(self.strokes, place, number, band, self.background, self.renderer, self.blend)
            else:
                flat = known[:, top : top + rows]
            facing = normals_of(height, self.light.depth, slice(int(top > 0), int(top > 0) + rows))
            yield top, torch.from_numpy(shaded(flat.float().cpu().numpy(), facing, self.light))


class Exporter(ABC):
    """Writes a painting in a form that other programs read.

    >>> class Sizes(Exporter):
    ...     def write(self, job: ExportJob, folder: Path) -> list[Path]:
    ...         (folder / "size.txt").write_text("{} x {}, {} strokes".format(*job.size, len(job.strokes)))
    ...         return [folder / "size.txt"]
    >>> import torch
    >>> from tempfile import TemporaryDirectory
    >>> from brushexp.plugins.blend.dense import Dense
    >>> from brushexp.plugins.renderer.analytic import Analytic
    >>> from brushexp.strokes.prior import sample_prior
    >>> strokes, depth = sample_prior(3), torch.arange(3, dtype=torch.int32)
    >>> job = ExportJob(strokes, depth, (24, 32), torch.ones(3), Analytic(), Dense(), name="analytic", source="")
    >>> with TemporaryDirectory() as folder:
    ...     Sizes().write(job, Path(folder))[0].read_text()
    '24 x 32, 3 strokes'
    >>> [(top, tuple(band.shape)) for top, band in job.bands()]
    [(0, (3, 24, 32))]
    """

    @property
    def key(self) -> str:
        """What the user types before an option."""
        return f"to.{type(self).__name__.lower()}"

    def check(self, count: int, size: tuple[int, int]) -> None:  # noqa: B027  (most hold anything)
        """Refuse (UserError) ``count`` strokes on a canvas of ``size`` (H, W) if it cannot hold them."""

    @abstractmethod
    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        """Write one or more files into ``folder`` and return their paths, the main one first.

        Nothing else is written, the job stays as it is, and the same job gives the same bytes (of a video, the same
        pictures). A painting without strokes is written, too; a UserError says why one cannot be written in this form.
        """
