"""Convert a picture to grey so that colours that differ also differ in tone, for media with a single ink."""

import numpy as np
import torch

from brushexp.contracts.pictures import as_lab
from brushexp_media.picture.lines import LUMA

Array = np.ndarray
PAIRS = 4000  # number of pairs of pixels that are compared: half at random, half close together
NEAR = 0.01, 0.12  # range of the distance between close pixels, in longer sides
STEPS = 10  # number of steps from 0 to 1 in the weights that are tried
SPREAD = 0.05  # standard deviation of the difference in grey around the difference in colour, both up to 1
FLOOR = 1e-6  # least likelihood of a pair
FAMILIARITY = 1.5  # loss of log-likelihood per squared distance of the weights from those of luma
SEED = 0  # seed of the random pairs, so that equal pictures have equal weights


def decolorize(picture: Array, weights: Array) -> Array:
    """Compute the sum (H, W) of a picture's channels (3, H, W), weighted by ``weights`` (3,)."""
    grey: Array = np.tensordot(weights, picture.astype(np.float64), 1)
    return grey


def contrast_weights(picture: Array) -> Array:
    """Find the weights (3,) of red, green and blue that preserve most of the contrast between colours in grey.

    Weights are at least 0 and add up to 1. Red parrots become lighter or darker than green leaves of the same luma.

    Source: Lu, Xu and Jia, "Real-time contrast preserving decolorization" (2012): from a grid, they choose the weights
    for which differences in grey are most likely to equal the differences in CIELAB, with either sign. Unlike in the
    source, weights far from those of luma are less likely, so that grey stays close to luma if colours differ in luma.
    """
    random, (height, width) = np.random.default_rng(SEED), picture.shape[1:]
    y, x = random.integers(height, size=2 * PAIRS), random.integers(width, size=2 * PAIRS)
    angle, close = random.uniform(0, 2 * np.pi, PAIRS // 2), slice(PAIRS, PAIRS + PAIRS // 2)
    reach = max(height, width) * random.uniform(*NEAR, PAIRS // 2)
    y[close] = (y[: PAIRS // 2] + reach * np.sin(angle)).clip(0, height - 1)
    x[close] = (x[: PAIRS // 2] + reach * np.cos(angle)).clip(0, width - 1)
    colors = picture[:, y, x].astype(np.float64)
    lab = as_lab(torch.from_numpy(colors[:, None]))[0]
    difference = np.linalg.norm(lab[:PAIRS] - lab[PAIRS:], axis=1) / 100
    steps = np.mgrid[: STEPS + 1, : STEPS + 1].reshape(2, -1).T / STEPS
    grid = np.column_stack([steps, 1 - steps.sum(1)])[steps.sum(1) < 1 + 0.5 / STEPS].clip(0)
    grey = grid @ (colors[:, :PAIRS] - colors[:, PAIRS:])
    likelihood = sum(np.exp(-0.5 * ((grey + sign * difference) / SPREAD) ** 2) for sign in (-1, 1))
    familiar = np.square(grid - LUMA).sum(1)
    best: Array = grid[(np.log(likelihood + FLOOR).mean(1) - FAMILIARITY * familiar).argmax()]
    return best
