"""Measure strokes and paintings; each measure has a scale on which its errors are additive."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from brushexp.contracts.results import measure_strokes
from brushexp.contracts.strokes import Strokes, curve_of, half_width_of, is_visible, length_of, pitch_of
from brushexp.contracts.strokes import measures as ruler

Array = NDArray[Any]

HALF_TURN = 180.0  # period of directions in degrees
SMALLEST_SIZE = 1e-3  # lower bound of lengths and widths, in pitches
SHOWN = 0.1  # visible share below which a stroke does not count


@dataclass(frozen=True)
class Kind:
    """The properties of a measure."""

    name: str
    unit: str = ""
    axial: bool = False  # whether the measure is a direction, in degrees
    power: int = 0  # power of pixels in its unit; errors are measured in pitches
    is_factor: bool = False  # whether errors are factors, that is, differences of logarithms
    high: float = math.inf  # largest possible value; the smallest is 0

    def inner(self, values: Array, pitch: float) -> Array:
        """Convert values to the scale on which errors are additive; ``pitch`` is the stroke spacing in pixels."""
        values = values / pitch**self.power
        return np.log(np.maximum(values, SMALLEST_SIZE)) if self.is_factor else values

    def outer(self, values: Array, pitch: float) -> Array:
        """Convert values from the scale of `inner` back to their unit."""
        return (np.exp(values) if self.is_factor else values) * pitch**self.power

    def clamp(self, values: Array) -> Array:
        """Clamp values on the scale of `inner` to their possible range."""
        return values if self.is_factor or self.axial else np.clip(values, 0, self.high)


STROKE_KINDS = {
    "direction": Kind("direction", "°", axial=True),
    "length": Kind("length", "px", power=1, is_factor=True),
    "width": Kind("width", "px", power=1, is_factor=True),
}
PAINTING_KINDS = {
    "direction": Kind("prevailing direction", "°", axial=True),
    "agreement": Kind("agreement of directions", high=1.0),
    "coherence": Kind("local coherence, mean", high=1.0),
    "length": Kind("length, median", "px", power=1, is_factor=True),
    "width": Kind("width, median", "px", power=1, is_factor=True),
    "elongatedness": Kind("elongatedness, median", is_factor=True),
    "straightness": Kind("straightness, median", high=1.0),
    "curvature": Kind("curvature, median", "°", high=180.0),
    "colors": Kind("spread of colours, CIELAB"),
}


@torch.no_grad()
def measure_each(strokes: Strokes) -> dict[str, Array]:
    """Measure N strokes: direction in degrees in [0, 180), length and width in pixels, each (N,)."""
    curve = curve_of(strokes.map(torch.Tensor.double))
    turned = ruler.direction_of(curve)
    return {
        "direction": np.degrees(0.5 * np.arctan2(*turned.numpy().T[::-1])) % HALF_TURN,
        "length": length_of(curve).numpy(),
        "width": 2 * half_width_of(strokes).double().numpy(),
    }


def measure_painting(strokes: Strokes, size: tuple[int, int]) -> dict[str, float]:
    """Compute the measures in `PAINTING_KINDS` for a painting (H, W) from its strokes, ordered bottom to top.

    Strokes are included if a fraction of at least `SHOWN` is visible. The spread of colours is the root mean square
    distance in CIELAB between a stroke's colour and the mean colour. Measures are NaN if no stroke is included.
    """
    from skimage.color import rgb2lab  # noqa: PLC0415  (slow to import)

    kept = strokes[is_visible(strokes, pitch_of(strokes, size))]
    depth = torch.arange(len(kept), dtype=torch.int32)
    seen = torch.from_numpy(measure_strokes(kept, depth, size).visible >= SHOWN) if len(kept) else depth.bool()
    kept = kept[seen]
    if not len(kept):
        return dict.fromkeys(PAINTING_KINDS, float("nan"))
    lab = rgb2lab(kept.color.numpy()[None].clip(0, 1))[0]
    table = measure_strokes(kept, torch.arange(len(kept), dtype=torch.int32), size)
    mean = axial_mean(np.degrees(table.orientation))
    medians = {name: middle(table[name]) for name in ("length", "width", "elongatedness", "straightness")}
    return {
        "direction": float(mean.direction),
        "agreement": float(mean.agreement),
        "coherence": float(table.coherence[np.isfinite(table.coherence)].mean()) if len(kept) > 1 else float("nan"),
        **medians,
        "curvature": middle(np.degrees(table.curvature)),
        "colors": float(np.sqrt(((lab - lab.mean(0)) ** 2).sum(1).mean())),
    }


def middle(values: Array) -> float:
    """Compute the median of the defined values."""
    return float(np.median(values[np.isfinite(values)])) if np.isfinite(values).any() else float("nan")


class AxialMean(NamedTuple):
    """The mean of directions, computed from doubled angles (Mardia and Jupp, 2000)."""

    direction: Array  # degrees in [0, 180)
    agreement: Array  # 1 if all directions are equal, 0 if no mean exists


def axial_mean(degrees: Array) -> AxialMean:
    """Average directions in degrees over the first axis, ignoring NaN."""
    doubled = np.exp(2j * np.radians(degrees))
    count = np.isfinite(degrees).sum(0)
    mean = np.where(np.isfinite(degrees), doubled, 0).sum(0) / np.where(count, count, np.nan)
    return AxialMean(np.degrees(0.5 * np.angle(mean)) % HALF_TURN, np.abs(mean))
