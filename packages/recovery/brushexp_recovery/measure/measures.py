"""Define and compute the measures of strokes, with their names, units and scales."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp.contracts.strokes import length_of
from brushexp.contracts.strokes import measures as ruler

Array = NDArray[Any]

NARROWEST = 1e-6  # lower bound in pixels of widths used as divisors


@dataclass(frozen=True)
class Measure:
    """A quantity that is measured for all strokes of a painting together."""

    name: str
    unit: str = ""
    power: int = 0  # power of pixels in its unit
    mm_unit: str = ""  # unit if the scale is known
    times: tuple[float, float] = (1.0, 1.0)  # factors from pixels^power and mm^power to the two units
    axial: bool = False  # whether the figure is a direction
    share: bool = False  # whether the figure lies between 0 and 1

    def factor(self, mm: float | None) -> float:
        """Return the factor that converts pixels to the unit returned by `unit_in`; ``mm`` is millimetres per pixel."""
        return self.times[0] if mm is None else self.times[1] * mm**self.power

    def unit_in(self, mm: float | None) -> str:
        """Return the unit of values that have been multiplied by the result of `factor`."""
        return self.unit if mm is None else self.mm_unit or self.unit


MEASURES = {
    "strokes": Measure("strokes"),
    "density": Measure("strokes per area", "per 1000 px^2", -2, "per cm^2", (1000.0, 100.0)),
    "covered": Measure("share covered by strokes", share=True),
    "length": Measure("length from tip to tip, median", "px", 1, "mm"),
    "length_q25": Measure("length from tip to tip, 25 %", "px", 1, "mm"),
    "length_q75": Measure("length from tip to tip, 75 %", "px", 1, "mm"),
    "width": Measure("width, median", "px", 1, "mm"),
    "width_q25": Measure("width, 25 %", "px", 1, "mm"),
    "width_q75": Measure("width, 75 %", "px", 1, "mm"),
    "area": Measure("area, median", "px^2", 2, "mm^2"),
    "elongatedness": Measure("elongatedness, median"),
    "straightness": Measure("straightness, median", share=True),
    "curvature": Measure("curvature, median", "°"),
    "direction": Measure("prevailing direction", "°", axial=True),
    "agreement": Measure("agreement of directions", share=True),
    "coherence": Measure("local coherence, mean", share=True),
    "homogeneity": Measure("homogeneity of breadth, mean", share=True),
}
MEDIANS = ("length", "width", "area", "elongatedness", "straightness", "curvature")  # columns of strokes
QUARTILES = ("length", "width")


def measure_strokes(curve: torch.Tensor, width: Array) -> dict[str, Array]:
    """Measure each of N strokes with curves (N, 3, 2) and widths (N,), in pixels and clockwise degrees in [0, 180).

    Length is measured from tip to tip, as with a ruler on the painting: it is the arc length of the curve plus both
    round ends, which add one width. Elongatedness is this length divided by the width; it is 1 for a round dab.

    In `brushexp.strokes.measures`, by contrast, length is only the arc length of the curve, without the round ends.
    """
    arc, broad = length_of(curve), torch.from_numpy(width)
    direction = ruler.direction_of(curve)
    values = {
        "length": arc + broad,
        "width": broad,
        "area": ruler.area_of(arc, broad),
        "elongatedness": (arc + broad) / broad.clamp_min(NARROWEST),
        "straightness": ruler.straightness_of(curve, arc),
        "curvature": ruler.curvature_of(curve).rad2deg(),
        "direction": (0.5 * torch.atan2(direction[:, 1], direction[:, 0])).rad2deg() % 180,
    }
    return {name: value.numpy() for name, value in values.items()}


def summarise(strokes: dict[str, Array], pixels: int, covered: float) -> dict[str, float]:
    """Compute the measures that do not depend on neighbouring strokes, from columns (N,) of `measure_strokes`.

    ``pixels`` is the size of the measured area, and ``covered`` is the fraction of that area covered by strokes.
    """
    count = len(strokes["length"])
    figures = {"strokes": count, "density": count / pixels, "covered": covered}
    for name in MEDIANS:
        figures[name] = np.median(strokes[name]) if count else np.nan
    for name in QUARTILES:
        for percent in (25, 75):
            figures[f"{name}_q{percent}"] = np.quantile(strokes[name], percent / 100) if count else np.nan
    mean = np.exp(2j * np.radians(strokes["direction"])).mean() if count else np.nan
    return figures | {"direction": np.degrees(0.5 * np.angle(mean)) % 180, "agreement": abs(mean)}


def summarise_neighbours(centre: torch.Tensor, direction: torch.Tensor, width: torch.Tensor) -> dict[str, float]:
    """Compute the coherence and homogeneity of strokes, which measure their similarity to the nearest strokes.

    Strokes are given by their centres (N, 2), doubled directions (N, 2) and widths (N,).
    """
    if len(centre) < 2:
        return {"coherence": np.nan, "homogeneity": np.nan}
    near = ruler.nearest_strokes(centre, centre, exclude_self=True)
    coherence = ruler.coherence_of(direction, near)
    homogeneity = ruler.homogeneity_of(width, near)
    return {"coherence": float(coherence.mean()), "homogeneity": float(homogeneity.mean())}
