"""Divide a picture into superpixels, small regions that no border crosses, and sum their moments and affinities."""

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from brushexp_recovery.segment.affinity_maps import StrokeMaps
from brushexp_recovery.segment.moments import sum_moments
from brushexp_recovery.segment.region_adjacency import adjacency_of
from brushexp_recovery.segment.watershed import border_strength, flood_basins

Array = NDArray[Any]


@dataclass(frozen=True)
class Superpixels:
    """S small regions of a picture, and P pairs of neighbouring regions with their affinities."""

    labels: Array  # (H, W) int32, 0 to S - 1
    moments: Array  # (S, len(Moment))
    within: Array  # (S, len(AffinityColumn)) affinities within a region
    pairs: Array  # (P, 2)
    between: Array  # (P, len(AffinityColumn)) affinities between two regions


def superpixels_of(maps: StrokeMaps, image: Array) -> Superpixels:
    """Divide a picture (H, W, 3) in [0, 1] into superpixels along the borders in its maps."""
    labels = flood_basins(border_strength(maps.affinity))
    adjacency = adjacency_of(labels, maps.affinity)
    moments = sum_moments(labels, image, maps)
    return Superpixels(labels, moments, adjacency.within, adjacency.pairs, adjacency.between)
