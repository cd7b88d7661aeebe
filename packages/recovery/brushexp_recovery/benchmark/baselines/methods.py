"""Recovery and its baselines, as functions from a picture (H, W, 3) in [0, 1] to predicted strokes.

Some baselines receive the true number of strokes, which recovery does not.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.benchmark.baselines.edges import strokes_between_edges
from brushexp_recovery.benchmark.baselines.region_growing import grow_ellipses
from brushexp_recovery.benchmark.prediction import (
    Prediction,
    prediction_from_catalogue,
    prediction_from_curves,
    prediction_from_labels,
    prediction_from_recovered,
)
from brushexp_recovery.model.recovery_model import SHIPPED_WEIGHTS

Array = NDArray[Any]
Method = Callable[..., Prediction]  # arguments: a picture, a number of strokes and, for trained methods, weights

COMPACTNESS = 10.0  # compactness of superpixels, as in Achanta et al. (2012)
DESCENT_STEPS = 150


def recovery(image: Array, count: int, weights: str = SHIPPED_WEIGHTS) -> Prediction:
    """Recover strokes as ``task=recover`` does; ``count`` is not used."""
    from brushexp_recovery.recover.pipeline import recover  # noqa: PLC0415

    return prediction_from_recovered(recover(image, weights=weights))


def recovered_curves(image: Array, count: int, weights: str = SHIPPED_WEIGHTS) -> Prediction:
    """Recover strokes, but use only their curves, drawn as plain lines in the recovered order."""
    whole = recovery(image, count, weights)
    lines = prediction_from_curves(whole.curve, whole.width, whole.color, np.ones(len(whole)), image.shape[:2])
    return replace(lines, confidence=whole.confidence)


def superpixels(image: Array, count: int) -> Prediction:
    """Divide a picture into about ``count`` superpixels (SLIC; Achanta et al., 2012)."""
    from skimage.segmentation import slic  # noqa: PLC0415  (slow to import)

    return prediction_from_labels(slic(image, count, COMPACTNESS, start_label=0), image)


def edges(image: Array, count: int) -> Prediction:
    """Find brushstroke-shaped regions between edges (Li et al., 2012); ``count`` is not used."""
    return prediction_from_labels(strokes_between_edges(image), image)


def grow_regions(image: Array, count: int) -> Prediction:
    """Grow regions of one colour, and keep elliptical ones (Lamberti et al., 2014); ``count`` is not used."""
    return prediction_from_labels(grow_ellipses(image), image)


def gradient(image: Array, count: int) -> Prediction:
    """Paint the picture with ``count`` plain strokes by gradient descent, and return the strokes."""
    import brushexp  # noqa: PLC0415

    strokes = max(count, 1)
    words: dict[str, Any] = {"max_strokes": strokes, "steps": DESCENT_STEPS, "frames": 0, "report": False}
    painting = brushexp.paint(image.astype(np.float32), look="even", strokes=strokes, **words)
    return prediction_from_catalogue(painting.finished.job.saved, image.shape[:2])


TRAINED = {"recovery", "recovered_curves"}  # methods that take weights
METHODS: dict[str, Method] = {
    "recovery": recovery,
    "recovered_curves": recovered_curves,
    "gradient": gradient,
    "edges": edges,
    "growing": grow_regions,
    "superpixels": superpixels,
}
