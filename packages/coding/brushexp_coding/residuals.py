"""Predict the numbers of a stroke from the numbers of an earlier stroke, so that only small residuals are coded."""

from enum import IntEnum

import numpy as np

from brushexp_coding.entropy import LARGEST

BEFORE = 1024  # number of earlier strokes among which the nearest is chosen


class Prediction(IntEnum):
    """Source of the prediction for the numbers in a column."""

    NOTHING = 0
    LAST = 1  # the previous stroke
    NEAREST = 2  # the earlier stroke whose centre is nearest


def nearest_before(middle: np.ndarray) -> np.ndarray:
    """Find, for each stroke, the index (N,) of the nearest of the `BEFORE` strokes before it; 0 for the first stroke.

    In a tie, the later stroke is chosen. ``middle`` (N, 2) contains the strokes' centres in pixels. Only differences,
    squares and a sum are computed, so the result is the same on all machines.
    """
    count = len(middle)
    best, least = np.zeros(count, np.int64), np.full(count, np.inf)
    for back in range(1, min(BEFORE, count - 1) + 1):
        away = middle[back:] - middle[:-back]
        squares = away * away
        distance = squares[:, 0] + squares[:, 1]
        nearer = np.nonzero(distance < least[back:])[0]
        best[nearer + back] = nearer
        least[nearer + back] = distance[nearer]
    return best


def sources(prediction: Prediction, count: int, nearest: np.ndarray | None) -> np.ndarray | None:
    """Return the earlier stroke (N,) that predicts each of ``count`` strokes, or None if nothing is predicted."""
    if prediction == Prediction.LAST:
        return np.maximum(np.arange(count) - 1, 0)
    return nearest if prediction == Prediction.NEAREST else None


def rescale(numbers: np.ndarray, octaves: np.ndarray) -> np.ndarray:
    """Compute numbers * 2**octaves, rounded to integers and clamped to the range that can be encoded."""
    finer = numbers << np.maximum(octaves, 0)
    half = (1 << np.maximum(-octaves, 1)) >> 1
    coarser = (numbers + half) >> np.maximum(-octaves, 0)
    return np.where(octaves < 0, coarser, finer).clip(1 - LARGEST // 2, LARGEST // 2 - 1)


def residuals_of(numbers: np.ndarray, octaves: np.ndarray, source: np.ndarray | None) -> np.ndarray:
    """Subtract the predictions from the numbers (N, K), in each stroke's step sizes; the first stroke is unchanged."""
    if source is None or len(numbers) < 2:
        return numbers
    residuals = numbers.copy()
    residuals[1:] -= rescale(numbers[source], octaves[source] - octaves)[1:]
    return residuals


def restore_numbers(residuals: np.ndarray, octaves: np.ndarray, source: np.ndarray | None) -> np.ndarray:
    """Restore the numbers (N, K) from the output of `residuals_of`."""
    if source is None or len(residuals) < 2:
        return residuals
    numbers, finer = residuals.copy(), octaves[source] - octaves
    for stroke in range(1, len(numbers)):
        numbers[stroke] += rescale(numbers[source[stroke]], finer[stroke])
    return numbers


def rgb_to_ycocg(residuals: np.ndarray) -> np.ndarray:
    """Convert residuals of red, green and blue (N, 3) losslessly to luma and two chroma values (YCoCg-R)."""
    red, green, blue = residuals.T
    orange = red - blue
    middle = blue + (orange >> 1)
    magenta = green - middle
    return np.stack([middle + (magenta >> 1), orange, magenta], axis=1)


def ycocg_to_rgb(ycocg: np.ndarray) -> np.ndarray:
    """Convert luma and chroma values (N, 3) back to red, green and blue; the inverse of `rgb_to_ycocg`."""
    luma, orange, magenta = ycocg.T
    middle = luma - (magenta >> 1)
    blue = middle - (orange >> 1)
    return np.stack([blue + orange, magenta + middle, blue], axis=1)
