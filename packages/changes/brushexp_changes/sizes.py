"""Keep stroke thickness between the sizes of the smallest and the largest brush during optimisation."""

import math
import re
from dataclasses import dataclass, replace
from typing import Annotated

from omegaconf import DictConfig
from torch import Tensor

from brushexp.contracts import Rule, UserError, above, register
from brushexp.contracts.families import Change, PaintingState
from brushexp.contracts.painting import sizes_of
from brushexp.contracts.strokes import Strokes, half_width_of
from brushexp_changes.steps import check_steps

LEAST_THICKNESS = 1e-6  # lower bound in pixels of thicknesses used as divisors
MM_PER_CM = 10


def size_from(text: str, option: str) -> tuple[float, str]:
    """Parse ``3``, ``3px`` or ``2.5mm`` into a number and its unit, px or mm; raise UserError for anything else."""
    found = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)(px|mm)?", text)
    if found is None or not math.isfinite(float(found[1])):
        word = option.rpartition(".")[2]
        raise UserError(f"{option}={text} is not a size; give pixels, {word}=3, or millimetres, {word}=2mm")
    return float(found[1]), found[2] or "px"


SIZE = Rule(size_from)


@register("change", "sizes")
@dataclass(kw_only=True)
class Sizes(Change):
    """Bound stroke thickness by a smallest and a largest brush, in pixels or mm (as in ``smallest=2mm largest=20mm``).

    After every step, the thickness and the widening of each stroke are clamped to the bounds (projected gradient
    descent), and other strokes compensate for what a clamped stroke cannot paint. Bristles and the tips of tapered
    strokes may be thinner.

    Args:
        smallest: minimum stroke thickness, in pixels of the painting (3) or in mm (2mm); null = no bound.
        largest: maximum stroke thickness, in the same units; null = no bound.
        width_cm: width of the painting in cm, used to convert millimetres.
    """

    smallest: Annotated[str, SIZE] | None = None
    largest: Annotated[str, SIZE] | None = None
    width_cm: Annotated[float, above(0, 2000)] = 30.0

    def __post_init__(self) -> None:
        if len({unit for _, unit in self._sizes() if unit}) == 1:  # otherwise it depends on the picture
            self.bounds(1)

    def check(self, cfg: DictConfig, size: tuple[int, int]) -> None:
        typed = [f"{name}={getattr(self, name)}" for name in ("smallest", "largest") if getattr(self, name) is not None]
        check_steps(cfg, typed[0] if typed else "change=sizes")
        self.bounds(size[1], sizes_of(cfg).zoom)

    def begin(self, strokes: Strokes, state: PaintingState) -> Strokes:
        return self.within(strokes, state.size[1], state.zoom)

    def limit(self, strokes: Strokes, before: Strokes | None, rows: Tensor | None, state: PaintingState) -> Strokes:
        return self.within(strokes, state.size[1], state.zoom)

    def within(self, strokes: Strokes, width: int, zoom: float = 1.0) -> Strokes:
        """Clamp stroke thickness to the bounds for a picture ``width`` pixels wide.

        ``zoom`` is the number of pixels of the painting per pixel of the picture.
        """
        low, high = self.bounds(width, zoom)
        thick = (2 * half_width_of(strokes)).clamp_min(LEAST_THICKNESS)
        allowed = thick.clamp(low, high)
        room = (high / allowed - 1).minimum(1 - low / allowed).clamp(0, 1)
        widening = strokes.widening.maximum(-room).minimum(room)
        return replace(strokes, width=strokes.width * (allowed / thick), widening=widening)

    def bounds(self, width: int, zoom: float = 1.0) -> tuple[float, float]:
        """Return the minimum and maximum thickness in pixels; for the arguments, see `within`."""
        scale = {"px": 1 / zoom, "mm": width / (MM_PER_CM * self.width_cm), "": 1.0}
        low, high = (size * scale[unit] for size, unit in self._sizes())
        if low > high:
            cure = "exchange them, or set width_cm"
            raise UserError(f"smallest={self.smallest} is above largest={self.largest}; {cure}")
        return low, max(high, LEAST_THICKNESS)

    def _sizes(self) -> tuple[tuple[float, str], tuple[float, str]]:
        """Parse ``smallest`` and ``largest``; a missing bound becomes 0 or infinity, without a unit."""
        low = (0.0, "") if self.smallest is None else size_from(self.smallest, "change.sizes.smallest")
        return low, (math.inf, "") if self.largest is None else size_from(self.largest, "change.sizes.largest")
