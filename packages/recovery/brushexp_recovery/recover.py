"""Strokes are recovered from a picture of a painting: ``brushexp.recover``."""

from collections.abc import Callable
from os import PathLike
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp.api.settings import settings_of, undisturbed
from brushexp.pictures.load import load_picture
from brushexp.strokes.bezier import strokes_along
from brushexp.strokes.saved import Saved
from brushexp.system.progress import showing
from brushexp_recovery.calibration import signs_of
from brushexp_recovery.curves import Fitted, fit_curves
from brushexp_recovery.finding import find_regions
from brushexp_recovery.judges import ask_linear
from brushexp_recovery.model import NAME, RecoveryModel, load_model
from brushexp_recovery.raster.threads import return_freed_memory
from brushexp_recovery.refining import refine
from brushexp_recovery.stacking import meetings_of, stack
from brushexp_recovery.storage import Recovered, read_recovered, write_recovered

__all__ = ["Recovered", "read_recovered", "recover", "write_recovered"]
Array = NDArray[Any]

COPIES = 1  # of what each look shows, turned and mirrored
SAMPLED = 100_000  # pixels whose colours tell that of the ground
FOUND = 0.9  # share of the time in which regions are found; in the rest their curves are fitted
RENDERER = "analytic"  # draws a stroke as it was fitted


def recover(
    image: Any, *, scale: float | None = None, copies: int = COPIES, weights: str | PathLike[str] = NAME
) -> Recovered:
    """Recover the strokes of a painting from a picture of it, as ``task=recover`` does.

    Args:
        image: a path, the name of a sample, or a picture: (H, W, 3) or (3, H, W) tensor, uint8 or floats in [0, 1].
        scale: at which strokes are sought; None for one at which the middle one is 18 px wide.
        copies: 1 to 8 turned and mirrored copies of the picture in each of four looks; more are slower and surer.
        weights: a .safetensors file of task=train model=recovery, or the name of shipped ones.

    Returns:
        A catalogue of the strokes that were found, the chance of each to be one, and which is seen at each pixel. What
        is no stroke is left empty.

    Raises:
        UserError: what is wrong with the picture, the weights or another argument.
    """
    options = {"image": image, "scale": scale, "copies": copies, "weights": str(weights)}
    settings = settings_of("recover", options)  # which holds the picture
    with undisturbed(), showing("finding strokes") as show:
        picture = load_picture(settings.cfg.image, None)
        return recover_with(load_model(str(weights)), picture.permute(1, 2, 0).numpy(), scale, copies, show)


@return_freed_memory()
def recover_with(
    model: RecoveryModel, image: Array, scale: float | None, copies: int, show: Callable[[float, str], None]
) -> Recovered:
    """Recover strokes from a picture (H, W, 3) float32 in [0, 1]."""
    regions = find_regions(model, image, scale, copies, lambda share, state: show(FOUND * share, state))
    fitted = fit_curves(regions, image)
    pairs, features = meetings_of(regions, fitted)
    order = stack(len(regions.chance), pairs, ask_linear(model.order, features))
    confidence = 1 / (1 + np.exp(-ask_linear(model.confidence, signs_of(regions))))
    labels = regions.labels
    del regions  # with its maps of what is above, which fill the memory
    fitted = refine(fitted, labels, order, show=lambda share, state: show(FOUND + (1 - FOUND) * share, state))
    return in_order(labels, fitted, confidence, order, image)


def in_order(labels: Array, fitted: Fitted, confidence: Array, order: Array, image: Array) -> Recovered:
    """Make a catalogue of strokes fitted to regions (H, W), bottom to top by ``order`` (N,)."""
    rank = np.full(len(order) + 1, -1, np.int32)  # the last is that of -1
    rank[order] = np.arange(len(order), dtype=np.int32)
    labels = rank[labels]
    curve, width, color = (torch.as_tensor(value[order], dtype=torch.float32) for value in fitted)
    every = max(1, round((labels.size / SAMPLED) ** 0.5))
    sample, empty = image[::every, ::every].reshape(-1, 3), labels[::every, ::every].ravel() < 0
    ground = sample[empty] if empty.mean() > 0.01 else sample
    saved = Saved(
        strokes=strokes_along(curve, width, color, 1.0),
        depth=torch.arange(len(order), dtype=torch.int32),
        size=(image.shape[0], image.shape[1]),
        background=torch.as_tensor(np.median(ground, 0), dtype=torch.float32).clamp(0, 1),
        renderer=RENDERER,
    )
    return Recovered(saved, confidence[order].astype(np.float32), labels)
