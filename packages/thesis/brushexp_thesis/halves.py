"""Measure a painting's quality separately in the flat half and in the detailed half of its target."""

import torch
from torch import Tensor

from brushexp.contracts import register
from brushexp.contracts.families import Comparison, Metric
from brushexp.contracts.pictures import psnr_of

WINDOWS = 16  # number of windows along the shorter side of a picture


def variation(target: Tensor) -> Tensor:
    """Compute the standard deviation (H, W) of the colours of a ``target`` (3, H, W) in a square around each pixel."""
    from scipy.ndimage import uniform_filter  # noqa: PLC0415  (--help does not need it)

    side = max(3, min(target.shape[1:]) // WINDOWS)
    channels = target.double().cpu().numpy()
    squares, means = (uniform_filter(values, (1, side, side)) for values in (channels**2, channels))
    return torch.from_numpy((squares - means**2).clip(0).sum(0) ** 0.5)


class Half(Metric):
    """PSNR over half of the pixels: those around which the target varies either most or least."""

    unit, digits = "dB", 2
    higher_is_better = True
    matters = 0.1
    busy: bool

    def __call__(self, comparison: Comparison) -> float:
        errors = (comparison.image - comparison.target).double().square().mean(0).cpu().flatten()
        by_variation = errors[variation(comparison.target).flatten().argsort(stable=True)]
        middle = len(errors) // 2
        return psnr_of(float((by_variation[middle:] if self.busy else by_variation[:middle]).mean()))


@register("metric", "psnr_flat")
class FlatHalf(Half):
    """PSNR over the half of the pixels around which the target varies least."""

    title, busy = "PSNR of the flat half", False


@register("metric", "psnr_busy")
class BusyHalf(Half):
    """PSNR over the half of the pixels around which the target varies most."""

    title, busy = "PSNR of the busy half", True
