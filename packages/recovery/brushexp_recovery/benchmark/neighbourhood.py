"""Compute errors in the mean direction, length and width of neighbouring strokes, without matching strokes.

Around each scored known stroke, the mean direction, coherence, mean length and mean width of the nearest known strokes
are compared with those of the nearest predicted strokes.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp.contracts.strokes import NEIGHBOURS, centre_of, direction_of, mean_direction, nearest_strokes
from brushexp_recovery.benchmark.prediction import Prediction
from brushexp_recovery.benchmark.truth import Truth
from brushexp_recovery.curves.bezier import arc_lengths

Array = NDArray[Any]

ERRORS = ("field_direction_deg", "field_coherence", "field_length_rel", "field_width_rel")
LEAST_COHERENCE = 0.3  # minimum coherence of a neighbourhood with a defined direction


@dataclass(frozen=True)
class Neighbourhoods:
    """Means over the strokes nearest to each of Q points."""

    direction: Array  # (Q,) complex mean of doubled directions
    length: Array  # (Q,) pixels
    width: Array  # (Q,)

    @property
    def coherence(self) -> Array:
        """Agreement between the directions, 0 to 1."""
        return np.abs(self.direction)


def field_errors(truth: Truth, prediction: Prediction, known: Array, judged: Array) -> dict[str, float]:
    """Compute median errors over neighbourhoods; ``known`` and ``judged`` (N,) are masks of the scored strokes.

    Errors in direction are in degrees; errors in coherence are absolute; errors in length and width are relative to the
    truth.
    """
    if not known.any() or not judged.any():
        return dict.fromkeys(ERRORS, float("nan"))
    places = centre_of(torch.from_numpy(truth.curve[known].astype(float)))
    one = neighbourhoods_at(places, truth.curve[known], truth.width[known])
    other = neighbourhoods_at(places, prediction.curve[judged], prediction.width[judged])
    turn = np.angle(one.direction * other.direction.conj()) / 2
    errors = {
        "field_direction_deg": np.degrees(np.abs(turn[one.coherence >= LEAST_COHERENCE])),
        "field_coherence": np.abs(one.coherence - other.coherence),
        "field_length_rel": np.abs(other.length / one.length - 1),
        "field_width_rel": np.abs(other.width / one.width - 1),
    }
    return {name: float(np.median(value)) if len(value) else float("nan") for name, value in errors.items()}


def neighbourhoods_at(places: torch.Tensor, curve: Array, width: Array) -> Neighbourhoods:
    """Average the strokes nearest to points (Q, 2), given all curves (N, 3, 2) and widths (N,)."""
    lines = torch.from_numpy(curve.astype(float))
    near = nearest_strokes(places, centre_of(lines), NEIGHBOURS, exclude_self=False)
    index = near.numpy()
    mean = mean_direction(direction_of(lines), near).numpy()
    length = arc_lengths(curve) + width
    return Neighbourhoods(mean @ np.array([1, 1j]), length[index].mean(1), width[index].mean(1))
