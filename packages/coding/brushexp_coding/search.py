"""Search for the scale of all rounding steps: the coarsest scale for a given error, or the finest for a file size."""

from collections.abc import Callable

import numpy as np

from brushexp_coding.rounding import Rounded

MOST_TRIALS = 30  # maximum number of scales tried
BOLDEST = 4.0  # maximum ratio between the scales of consecutive trials
ENOUGH, AIM = 0.8, 0.92  # shares of the allowed error that end the search, and that a trial aims at
FULL, AIM_SIZE = 0.985, 0.995  # shares of the allowed size that end the search, and that a trial aims at


def coarsest(
    at: Callable[[float], Rounded], loss_of: Callable[[Rounded], float], allowed: float, scale: float, trials: int
) -> tuple[Rounded, float]:
    """Find approximately the largest scale at which the loss due to rounding is at most ``allowed``.

    After ``trials`` trials, the largest admissible scale found so far is returned; if there is none yet, the search
    continues.
    """
    best: tuple[Rounded, float] | None = None
    too_coarse = np.inf
    for trial in range(MOST_TRIALS):
        rounded = at(scale)
        share = loss_of(rounded) / allowed
        if share > 1:
            too_coarse = min(too_coarse, scale)
        elif best is None or scale > best[1]:
            best = rounded, scale
        if ENOUGH <= share <= 1 or not len(rounded) or (best is not None and trial + 1 >= trials):
            break
        fine = 0.0 if best is None else best[1]
        proposed = scale * min(max((AIM / share) ** 0.5, 1 / BOLDEST), BOLDEST)
        scale = proposed if fine < proposed < too_coarse else (max(fine, too_coarse / BOLDEST) * too_coarse) ** 0.5
    return (rounded, scale) if best is None else best


def finest(
    at: Callable[[float], Rounded],
    size_of: Callable[[Rounded], int],
    size: int,
    scale: float,
    trials: int,
    *,
    limits: tuple[float, float],
) -> tuple[Rounded, float] | None:
    """Find approximately the smallest scale within ``limits`` at which the file fits into ``size`` bytes.

    Returns None if the file is too large at every scale. The search assumes that halving the scale costs about one bit
    for each value of a stroke.
    """
    best: tuple[Rounded, float] | None = None
    too_fine = 0.0
    for trial in range(MOST_TRIALS):
        rounded = at(scale)
        share = size_of(rounded) / size
        if share > 1:
            too_fine = max(too_fine, scale)
        elif best is None or scale < best[1]:
            best = rounded, scale
        at_limit = scale <= limits[0] if share <= 1 else scale >= limits[1]
        if FULL <= share <= 1 or at_limit or (best is not None and trial + 1 >= trials):
            break
        octaves = (share - AIM_SIZE) * 8 * size / max(1, rounded.numbers.size)
        proposed = min(max(scale * min(max(2**octaves, 1 / BOLDEST), BOLDEST), limits[0]), limits[1])
        coarse = np.inf if best is None else best[1]
        between = (max(too_fine, coarse / BOLDEST) * min(coarse, too_fine * BOLDEST)) ** 0.5
        scale = proposed if too_fine < proposed < coarse else between
    return best
