"""Find the regions of strokes in a picture of any size, tile by tile at two scales, and keep the most certain ones."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.find.agreement import find_candidates
from brushexp_recovery.find.look import Look, look_at
from brushexp_recovery.find.scale import find_zoom
from brushexp_recovery.find.suppression import Candidate, keep_surest
from brushexp_recovery.model.channels import OCCLUSION_OFFSETS, StrokeAttribute
from brushexp_recovery.model.recovery_model import RecoveryModel
from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.raster.resampling import nearest_pixels, resample
from brushexp_recovery.raster.threads import Progress, map_on_threads
from brushexp_recovery.raster.tiles import Tile, split_into_tiles
from brushexp_recovery.segment.affinity_maps import StrokeMaps, predict_maps

Array = NDArray[Any]

TILE_SIDE = 512  # pixels after zooming
KEPT_SHARE = 0.5  # a region is kept if its probability is at least this share of the mean of the kept regions
OCCLUSION_STEPS = 16  # 8-bit steps per unit of log-odds


class Change(NamedTuple):
    """A transformation of a tile that is applied before a look."""

    zoom: float  # relative to the scale of the picture
    blur: float  # standard deviation in pixels


CHANGES = (Change(1.0, 0.0), Change(1.4, 0.0), Change(0.7, 0.0), Change(1.0, 1.0))  # one per look at a tile


class Search(NamedTuple):
    """The settings of one search through the whole picture."""

    zoom: float  # relative to the scale of the picture
    worth: float  # factor on the probability of each region found


SEARCHES = (Search(1.0, 1.0), Search(0.5, 0.75))  # the second finds broad strokes where it is clearly more certain


@dataclass(frozen=True)
class Regions:
    """N regions of a picture, each the visible part of one stroke."""

    labels: Array  # (H, W) int32, 0 to N - 1, or -1 for none
    chance: Array  # (N,) agreement of all looks on the region, 0 to 1
    attributes: Array  # (N, len(StrokeAttribute)) predicted, in pixels of the picture
    occlusion: Array  # (len(OCCLUSION_OFFSETS), H, W) int8, log-odds in 1 / OCCLUSION_STEPS that the stroke at an
    # offset, divided by the zoom, lies above the one here
    paint: Array  # (H, W) bool, whether the network predicts paint rather than bare ground
    zoom: float  # scale at which the picture was searched


def find_regions(
    model: RecoveryModel,
    image: Array,
    zoom: float | None,
    copies: int,
    show: Progress,
    searches: Sequence[Search] = SEARCHES,
) -> Regions:
    """Find the regions of strokes in a picture (H, W, 3) float32 in [0, 1].

    If ``zoom`` is None, the scale is chosen automatically. Each of the ``searches`` proposes regions, and each of its
    looks averages predictions over ``copies`` rotated and mirrored copies. A region is kept if more certain regions
    leave enough of it free, and if its probability is at least half the mean probability of the kept regions. This
    threshold maximises the expected F1 if the picture has as many strokes as there are kept regions, and if each
    region's probability of being a stroke is correct.
    """
    height, width = image.shape[:2]
    classifiers = model.classifiers()
    zoom = find_zoom(model, classifiers, image) if zoom is None else zoom
    occlusion = np.zeros((len(OCCLUSION_OFFSETS), height, width), np.int8)
    paint = np.zeros((height, width), bool)

    def look(number: int, one: Search, tile: Tile) -> Look:  # the maps of a look are freed before the next one
        change = CHANGES[number]
        shown = resample(image[tile.box.slices], zoom * one.zoom * change.zoom)
        shown = gaussian_blur(shown, (change.blur, change.blur, 0)) if change.blur else shown
        maps = predict_maps(model.network, shown, copies, number)
        if number == 0 and one == searches[0]:
            _keep_maps(occlusion, paint, maps, tile)
        return look_at(maps, shown, classifiers)

    def search(part: tuple[Search, Tile]) -> list[Candidate]:
        one, tile = part
        looks = [look(number, one, tile) for number in range(len(CHANGES))]
        return [_move_to_picture(candidate, tile, width, one.worth) for candidate in find_candidates(looks, tile)]

    parts = [(one, tile) for one in searches for tile in split_into_tiles(height, width, zoom * one.zoom, TILE_SIDE)]
    candidates = list[Candidate]()
    for done, of_part in enumerate(map_on_threads(search, parts), start=1):
        candidates += of_part
        show(done / len(parts), f"{len(candidates)} strokes")
    labels = np.full(height * width, -1, np.int32)
    surest = keep_surest(candidates, labels, KEPT_SHARE)
    chance = np.array([one.chance for one in surest])
    attributes = np.array([one.attributes for one in surest]).reshape(-1, len(StrokeAttribute))
    return Regions(labels.reshape(height, width), chance, attributes, occlusion, paint, zoom)


def _move_to_picture(candidate: Candidate, tile: Tile, width: int, worth: float) -> Candidate:
    """Map a candidate from a tile to a picture ``width`` pixels wide, and multiply its probability by ``worth``."""
    y, x = np.divmod(candidate.pixels, tile.box.size[1])
    pixels = (y + tile.box.top) * width + x + tile.box.left
    return replace(candidate, pixels=pixels, chance=worth * candidate.chance)


def _keep_maps(occlusion: Array, paint: Array, maps: StrokeMaps, tile: Tile) -> None:
    """Store the occlusions, in 8 bits, and the paint mask for the core of a tile."""
    height, width = tile.box.size
    rows, columns = tile.core.within(tile.box).slices
    zoomed_rows = nearest_pixels(height, maps.occlusion.shape[1])[rows]
    zoomed_columns = nearest_pixels(width, maps.occlusion.shape[2])[columns]
    paint[tile.core.slices] = maps.paint[zoomed_rows[:, None], zoomed_columns] > 0
    levels = np.clip(maps.occlusion * OCCLUSION_STEPS, -127, 127).astype(np.int8)
    for channel, level in enumerate(levels):  # one by one, because a tile of a broad brush has millions of pixels
        occlusion[channel][tile.core.slices] = level[zoomed_rows[:, None], zoomed_columns]
