"""Brushwork of a photograph of a painting, each figure with an interval.

Strokes are recovered from the photograph and from small changes of it (`measure_views`); from each, strokes are drawn
by their confidence, many times. A figure is the median of the draws, its interval holds 95 % of them: what the doubt
about strokes and the photograph leave open. Errors that recovery makes in every view are not in it; docs/recovery.md
has measured those.
"""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp.strokes import measures as ruler
from brushexp.strokes.bezier import curve_of, length_of
from brushexp_recovery.measure_views import View
from brushexp_recovery.raster.labels import count_pixels

log = logging.getLogger(__name__)

Array = NDArray[Any]
Recover = Callable[[Array], Any]  # of a picture (H, W, 3) in [0, 1]; has saved, confidence and labels

INTERVAL = (0.025, 0.975)
PAIRS = 4000  # of draws of two paintings whose differences are taken


@dataclass(frozen=True)
class Kind:
    """What is measured of a painting."""

    name: str
    unit: str = ""
    power: int = 0  # of pixels in it
    mm_unit: str = ""  # with a scale
    times: tuple[float, float] = (1.0, 1.0)  # pixels^power, or mm^power, in those units
    axial: bool = False  # whether it is a direction

    def factor(self, mm: float | None) -> float:
        """Return what a number in pixels is multiplied by; ``mm`` are millimetres of a pixel."""
        return self.times[0] if mm is None else self.times[1] * mm**self.power

    def unit_in(self, mm: float | None) -> str:
        """Return the unit that `factor` leads to."""
        return self.unit if mm is None else self.mm_unit or self.unit


KINDS = {
    "strokes": Kind("strokes"),
    "density": Kind("strokes per area", "per 1000 px^2", -2, "per cm^2", (1000.0, 100.0)),
    "covered": Kind("share covered by strokes"),
    "length": Kind("length, median", "px", 1, "mm"),
    "length_q25": Kind("length, 25 %", "px", 1, "mm"),
    "length_q75": Kind("length, 75 %", "px", 1, "mm"),
    "width": Kind("width, median", "px", 1, "mm"),
    "width_q25": Kind("width, 25 %", "px", 1, "mm"),
    "width_q75": Kind("width, 75 %", "px", 1, "mm"),
    "area": Kind("area, median", "px^2", 2, "mm^2"),
    "elongatedness": Kind("elongatedness, median"),
    "straightness": Kind("straightness, median"),
    "curvature": Kind("curvature, median", "°"),
    "direction": Kind("prevailing direction", "°", axial=True),
    "agreement": Kind("agreement of directions"),
    "coherence": Kind("local coherence, mean"),
    "homogeneity": Kind("homogeneity of breadth, mean"),
}


@dataclass(frozen=True)
class Sighting:
    """The N strokes of one view, on the canvas of the photograph."""

    curve: torch.Tensor  # (N, 3, 2) float64, pixels of the photograph
    width: Array  # (N,)
    confidence: Array  # (N,)
    labels: Array  # (h, w) of the view
    view: View


@dataclass(frozen=True)
class Interval:
    """A figure: the median of its draws and the bounds of 95 % of them; NaN where it is not defined."""

    value: float
    low: float
    high: float
    over_strokes: float  # standard deviation within a view, strokes drawn by their confidence
    over_views: float  # standard deviation of the means of the views


def sight(image: Array, view: View, recover: Recover) -> Sighting:
    """Recover the strokes of a view, and bring them back to the photograph."""
    size = image.shape[:2]
    found = recover(view.of(image))
    strokes = found.saved.strokes
    curve = torch.from_numpy(view.back(curve_of(strokes).double().numpy(), size))
    width = (strokes.width * strokes.scale).double().numpy() / view.zoom
    return Sighting(curve, width, np.asarray(found.confidence, float), np.asarray(found.labels), view)


def table_of(curve: torch.Tensor, width: Array) -> dict[str, Array]:
    """Measure strokes (N,) by `brushexp.strokes.measures`: pixels, and degrees in [0, 180) clockwise."""
    length, broad = length_of(curve), torch.from_numpy(width)
    direction = ruler.direction_of(curve)
    values = {
        "length": length,
        "width": broad,
        "area": ruler.area_of(length, broad),
        "elongatedness": length / broad.clamp_min(1e-6),
        "straightness": ruler.straightness_of(curve, length),
        "curvature": ruler.curvature_of(curve).rad2deg(),
        "direction": (0.5 * torch.atan2(direction[:, 1], direction[:, 0])).rad2deg() % 180,
    }
    return {name: value.numpy() for name, value in values.items()}


def draws_of(sightings: Iterable[Sighting], regions: dict[str, Array], draws: int, seed: int) -> dict[str, Array]:
    """Draw the strokes of each view ``draws`` times: figures (views, draws, `KINDS`) for each region (H, W)."""
    random, drawn = np.random.default_rng(seed), dict[str, list[Array]]()
    for one in sightings:  # one at a time: those of a large photograph fill the memory
        for name, mask in regions.items():
            drawn.setdefault(name, []).append(_draws(one, mask, draws, random))
    return {name: np.stack(values) for name, values in drawn.items()}


def _draws(sighting: Sighting, mask: Array, draws: int, random: np.random.Generator) -> Array:
    centre = ruler.centre_of(sighting.curve)
    inside, table = _inside(centre.numpy(), mask), table_of(sighting.curve, sighting.width)
    table["direction"] = (table["direction"] + sighting.view.turn) % 180  # a camera is not held level to a degree
    here = sighting.view.moved(mask.astype(float), order=0) >= 0.5
    pixels = count_pixels(np.where(here, sighting.labels, -1), len(centre)) / max(here.sum(), 1)
    direction, rows = ruler.direction_of(sighting.curve), []
    for _ in range(draws):
        chosen = inside & (random.random(len(centre)) < sighting.confidence)
        figures = _figures({name: column[chosen] for name, column in table.items()}, mask.sum(), pixels[chosen].sum())
        figures |= _neighbours(centre[chosen], direction[chosen], torch.from_numpy(sighting.width[chosen]))
        rows.append([figures[name] for name in KINDS])
    return np.array(rows)


def _inside(centre: Array, mask: Array) -> Array:
    x, y = np.floor(centre).astype(int).T
    height, width = mask.shape
    on = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return on & mask[y.clip(0, height - 1), x.clip(0, width - 1)]


def _figures(table: dict[str, Array], pixels: int, covered: float) -> dict[str, float]:
    count = len(table["length"])
    figures = {"strokes": count, "density": count / pixels, "covered": covered}
    for name in ("length", "width", "area", "elongatedness", "straightness", "curvature"):
        figures[name] = np.median(table[name]) if count else np.nan
    for name in ("length", "width"):
        for quarter in (25, 75):
            figures[f"{name}_q{quarter}"] = np.quantile(table[name], quarter / 100) if count else np.nan
    mean = np.exp(2j * np.radians(table["direction"])).mean() if count else np.nan
    return figures | {"direction": np.degrees(0.5 * np.angle(mean)) % 180, "agreement": abs(mean)}


def _neighbours(centre: torch.Tensor, direction: torch.Tensor, width: torch.Tensor) -> dict[str, float]:
    if len(centre) < 2:
        return {"coherence": np.nan, "homogeneity": np.nan}
    near = ruler.nearest_strokes(centre, centre, exclude_self=True)
    coherence, homogeneity = ruler.coherence_of(direction, near), ruler.homogeneity_of(width, near)
    return {"coherence": float(coherence.mean()), "homogeneity": float(homogeneity.mean())}


def intervals_of(draws: Array, mm: float | None = None) -> dict[str, Interval]:
    """Sum up draws (views, draws, `KINDS`), in pixels, or in millimetres if ``mm`` are those of a pixel."""
    return {
        name: _interval(draws[..., number] * kind.factor(mm), kind.axial)
        for number, (name, kind) in enumerate(KINDS.items())
    }


def _interval(values: Array, axial: bool) -> Interval:
    finite = values[np.isfinite(values)]
    if not len(finite):
        return Interval(*[np.nan] * 5)
    about = np.degrees(0.5 * np.angle(np.exp(2j * np.radians(finite)).mean())) if axial else 0.0
    turned = (values - about + 90) % 180 - 90 if axial else values
    low, middle, high = np.nanquantile(turned, [INTERVAL[0], 0.5, INTERVAL[1]])
    defined = turned[np.isfinite(turned).all(1)]
    within, between = (defined.std(1).mean(), defined.mean(1).std()) if len(defined) else (np.nan, np.nan)
    value = (middle + about) % 180 if axial else middle
    return Interval(
        float(value), float(value + low - middle), float(value + high - middle), float(within), float(between)
    )


def compare(one: Array, other: Array, mm: tuple[float | None, float | None], seed: int) -> dict[str, Interval]:
    """Take the differences (first less second) of draws of two paintings, in millimetres if both scales are known."""
    random, differences = np.random.default_rng(seed), {}
    known = None not in mm
    for number, (name, kind) in enumerate(KINDS.items()):
        a, b = (
            draws[..., number].ravel() * kind.factor(scale if known else None)
            for draws, scale in zip((one, other), mm, strict=True)
        )
        gap = random.choice(a, PAIRS) - random.choice(b, PAIRS)
        differences[name] = _interval(((gap + 90) % 180 - 90 if kind.axial else gap)[None], axial=False)
    return differences


def is_apart(difference: Interval) -> bool:
    """Tell whether an interval of a difference leaves out 0."""
    return difference.low > 0 or difference.high < 0
