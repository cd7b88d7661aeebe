"""Add strokes where the error is largest, and remove the least important strokes."""

from dataclasses import dataclass
from typing import Annotated

from torch import Tensor

from brushexp.bounds import at_least, between
from brushexp.plugins.density._rounds import Rounds
from brushexp.plugins.density._worst_places import new_strokes
from brushexp.plugins.density.base import DensificationState
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes

MIN_PITCHES = 1e-3  # smallest size of a new stroke, in pitches


@register("density", "adaptive")
@dataclass(kw_only=True)
class Adaptive(Rounds):
    """Starts with some of the strokes, adds small ones where the error is largest, and moves unimportant ones there.

    Each round removes hidden strokes and the strokes whose removal increases the squared error least, and adds new
    strokes where the error is largest, in the picture's colour and along its edges.

    Source: GaussianImage++ (2025), which adds at the worst pixels, and 3D Gaussian splatting (Kerbl et al., 2023),
    which alternates adding and removing. Unlike both, this policy removes strokes by importance, not by opacity, and
    continues to replace strokes after their final number is reached.

    Args:
        start: initial fraction of the strokes, above 0 and at most 1.
        rounds: number of times that strokes are added and removed, at least 8 steps apart.
        until: fraction of the steps after which no strokes are added or removed.
        moved: fraction of the strokes that each round moves elsewhere, 0 to 0.5.
        size: size of new strokes, in mean distances between strokes.
        tolerance: root mean square error over a stroke, 0 to 1, below which an area needs no more strokes.
        surplus: number of temporary extra strokes relative to the final number, 0 to 3; the least important strokes are
            removed before the end.
        psnr: PSNR in dB above which no strokes are added; null for none.
    """

    size: Annotated[float, between(MIN_PITCHES, 10)] = 0.25
    psnr: Annotated[float | None, at_least(0, typical=30)] = None

    def is_good_enough(self, state: DensificationState) -> bool:
        wanted = 0.0 if self.psnr is None else 10 ** (-self.psnr / 10)  # mean squared error
        return bool((state.image - state.target).square().mean() <= wanted)

    def replacements(self, state: DensificationState, missing: int, weakest: Tensor) -> tuple[Strokes, int]:
        new = new_strokes(state, missing + len(weakest), self.size, self.tolerance)
        return new, max(0, len(new) - missing)
