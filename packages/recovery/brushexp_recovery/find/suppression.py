"""Apply greedy non-maximum suppression: accept candidates with enough free pixels, most certain candidate first."""

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

Array = NDArray[Any]

FREE_SHARE = 0.6  # share of a region that more certain regions must leave free


@dataclass(frozen=True)
class Candidate:
    """A candidate region found by one look."""

    pixels: Array  # int32 flat indices in the tile, later in the picture
    chance: float  # mean agreement of the looks with the region
    attributes: Array  # (len(StrokeAttribute),) in pixels of the picture


def keep_surest(candidates: list[Candidate], labels: Array, least_share: float) -> list[Candidate]:
    """Accept candidates in order of certainty, if enough of their pixels are still free.

    Accepted candidates are written into ``labels`` (P,), which are initially -1. Selection stops at the first candidate
    with a probability below ``least_share`` times the mean probability of the accepted candidates.
    """
    surest = list[Candidate]()
    total = 0.0
    for candidate in sorted(candidates, key=lambda one: -one.chance):
        if candidate.chance * len(surest) < least_share * total:
            break
        free = labels[candidate.pixels] < 0
        if free.sum() >= max(FREE_SHARE * len(free), 1):
            labels[candidate.pixels[free]] = len(surest)
            surest.append(candidate)
            total += candidate.chance
    return surest
