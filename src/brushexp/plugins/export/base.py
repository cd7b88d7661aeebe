"""What every exporter receives."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor

from brushexp.compositing.bands import BAND, bands
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.renderer.base import Renderer
from brushexp.strokes.catalogue import Strokes
from brushexp.system.progress import with_progress

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

    @property
    def bottom_up(self) -> Tensor:
        """Numbers (N,) of the strokes, the bottom one first."""
        return self.depth.argsort()

    def bands(self) -> Iterator[tuple[int, Tensor]]:
        """The picture from top to bottom: first row of each band, and its pixels (3, h, W) in [0, 1]."""
        above = self.bottom_up.flip(0)
        found = bands(self.strokes, above, self.size, self.background, self.renderer, self.blend)
        if self.size[0] * self.size[1] < LARGE:
            return found
        return with_progress(found, self.size[0], "painting", lambda item: item[1].shape[1])


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

    @abstractmethod
    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        """Write one or more files into ``folder`` and return their paths, the main one first.

        Nothing else is written, the job stays as it is, and the same job gives the same bytes (of a video, the same
        pictures). A painting without strokes is written, too; a UserError says why one cannot be written in this form.
        """
