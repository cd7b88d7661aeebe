"""Measure the agreement between several looks at a part of a picture; regions that most looks share are reliable."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.find.look import Look
from brushexp_recovery.find.suppression import Candidate, keep_surest
from brushexp_recovery.join.node_overlap import node_overlaps
from brushexp_recovery.model.channels import StrokeAttribute
from brushexp_recovery.raster.boxes import Box
from brushexp_recovery.raster.labels import group_pixels
from brushexp_recovery.raster.tiles import Tile
from brushexp_recovery.segment.moments import Moment

Array = NDArray[Any]


def agreement_of(looks: Sequence[Look]) -> list[Array]:
    """Compute how well all looks agree on the regions (N,) chosen by each look, from 0 to 1.

    A look's agreement with a region is the maximum, over the look's nodes, of the node's ``worth`` times the
    intersection over union between node and region. The best node need not be one that the look has chosen. Regions
    are compared on the pixel grid of the first look.
    """
    size = looks[0].superpixels.shape
    pixels = [look.pixels_for(size) for look in looks]
    agreements = []
    for look, own_pixels in zip(looks, pixels, strict=True):
        regions = look.regions[own_pixels]
        votes = [
            _best_node(other, other.superpixels[other_pixels], regions, len(look.nodes))
            for other, other_pixels in zip(looks, pixels, strict=True)
        ]
        agreements.append(np.mean(votes, 0))
    return agreements


def _best_node(look: Look, superpixels: Array, regions: Array, count: int) -> Array:
    """Compute how well the best-matching node of a look agrees with each of ``count`` regions (H, W)."""
    agreement = node_overlaps(look.tree, superpixels, regions, count) * look.worth[:, None]
    best: Array = agreement.max(0)
    return best


def find_candidates(looks: Sequence[Look], tile: Tile) -> list[Candidate]:
    """Select candidates centred in the core of a tile from the regions that several looks found in the tile."""
    candidates: list[Candidate] = []
    for look, chance in zip(looks, agreement_of(looks), strict=True):
        candidates += _candidates_of(look, chance, tile)
    height, width = tile.box.size
    return keep_surest(candidates, np.full(height * width, -1, np.int32), 0.0)


def _candidates_of(look: Look, chance: Array, tile: Tile) -> list[Candidate]:
    """List the regions that a look has chosen and whose centres are in the core of the tile."""
    box, core = tile
    candidates = []
    attributes = attributes_of(look.tree.moments[look.nodes], np.array(look.regions.shape) / box.size, box)
    regions = look.regions[look.pixels_for(box.size)]
    for number, pixels in enumerate(group_pixels(regions, len(look.nodes))):
        if not len(pixels):
            continue
        rows, columns = np.divmod(pixels, regions.shape[1])
        y, x = box.top + rows.mean(), box.left + columns.mean()
        if core.top <= y < core.bottom and core.left <= x < core.right:
            candidates.append(Candidate(pixels, float(chance[number]), attributes[number]))
    return candidates


def attributes_of(moments: Array, scale: Array, box: Box) -> Array:
    """Compute the `StrokeAttribute`s (N, 7) of regions, in pixels of the picture, from moments in an enlarged box.

    ``scale`` (2,) holds the factors by which the rows and columns of the box were enlarged.
    """
    mean = moments / moments[:, [Moment.AREA]]
    log_zoom = np.log(scale).mean()
    table = np.empty((len(moments), len(StrokeAttribute)))
    table[:, StrokeAttribute.CENTRE_X] = mean[:, Moment.CENTRE_X] / scale[1] + box.left
    table[:, StrokeAttribute.CENTRE_Y] = mean[:, Moment.CENTRE_Y] / scale[0] + box.top
    table[:, StrokeAttribute.COSINE] = mean[:, Moment.COSINE]
    table[:, StrokeAttribute.SINE] = mean[:, Moment.SINE]
    table[:, StrokeAttribute.LOG_WIDTH] = mean[:, Moment.LOG_WIDTH] - log_zoom
    table[:, StrokeAttribute.LOG_LENGTH] = mean[:, Moment.LOG_LENGTH] - log_zoom
    table[:, StrokeAttribute.VISIBLE] = mean[:, Moment.VISIBLE]
    return table
