"""Greedy non-maximum suppression: the surest candidates are kept first, others where these leave room."""

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

Array = NDArray[Any]

FREE_SHARE = 0.6  # of a region, that surer ones must leave to it


@dataclass(frozen=True)
class Candidate:
    """A region as one look shows it."""

    pixels: Array  # flat indices int32, in the tile, later in the picture
    chance: float  # mean over the looks of how far they agree with it
    attributes: Array  # (len(StrokeAttribute),) in pixels of the picture


def keep_surest(candidates: list[Candidate], labels: Array, least_share: float) -> list[Candidate]:
    """Keep candidates, the surest first, of which enough is free.

    Kept candidates are written into ``labels`` (P,), which are -1 at first. A candidate is not kept if its chance is
    below ``least_share`` of the mean chance of those before it.
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
