"""Sample the strokes of each view at random, each stroke with a probability equal to its confidence."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp.contracts.strokes import curve_of
from brushexp.contracts.strokes import measures as ruler
from brushexp_recovery.measure.measures import MEASURES, measure_strokes, summarise, summarise_neighbours
from brushexp_recovery.measure.views import View
from brushexp_recovery.raster.labels import count_pixels

Array = NDArray[Any]
Recover = Callable[[Array], Any]  # picture (H, W, 3) in [0, 1] -> recovered strokes: saved, confidence and labels
Draws: TypeAlias = dict[str, Array]  # (views, draws) for each of the `MEASURES`


@dataclass(frozen=True)
class Sighting:
    """The N strokes found in one view, in the coordinates of the photograph."""

    curve: torch.Tensor  # (N, 3, 2) float64, pixels of the photograph
    width: Array  # (N,)
    confidence: Array  # (N,)
    labels: Array  # (h, w), in pixels of the view
    view: View


def sight(image: Array, view: View, recover: Recover) -> Sighting:
    """Recover the strokes of a view, and map them back to the photograph."""
    size = image.shape[:2]
    recovered = recover(view.of(image))
    strokes = recovered.saved.strokes
    curve = torch.from_numpy(view.back(curve_of(strokes).double().numpy(), size))
    width = (strokes.width * strokes.scale).double().numpy() / view.zoom
    return Sighting(curve, width, np.asarray(recovered.confidence, float), np.asarray(recovered.labels), view)


def draw_figures(sightings: Iterable[Sighting], areas: Mapping[str, Array], draws: int, seed: int) -> dict[str, Draws]:
    """Sample the strokes of each view ``draws`` times, and measure each sample in each area (H, W).

    Returns `Draws` keyed by the names of the areas.
    """
    random = np.random.default_rng(seed)
    of_views: dict[str, list[Draws]] = {name: [] for name in areas}
    for sighting in sightings:  # one at a time, because sightings of a large photograph fill the memory
        for name, mask in areas.items():
            of_views[name].append(_draw_in(sighting, mask, draws, random))
    return {
        name: {measure: np.stack([one[measure] for one in views]) for measure in MEASURES}
        for name, views in of_views.items()
    }


def _draw_in(sighting: Sighting, mask: Array, draws: int, random: np.random.Generator) -> Draws:
    """Sample the strokes of a view in an area (H, W), and return the values (draws,) of each measure."""
    centre, direction = ruler.centre_of(sighting.curve), ruler.direction_of(sighting.curve)
    inside = _lies_in(centre.numpy(), mask)
    strokes = measure_strokes(sighting.curve, sighting.width)
    strokes["direction"] = (strokes["direction"] + sighting.view.turn) % 180  # cameras are not held level to the degree
    width = torch.from_numpy(sighting.width)
    shown = sighting.view.warp(mask.astype(float), order=0) >= 0.5
    share = count_pixels(np.where(shown, sighting.labels, -1), len(centre)) / max(shown.sum(), 1)
    rows = []
    for _ in range(draws):
        chosen = inside & (random.random(len(centre)) < sighting.confidence)
        columns = {name: column[chosen] for name, column in strokes.items()}
        figures = summarise(columns, mask.sum(), share[chosen].sum())
        rows.append(figures | summarise_neighbours(centre[chosen], direction[chosen], width[chosen]))
    return {name: np.array([row[name] for row in rows], float) for name in MEASURES}


def _lies_in(centre: Array, mask: Array) -> Array:
    """Check which of the positions (N, 2) are inside a mask (H, W)."""
    x, y = np.floor(centre).astype(int).T
    height, width = mask.shape
    on_picture = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return on_picture & mask[y.clip(0, height - 1), x.clip(0, width - 1)]
