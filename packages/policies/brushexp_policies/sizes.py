"""Keep the thickness of strokes between that of a smallest and a largest brush while they are optimised."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

from brushexp.contracts import Rule, UserError, above, register
from brushexp.contracts.families import Callback
from brushexp.contracts.strokes import half_width_of

if TYPE_CHECKING:
    from pathlib import Path

    import lightning as L
    from torch import Tensor

    from brushexp.contracts.strokes import Strokes

LEAST = 1e-6  # pixels: no thickness is smaller where one is divided by it


def size_from(text: str, option: str) -> tuple[float, str]:
    """Read ``3``, ``3px`` or ``2.5mm`` as a number and its unit, px or mm; a UserError for anything else."""
    found = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)(px|mm)?", text)
    if found is None or not math.isfinite(float(found[1])):
        raise UserError(f"{option}={text} is no size; give pixels, {option}=3, or millimetres, {option}=2mm")
    return float(found[1]), found[2] or "px"


SIZE = Rule(size_from)


@register("callbacks", "sizes")
@dataclass(kw_only=True)
class Sizes(Callback):
    """Strokes between a smallest and a largest brush, in pixels or mm, from the first step on (``painter=gradient``).

    After every step a stroke that is thinner or thicker goes to the nearest thickness that is allowed, as a projected
    gradient; one that widens does so within the bounds. So the others do what it no longer can. Points of a tapered
    stroke, and bristles, may be thinner.

    Args:
        smallest: thickness, in pixels of the painting (3) or millimetres (2mm); null for no bound.
        largest: thickness, as ``smallest``.
        width_cm: width of the painting, for millimetres.
    """

    smallest: Annotated[str, SIZE] | None = None
    largest: Annotated[str, SIZE] | None = None
    width_cm: Annotated[float, above(0, 2000)] = 30.0

    def __post_init__(self) -> None:
        if len({unit for _, unit in self._sizes() if unit}) == 1:  # else it depends on the picture
            self.bounds(1)

    def open(self, folder: Path) -> L.Callback:
        from lightning.pytorch.callbacks import LambdaCallback  # noqa: PLC0415  (slow to import)

        return LambdaCallback(setup=lambda trainer, painter, stage: self._bind(painter))

    def within(self, strokes: Strokes, width: int) -> Strokes:
        """Bring strokes to the nearest thickness that is allowed in a painting so many pixels wide."""
        low, high = self.bounds(width)
        thick = (2 * half_width_of(strokes)).clamp_min(LEAST)
        allowed = thick.clamp(low, high)
        room = (high / allowed - 1).minimum(1 - low / allowed).clamp(0, 1)
        widening = strokes.widening.maximum(-room).minimum(room)
        return replace(strokes, width=strokes.width * (allowed / thick), widening=widening)

    def bounds(self, width: int) -> tuple[float, float]:
        """Return the least and the greatest thickness in pixels of a painting so many pixels wide."""
        scale = {"px": 1.0, "mm": width / (10 * self.width_cm), "": 1.0}
        low, high = (size * scale[unit] for size, unit in self._sizes())
        if low > high:
            cure = "exchange them, or set callbacks.sizes.width_cm"
            raise UserError(f"callbacks.sizes: smallest={self.smallest} is above largest={self.largest}; {cure}")
        return low, max(high, LEAST)

    def _sizes(self) -> tuple[tuple[float, str], tuple[float, str]]:
        """Read both bounds; those that are not given have no unit."""
        low = (0.0, "") if self.smallest is None else size_from(self.smallest, "callbacks.sizes.smallest")
        return low, (math.inf, "") if self.largest is None else size_from(self.largest, "callbacks.sizes.largest")

    def _bind(self, painter: Any) -> None:
        """Bind the strokes of a painter by steps, beside what binds them already."""
        if not hasattr(painter, "limit"):
            raise UserError("callbacks=sizes is for painter=gradient; drop it, or drop painter=")
        other, width = painter.limit, painter.picture.size[1]

        def limit(strokes: Strokes, before: Strokes | None, rows: Tensor | None) -> Strokes:
            return other(self.within(strokes, width), before, rows)

        painter.limit = limit
        painter.catalogue.replace(painter.strokes())
        painter.depth.renew(painter.strokes())
