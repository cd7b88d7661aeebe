"""Methods that recovery is compared with: a picture (H, W, 3) in [0, 1], and a number of strokes, become strokes.

Those that take the number are told the true one, which is more than recovery is told.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.baseline_edges import edges_and_test
from brushexp_recovery.baseline_growing import growing_and_ellipses
from brushexp_recovery.given import Given, given_catalogue, given_curves, given_labels, given_recovered
from brushexp_recovery.model import NAME

Array = NDArray[Any]
Method = Callable[[Array, int], Given]

COMPACTNESS = 10.0  # of superpixels, as Achanta et al. (2012)
STEPS = 150  # of gradient descent


def recovery(image: Array, count: int, weights: str = NAME) -> Given:
    """Recover strokes as ``task=recover`` does; the number is not used."""
    from brushexp_recovery.recover import recover  # noqa: PLC0415

    return given_recovered(recover(image, weights=weights))


def recovered_curves(image: Array, count: int, weights: str = NAME) -> Given:
    """Recover strokes, and take their curves alone, drawn as plain lines in the order that was found."""
    given = recovery(image, count, weights)
    lines = given_curves(given.curve, given.width, given.color, np.ones(len(given)), image.shape[:2])
    return replace(lines, confidence=given.confidence)


def superpixels(image: Array, count: int) -> Given:
    """Divide a picture into ``count`` superpixels (SLIC; Achanta et al., 2012)."""
    from skimage.segmentation import slic  # noqa: PLC0415  (slow to import)

    return given_labels(slic(image, count, COMPACTNESS, start_label=0), image)


def edges(image: Array, count: int) -> Given:
    """Find regions between edges that pass a test of brushstrokes (Li et al., 2012); the number is not used."""
    return given_labels(edges_and_test(image), image)


def growing(image: Array, count: int) -> Given:
    """Grow regions of one colour, and keep ellipses (Lamberti et al., 2014); the number is not used."""
    return given_labels(growing_and_ellipses(image), image)


def gradient(image: Array, count: int) -> Given:
    """Paint the picture with ``count`` plain strokes by gradient descent, and take them."""
    import brushexp  # noqa: PLC0415

    size = image.shape[:2]
    words: dict[str, Any] = {"max_strokes": max(count, 1), "steps": STEPS, "frames": 0, "report": False}
    painting = brushexp.paint(image.astype(np.float32), look="even", strokes=max(count, 1), **words)
    return given_catalogue(painting.finished.job.saved, size)


LEARNT = {"recovery", "recovered_curves"}  # which take weights
METHODS: dict[str, Method] = {
    "recovery": recovery,
    "recovered_curves": recovered_curves,
    "gradient": gradient,
    "edges": edges,
    "growing": growing,
    "superpixels": superpixels,
}
