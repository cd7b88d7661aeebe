"""How a painting is drawn with pens: the options that the exporters share, and where it lies on the paper."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from types import ModuleType
from typing import Annotated

import numpy as np

from brushexp.bounds import between
from brushexp.errors import UserError

Array = np.ndarray
Colors = Annotated[int, between(1, 64)]
Layers = Annotated[int, between(1, 10_000)]
Margin = Annotated[float, between(0, 1000)]
Passes = Annotated[int, between(1, 2000)]
PenWidth = Annotated[float, between(0.05, 500)]
PictureWidth = Annotated[float, between(0.1, 100_000)]
Tolerance = Annotated[float, between(0.001, 10)]


class Hidden(Enum):
    """What becomes of strokes that lie below others."""

    cut = "cut"
    skip = "skip"
    draw = "draw"


@dataclass(frozen=True)
class PenOptions:
    """How a painting is drawn with pens. The exporters say what their options mean.

    Attributes:
        name: of the exporter, for messages.
        reach: margins in mm that the machine needs, if it has any.
    """

    name: str
    paper: str
    landscape: bool | None
    margin_mm: float
    width_mm: float | None
    colors: int
    pens: list[str] | None
    layers: int
    pen_mm: float
    passes: int | None
    hidden: Hidden
    tolerance_mm: float
    reach: float = 0.0

    def __post_init__(self) -> None:
        self.room((1, 1))
        self.own_pens  # noqa: B018  (refused before anything is drawn)

    @cached_property
    def page(self) -> tuple[float, float]:
        """Shorter and longer side of the paper, mm."""
        vpype = load_vpype()
        names = sorted(name for name, (short, _) in vpype.PAGE_SIZES.items() if short > 0)
        text = self.paper.lower()
        try:
            has_units = text in names or any(letter.isalpha() for letter in text.replace("x", ""))
            sides = sorted(side / vpype.UNITS["mm"] for side in vpype.convert_page_size(text)) if has_units else [0.0]
        except ValueError:
            sides = [0.0]
        if not 1 <= sides[0] <= sides[-1] <= 100_000:
            raise UserError(
                f"to.{self.name}.paper={self.paper} is not a paper; choose one of {', '.join(names)}, "
                f"or a size such as to.{self.name}.paper=300x200mm"
            )
        return round(sides[0], 6), round(sides[1], 6)

    @cached_property
    def own_pens(self) -> Array | None:
        """Colours (K, 3) in [0, 1] of the pens that the user has; None if any colour can be had."""
        from PIL import ImageColor  # noqa: PLC0415  (only where there are pens)

        if self.pens is None:
            return None
        option = f"to.{self.name}.pens"
        if not 1 <= len(self.pens) <= 256:
            raise UserError(f"{option} has {len(self.pens)} pens; give at least one colour, {option}=[black]")
        found = []
        for pen in self.pens:
            try:
                found.append(ImageColor.getrgb(pen)[:3])
            except ValueError:
                raise UserError(
                    f"{option} has {pen!r}, which is no colour; write '{option}=[black,\"#c03020\"]'"
                ) from None
        return np.array(found) / 255

    def room(self, size: tuple[int, int]) -> tuple[tuple[float, float], float]:
        """Width and height of the paper as it lies, and the most mm per pixel that a picture can have on it.

        Args:
            size: height and width of the picture, pixels.
        """
        margin = max(self.margin_mm, self.reach)
        upright, across = (self.page, self.page[::-1])
        papers = {None: (upright, across), False: (upright,), True: (across,)}[self.landscape]
        rooms = [min((width - 2 * margin) / size[1], (height - 2 * margin) / size[0]) for width, height in papers]
        best = max(range(len(rooms)), key=lambda k: (round(rooms[k], 9), -k))
        if rooms[best] <= 0:
            raise UserError(
                f"margins of {margin:g} mm leave nothing of {upright[0]:g} x {upright[1]:g} mm; choose a larger paper, "
                f"to.{self.name}.paper=a3, or smaller margins, to.{self.name}.margin_mm=5"
            )
        return papers[best], rooms[best]

    def frame(self, size: tuple[int, int]) -> tuple[tuple[float, float], Array, float]:
        """Width and height of the paper, the picture's upper left corner (2,) in its middle, and mm per pixel."""
        paper, scale = self.room(size)
        if self.width_mm is not None:
            widest = scale * size[1]
            if self.width_mm > widest * (1 + 1e-9):
                raise UserError(
                    f"to.{self.name}.width_mm={self.width_mm:g} is too wide for {paper[0]:g} x {paper[1]:g} mm and its "
                    f"margins; try to.{self.name}.width_mm={np.floor(10 * widest) / 10:g}"
                )
            scale = self.width_mm / size[1]
        return paper, (np.array(paper) - scale * np.array(size[::-1])) / 2, scale


def load_vpype() -> ModuleType:
    """The library vpype, which is optional and slow to import.

    Raises:
        UserError: if it is not installed.
    """
    try:
        with quiet_vpype():
            import vpype  # noqa: PLC0415
            import vpype_cli  # noqa: F401, PLC0415
    except ImportError as error:
        raise UserError("to=hpgl and to=gcode need vpype, which is not here; pip install -e '.[plot]'") from error
    return vpype


def millimetre() -> float:
    """A millimetre in vpype's unit."""
    return float(load_vpype().UNITS["mm"])


@contextmanager
def quiet_vpype() -> Iterator[None]:
    """Keep out of our log what vpype says to the root logger."""
    root = logging.getLogger()

    def not_of_vpype(record: logging.LogRecord) -> bool:
        return "vpype" not in record.pathname

    root.addFilter(not_of_vpype)
    try:
        yield
    finally:
        root.removeFilter(not_of_vpype)
