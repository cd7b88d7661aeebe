"""Group dynamics: how well directions, lengths and widths of neighbourhoods are found, whichever strokes they are of.

Around each known stroke that counts, the mean direction, coherence, mean length and mean width of the nearest known
strokes are compared with those of the nearest found ones. No stroke need be matched.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp.strokes.measures import NEIGHBOURS, centre_of, direction_of, mean_direction, nearest_strokes
from brushexp_recovery.given import Given
from brushexp_recovery.outlines import lengths_of
from brushexp_recovery.truth import Truth

Array = NDArray[Any]

FIELDS = ("field_direction_deg", "field_coherence", "field_length_rel", "field_width_rel")
DIRECTED = 0.3  # coherence from which on a neighbourhood has a direction


def field_errors(truth: Truth, given: Given, known: Array, found: Array) -> dict[str, float]:
    """Compute medians of the errors of neighbourhoods; ``known`` and ``found`` (N,) are the strokes that count.

    Direction in degrees, coherence as it is, length and width as shares of the true ones.
    """
    if not known.any() or not found.any():
        return dict.fromkeys(FIELDS, float("nan"))
    places = centre_of(torch.from_numpy(truth.curve[known].astype(float)))
    one = fields_at(places, truth.curve[known], truth.width[known])
    other = fields_at(places, given.curve[found], given.width[found])
    turn = np.angle(one["direction"] * other["direction"].conj()) / 2
    directed = np.abs(one["direction"]) >= DIRECTED
    errors = {
        "field_direction_deg": np.degrees(np.abs(turn[directed])),
        "field_coherence": np.abs(np.abs(one["direction"]) - np.abs(other["direction"])),
        "field_length_rel": np.abs(other["length"] / one["length"] - 1),
        "field_width_rel": np.abs(other["width"] / one["width"] - 1),
    }
    return {name: float(np.median(value)) if len(value) else float("nan") for name, value in errors.items()}


def fields_at(places: torch.Tensor, curve: Array, width: Array) -> dict[str, Array]:
    """Average the strokes that are nearest to places (Q, 2): doubled direction (complex), length and width (Q,)."""
    lines = torch.from_numpy(curve.astype(float))
    near = nearest_strokes(places, centre_of(lines), NEIGHBOURS, exclude_self=False)
    index = near.numpy()
    mean = mean_direction(direction_of(lines), near).numpy()
    length = lengths_of(curve) + width
    return {"direction": mean @ np.array([1, 1j]), "length": length[index].mean(1), "width": width[index].mean(1)}
