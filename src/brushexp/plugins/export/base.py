"""What every exporter receives."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from torch import Tensor

from brushexp.compositing.bands import BAND, bands
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.renderer.base import Renderer
from brushexp.strokes.catalogue import Strokes

LARGE = 8 * BAND  # pixels from which painting takes so long that a bar is shown
Item = TypeVar("Item")


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
        seed: of the run that painted it.
        config: its settings as YAML: text to show, never to run.
    """

    strokes: Strokes
    depth: Tensor
    size: tuple[int, int]
    background: Tensor
    renderer: Renderer
    blend: Blend
    name: str
    source: str
    seed: int = 0
    config: str = ""

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
        return counted(found, self.size[0], "painting", lambda item: item[1].shape[1])


class Exporter(ABC):
    """Writes a painting in a form that other programs read."""

    @abstractmethod
    def write(self, work: Work, folder: Path) -> list[Path]:
        """Write one or more files into ``folder`` and return their paths, the main one first.

        Nothing else is written, the work stays as it is, and the same work gives the same bytes. A painting without
        strokes is written, too, unless that has no meaning in this form.

        Raises:
            UserError: if this painting cannot be written in this form.
        """


def counted(
    items: Iterable[Item], total: int, what: str, size: Callable[[Item], int] = lambda item: 1
) -> Iterator[Item]:
    """Pass items on, with a bar on the terminal; nothing where there is none.

    Args:
        items: what takes long.
        total: their sizes together.
        what: is being done.
        size: of one of them.
    """
    from rich.console import Console  # noqa: PLC0415  (--help should not wait for it)
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("left"))
    with Progress(
        *columns, TimeRemainingColumn(), console=console, disable=not console.is_terminal, transient=True
    ) as bar:
        task = bar.add_task(what, total=total)
        for item in items:
            yield item
            bar.advance(task, size(item))
