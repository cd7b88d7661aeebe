"""What every exporter receives."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor

from brushexp.blend.bands import bands
from brushexp.blend.base import Blend
from brushexp.renderer.base import Renderer
from brushexp.strokes.catalogue import Strokes


@dataclass(frozen=True)
class Work:
    """A finished painting, at the size in which it is wanted.

    Attributes:
        strokes: N strokes in pixels of ``size``, numbered as in the catalogue: a renderer may tell them apart by it.
        depth: (N,) int32 ranks, 0 is the bottom stroke.
        size: height and width of the canvas, pixels.
        background: (3,) RGB of the bare canvas, in [0, 1].
        renderer: draws the strokes.
        blend: lays them over each other.
        name: the name of the renderer; vector formats hold plain strokes, whatever it is.
        source: where the catalogue came from, for titles.
    """

    strokes: Strokes
    depth: Tensor
    size: tuple[int, int]
    background: Tensor
    renderer: Renderer
    blend: Blend
    name: str
    source: str

    @property
    def bottom_up(self) -> Tensor:
        """Numbers (N,) of the strokes, the bottom one first."""
        return self.depth.argsort()

    def bands(self) -> Iterator[tuple[int, Tensor]]:
        """The picture from top to bottom: first row of each band, and its pixels (3, h, W) in [0, 1]."""
        above = self.bottom_up.flip(0)
        return bands(self.strokes, above, self.size, self.background, self.renderer, self.blend)


class Exporter(ABC):
    """Writes a painting in a form that other programs read."""

    @abstractmethod
    def write(self, work: Work, folder: Path) -> list[Path]:
        """Write one or more files into ``folder`` and return their paths, the main one first.

        Raises:
            UserError: if this painting cannot be written in this form.
        """
