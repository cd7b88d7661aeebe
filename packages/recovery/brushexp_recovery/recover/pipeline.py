"""Run the whole recovery pipeline, from a picture to its strokes: ``brushexp.recover``."""

from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp.contracts.files import showing
from brushexp.contracts.pictures import load_picture
from brushexp.contracts.runs import settings_of, undisturbed
from brushexp.contracts.strokes import Saved, strokes_along
from brushexp_recovery.confidence.features import confidence_features
from brushexp_recovery.curves.fit import StrokeCurves, fit_curves
from brushexp_recovery.curves.refine import refine_curves
from brushexp_recovery.find.regions import find_regions
from brushexp_recovery.model.logistic import log_odds_of, sigmoid
from brushexp_recovery.model.recovery_model import SHIPPED_WEIGHTS, RecoveryModel, load_model
from brushexp_recovery.order.evidence import find_meetings
from brushexp_recovery.order.ranking import rank_strokes
from brushexp_recovery.raster.threads import Progress, return_freed_memory
from brushexp_recovery.recover.storage import Recovered

Array = NDArray[Any]

COPIES = 1  # number of rotated and mirrored copies per look
GROUND_SAMPLE = 100_000  # number of pixels from which the ground's colour is estimated
LEAST_GROUND = 0.01  # share of pixels without a stroke below which all pixels are used for the ground's colour
REGION_TIME = 0.9  # share of the time for finding regions; the rest is for fitting curves
RENDERER = "analytic"  # draws strokes as fitted


def recover(
    image: Any, *, scale: float | None = None, copies: int = COPIES, weights: str | PathLike[str] = SHIPPED_WEIGHTS
) -> Recovered:
    """Recover the strokes of a painting from a picture of it, as ``task=recover`` does.

    Args:
        image: path, name of a sample, or picture: an (H, W, 3) or (3, H, W) tensor, uint8 or floats in [0, 1].
        scale: scale at which the picture is searched for strokes; None = the scale at which the median stroke is
            18 px wide.
        copies: number of rotated and mirrored copies of the picture in each look, 1 to 8; more copies are slower but
            more accurate.
        weights: a .safetensors file of task=train_recovery, or the name of shipped weights.

    Returns:
        A catalogue of the strokes found, the confidence in each stroke, and the visible stroke at each pixel. Areas in
        which no stroke is found remain empty.

    Raises:
        UserError: the picture, the weights or another argument is invalid.
    """
    options = {"image": image, "scale": scale, "copies": copies, "weights": str(weights)}
    settings = settings_of("recover", options)  # includes the picture
    with undisturbed(), showing("finding strokes") as show:
        picture = load_picture(settings.cfg.image, None)
        return recover_with(load_model(str(weights)), picture.permute(1, 2, 0).numpy(), scale, copies, show)


@return_freed_memory()
def recover_with(model: RecoveryModel, image: Array, scale: float | None, copies: int, show: Progress) -> Recovered:
    """Recover strokes from a picture (H, W, 3) float32 in [0, 1]."""
    show(0.0, "choosing the scale")
    regions = find_regions(model, image, scale, copies, lambda share, state: show(REGION_TIME * share, state))
    strokes = fit_curves(regions, image)
    meetings = find_meetings(regions, strokes)
    evidence = log_odds_of(model.order, meetings.features)
    order = rank_strokes(len(regions.chance), meetings.pairs, evidence)
    confidence = sigmoid(log_odds_of(model.confidence, confidence_features(regions)))
    labels, ground = regions.labels, ~regions.paint & (regions.labels < 0)
    del regions  # frees the maps of occlusion, which fill the memory
    strokes = refine_curves(
        strokes,
        labels,
        order,
        show=lambda share, state: show(REGION_TIME + (1 - REGION_TIME) * share, state),
    )
    recovered = catalogue_of(labels, strokes, confidence, order, image)
    meetings_by_row = np.argsort(order)[meetings.pairs]
    return replace(recovered, meetings=meetings_by_row, chance_above=sigmoid(evidence), ground=ground)


def catalogue_of(labels: Array, strokes: StrokeCurves, confidence: Array, order: Array, image: Array) -> Recovered:
    """Make a catalogue of strokes fitted to regions (H, W); ``order`` (N,) lists the strokes bottom to top."""
    rank = np.full(len(order) + 1, -1, np.int32)  # the last entry is for -1
    rank[order] = np.arange(len(order), dtype=np.int32)
    labels = rank[labels]
    curve, width, color = (torch.as_tensor(value[order], dtype=torch.float32) for value in strokes)
    saved = Saved(
        strokes=strokes_along(curve, width, color, 1.0),
        depth=torch.arange(len(order), dtype=torch.int32),
        size=(image.shape[0], image.shape[1]),
        background=torch.as_tensor(ground_color(labels, image), dtype=torch.float32).clamp(0, 1),
        renderer=RENDERER,
    )
    return Recovered(saved, confidence[order].astype(np.float32), labels)


def ground_color(labels: Array, image: Array) -> Array:
    """Estimate the ground's colour (3,) as the median of sampled pixels without strokes, or of all if these are few."""
    every = max(1, round((labels.size / GROUND_SAMPLE) ** 0.5))
    sample = image[::every, ::every].reshape(-1, 3)
    is_empty = labels[::every, ::every].ravel() < 0
    return np.median(sample[is_empty] if is_empty.mean() > LEAST_GROUND else sample, 0)
