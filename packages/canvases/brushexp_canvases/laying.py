"""Place the initial strokes for a tile: its own strokes, and strokes of its painted and unpainted neighbours."""

from dataclasses import dataclass

import torch
from omegaconf import DictConfig
from torch import Tensor

from brushexp.contracts.members import Fixed
from brushexp.contracts.painting import boxes_of, first_strokes
from brushexp.contracts.pictures import Region
from brushexp.contracts.strokes import Strokes
from brushexp_canvases.grid import Tile
from brushexp_canvases.store import CanvasStore


@dataclass(frozen=True)
class Laid:
    """Initial strokes in a tile's window, in canvas pixels; ``ring`` and ``depth`` have equal lengths."""

    ring: Strokes  # strokes of painted neighbours; they stay fixed
    depth: Tensor  # depths of the ring
    own: Strokes  # the tile's own strokes
    passing: Strokes  # temporary strokes in unpainted neighbours; they lie below all others and are not stored


def lay(store: CanvasStore, tile: Tile, cfg: DictConfig, target: Tensor, focus: Tensor | None) -> Laid:
    """Place a tile's initial strokes for the ``target`` (3, h, w) in its window; ``focus`` (h, w) weights pixels."""
    grid, window, region = store.grid, store.grid.window(tile), store.grid.region(tile)
    before = sorted(grid.before(tile))
    stored, depth = store.strokes_of(before)
    near = mark_overlapping(stored, window, 0)
    inner = Region(region.top - window.top, region.left - window.left, region.height, region.width)
    own, _ = first_strokes(cfg, inner.of(target).contiguous(), Fixed(), None if focus is None else inner.of(focus))
    passing = own[:0]
    if any(other.round > tile.round for other in grid.around(tile)):
        wide, _ = first_strokes(cfg, target, Fixed(), focus)
        wide = wide.moved(shift=(window.left, window.top))
        taken = [inside(wide.position, part) for part in (region, *map(grid.region, before))]
        passing = wide[~torch.stack(taken).any(0)]
    return Laid(stored[near], depth[near], own.moved(shift=(region.left, region.top)), passing)


def mark_overlapping(strokes: Strokes, region: Region, edge: float) -> Tensor:
    """Mark the strokes (N,) whose bounding boxes, widened by ``edge`` pixels, overlap a region."""
    low, high = boxes_of(strokes, 1 + edge)
    first = low.new_tensor([region.left, region.top])
    return ((high > first) & (low < first + low.new_tensor([region.width, region.height]))).all(1)


def inside(position: Tensor, region: Region) -> Tensor:
    """Mark the positions (N, 2) that are in a region.

    A position on a shared border counts as being in only one of the two regions.
    """
    low = position.new_tensor([region.left, region.top])
    return ((position >= low) & (position < low + position.new_tensor([region.width, region.height]))).all(1)
