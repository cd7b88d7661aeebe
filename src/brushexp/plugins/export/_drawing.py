"""How a painting is to be drawn with pens: the options that the exporters share, and where it lies on the paper."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np

from brushexp.errors import UserError, check_range
from brushexp.plugins.export._library import the_library

Array = np.ndarray


class Hidden(Enum):
    """What becomes of strokes that lie below others."""

    cut = "cut"
    skip = "skip"
    draw = "draw"


@dataclass(frozen=True)
class Drawing:
    """How a painting is drawn with pens. The options of the exporters, which say what they mean.

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
        within = {"colors": (1, 64), "layers": (1, 10_000), "pen_mm": (0.05, 500.0), "margin_mm": (0.0, 1000.0)}
        within |= {"tolerance_mm": (0.001, 10.0), "passes": (1, 2000), "width_mm": (0.1, 100_000.0)}
        for key, (low, high) in within.items():
            check_range(f"to.{self.name}.{key}", getattr(self, key), low, high)
        self.room((1, 1))
        self.own_pens  # noqa: B018  (says what is wrong with it before anything is drawn)

    @cached_property
    def page(self) -> tuple[float, float]:
        """Shorter and longer side of the paper."""
        vpype = the_library()
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
        """Colours (K, 3) in [0, 1] of the pens that there are, None if any can be had."""
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

    def frame(self, size: tuple[int, int]) -> tuple[tuple[float, float], complex, float]:
        """Width and height of the paper, upper left corner of the picture in its middle, and mm per pixel."""
        paper, scale = self.room(size)
        if self.width_mm is not None:
            most = scale * size[1]
            if self.width_mm > most * (1 + 1e-9):
                raise UserError(
                    f"to.{self.name}.width_mm={self.width_mm:g} is too wide for {paper[0]:g} x {paper[1]:g} mm and its "
                    f"margins; try to.{self.name}.width_mm={math.floor(10 * most) / 10:g}"
                )
            scale = self.width_mm / size[1]
        return paper, complex(paper[0] - scale * size[1], paper[1] - scale * size[0]) / 2, scale
