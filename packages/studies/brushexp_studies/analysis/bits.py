"""The size of the strokes, so that counts of different primitives compare."""

import lzma

import numpy as np
import torch

from brushexp.contracts import register
from brushexp.contracts.families import Comparison, Metric
from brushexp.contracts.strokes import Strokes, curve_of, drift_of, half_width_of, softness_of

PLACES = 4  # steps of a pixel: of control points, width and softness
LEVELS = 255  # of a colour
OPACITIES = 63
WIDENINGS = 31  # to either side of 0


def quantised(strokes: Strokes) -> np.ndarray:
    """Round strokes to whole numbers (N, 16), int32: start, control and end from it, width, softness, and the rest.

    That is colour, opacity, widening and drift. Points, widths and softness are in quarters of a pixel, colours and
    drifts in 256 levels, opacities in 64 and widenings in 63. What lies farther away than a short integer can say is
    held at its end.
    """
    start, control, end = curve_of(strokes).unbind(1)
    across = torch.stack([2 * half_width_of(strokes), softness_of(strokes)], dim=1)
    lengths = torch.cat([start, control - start, end - start, across], dim=1) * PLACES
    shares = torch.stack([strokes.opacity * OPACITIES, strokes.widening * WIDENINGS], dim=1)
    numbers = torch.cat([lengths, strokes.color * LEVELS, shares, drift_of(strokes) * LEVELS], dim=1)
    limits = np.iinfo(np.int16)
    return numbers.round().clamp(limits.min, limits.max).to(torch.int32).cpu().numpy()


def packed(numbers: np.ndarray) -> bytes:
    """Compress whole numbers (N, 16) without loss: columns one after another, in low and high bytes (LZMA)."""
    columns = np.ascontiguousarray(numbers.T, "<i2").view(np.uint8).reshape(numbers.shape[1], -1, 2)
    filters = [{"id": lzma.FILTER_LZMA1, "preset": 9, "lc": 0, "lp": 0, "pb": 0}]
    return lzma.compress(columns.transpose(0, 2, 1).tobytes(), format=lzma.FORMAT_ALONE, filters=filters)


@register("metric", "bits")
class BitsPerPixel(Metric):
    """Bits per pixel that the strokes take, rounded (points to a quarter of a pixel) and packed without loss.

    Sixteen numbers of a stroke are free of each other: three points, width, colour, opacity, softness, widening and
    drift. The last three cost next to nothing where they are 0.
    """

    title, digits = "bits per pixel", 3
    higher_is_better = False
    needs = ("strokes",)

    def __call__(self, comparison: Comparison) -> float:
        assert comparison.strokes is not None
        return 8 * len(packed(quantised(comparison.strokes))) / comparison.target[0].numel()
