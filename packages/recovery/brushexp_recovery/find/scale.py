"""Find the scale at which to search a picture for strokes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.find.agreement import find_candidates
from brushexp_recovery.find.look import look_at
from brushexp_recovery.find.plain_ground import width_on_plain_ground
from brushexp_recovery.model.channels import StrokeAttribute
from brushexp_recovery.model.recovery_model import Classifiers, RecoveryModel
from brushexp_recovery.raster.boxes import Box
from brushexp_recovery.raster.resampling import resample
from brushexp_recovery.raster.tiles import Tile
from brushexp_recovery.segment.affinity_maps import predict_maps

Array = NDArray[Any]

SCALES = (0.15, 3.0)  # smallest and largest scale
BEST_WIDTH = 18.0  # pixels: median stroke width; a quarter wider than in training, which finds 2 % more strokes
TRIALS = 3  # number of predictions for parts of a picture to estimate its scale
PART_SIDE = 384  # pixels of these parts after zooming
GUESS_BONUS = 0.05  # relative lead in explained share that another scale needs over the estimated one
SETTLED = 0.2  # change of the logarithm of a scale below which no further prediction is made
LEAST_PAINT = 0.02  # share of paint below which widths are ignored


def find_zoom(model: RecoveryModel, classifiers: Classifiers, image: Array) -> float:
    """Find the scale at which to search a picture (H, W, 3) for strokes.

    On a plain ground, which is rare in training, the scale is computed from the shapes of the strokes; otherwise the
    network estimates it.
    """
    width = width_on_plain_ground(image)
    if width is None:
        return find_zoom_by_network(model, classifiers, image)
    return float(np.clip(BEST_WIDTH / width, *SCALES))


def find_zoom_by_network(model: RecoveryModel, classifiers: Classifiers, image: Array) -> float:
    """Find the scale of a picture (H, W, 3) at which strokes have the width that suits the network best.

    The network estimates this scale. The picture's own scale, or the geometric mean of the two scales, is used instead
    if regions explain more of the picture at that scale: in an enlarged picture, grain and canvas look like strokes,
    but with low confidence.
    """
    guess = guess_zoom(model, image)
    if abs(np.log(guess)) < SETTLED:
        return guess
    middle = float(np.sqrt(guess))
    parts = cut_out_parts(image, PART_SIDE / middle)
    worth = {zoom: explained_share(model, classifiers, parts, zoom) for zoom in (guess, middle, 1.0)}
    worth[guess] *= 1 + GUESS_BONUS
    return max(worth, key=lambda zoom: worth[zoom])


def explained_share(model: RecoveryModel, classifiers: Classifiers, parts: list[Array], zoom: float) -> float:
    """Compute the fraction of a picture's parts that regions cover at a given scale, weighted by their probability."""
    total = 0.0
    for part in parts:
        box = Box(0, part.shape[0], 0, part.shape[1])
        image = resample(part, zoom)
        look = look_at(predict_maps(model.network, image, 1), image, classifiers)
        total += sum(len(one.pixels) * one.chance for one in find_candidates([look], Tile(box, box)))
    return total / sum(part.shape[0] * part.shape[1] for part in parts)


def guess_zoom(model: RecoveryModel, image: Array) -> float:
    """Estimate, from predicted widths, the scale at which strokes have the width that suits the network best."""
    zoom = 1.0
    for _ in range(TRIALS):
        parts = cut_out_parts(image, PART_SIDE / zoom)
        widths, strokes = np.concatenate([_widths_in(model, resample(part, zoom)) for part in parts], 1)
        if not len(widths):
            break
        change = BEST_WIDTH / weighted_median(widths, strokes)
        before, zoom = zoom, float(np.clip(zoom * change, *SCALES))
        if abs(np.log(zoom / before)) < SETTLED:
            break
    return zoom


def weighted_median(values: Array, weights: Array) -> float:
    """Compute the weighted median of values (N,) with weights (N,)."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def cut_out_parts(image: Array, side: float) -> list[Array]:
    """Crop up to four parts of a picture, one per quarter, or a single part at the centre if the picture is small."""
    height, width = image.shape[:2]
    part_height, part_width = min(int(side) + 1, height), min(int(side) + 1, width)
    places = (0.5,) if max(height, width) < 2 * side else (0.25, 0.75)
    tops = [int(place * (height - part_height)) for place in places]
    lefts = [int(place * (width - part_width)) for place in places]
    return [image[top : top + part_height, left : left + part_width] for top in tops for left in lefts]


def _widths_in(model: RecoveryModel, part: Array) -> Array:
    """Predict, for each painted pixel, the width of its stroke and the reciprocal of that stroke's area: (2, P)."""
    maps = predict_maps(model.network, part, 1)
    paint = maps.paint > 0
    paint &= paint.mean() > LEAST_PAINT
    log_width = maps.attributes[StrokeAttribute.LOG_WIDTH][paint]
    log_length = maps.attributes[StrokeAttribute.LOG_LENGTH][paint]
    return np.stack([np.exp(log_width), np.exp(-log_width - log_length)])
