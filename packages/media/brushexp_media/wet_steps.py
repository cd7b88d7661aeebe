"""Let the steps know what wet paint will do to the painting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from brushexp.contracts import at_least, between, register
from brushexp.contracts.families import Callback

if TYPE_CHECKING:
    from pathlib import Path

    import lightning as L


@register("callbacks", "wet_steps")
@dataclass(kw_only=True)
class WetSteps(Callback):
    """With ``wet=``: every few steps paint is dragged for a look, so that strokes are optimised for the wet painting.

    Steps still draw dry strokes, towards the target plus what the wet painting then lacks: target + dry - wet. That is
    the gradient of the wet painting as if what dragging does were the same whatever the strokes (straight-through;
    Bengio, Léonard and Courville, 2013). Curves show the error of the wet painting so estimated.

    Args:
        every: steps between two looks, at least 1.
        after: share of the steps before the first look, while strokes still find their places.
        wet: how much a stroke drags along, 0 to 1; null = as ``wet=`` says.
    """

    every: Annotated[int, at_least(1)] = 10
    after: Annotated[float, between(0, 1)] = 0.2
    wet: Annotated[float, between(0, 1)] | None = None

    def open(self, folder: Path) -> L.Callback:
        from brushexp_media.wet_target import WetTarget  # noqa: PLC0415  (Lightning is slow to import)

        return WetTarget(self.every, self.after, self.wet)
