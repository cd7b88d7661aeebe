"""How good a finished painting is."""

import math

import numpy as np
import torch
from torch import Tensor

from brushexp.features.distance import Distance, perceptual_distance

SSIM_WINDOW = 11  # pixels, side of the windows that SSIM compares


def measure(
    painting: np.ndarray, target: np.ndarray, lpips: Distance | None = None, focus: Tensor | None = None
) -> dict[str, float | str | None]:
    """Compare two 8-bit RGB pictures (H, W, 3) as they are saved, over all pixels.

    Args:
        painting: one.
        target: the other.
        lpips: one more distance to measure; it becomes the metric of its label, lpips_alexnet for instance.
        focus: (H, W) how much each pixel counts; adds psnr_focus, of the mean squared error weighted so.

    Returns:
        psnr (dB, infinite for equal pictures), ssim (Wang et al., 2004; None for a picture smaller than its window),
        l1 (mean |difference|, 0 to 1), edges (the same of the differences between neighbouring pixels: how well edges
        are kept), perceptual (distance in the network perceptual_backbone).
    """
    from torchmetrics.functional.image import (  # noqa: PLC0415  (takes seconds to import)
        peak_signal_noise_ratio,
        structural_similarity_index_measure,
    )

    a, b = _as_batch(painting), _as_batch(target)
    ssim = None
    if min(painting.shape[:2]) >= SSIM_WINDOW:
        ssim = float(structural_similarity_index_measure(a, b, data_range=1.0))  # type: ignore[arg-type]
    psnr = float(peak_signal_noise_ratio(a, b, data_range=1.0)) if bool((a != b).any()) else math.inf
    return {
        "psnr": psnr,
        **({} if focus is None else {"psnr_focus": focused_psnr(a[0], b[0], focus.cpu())}),
        "ssim": ssim,
        "l1": float((a - b).abs().mean()),
        "edges": edge_error(a, b),
        "perceptual": perceptual_distance(a[0], b[0]),
        "perceptual_backbone": "effl0",
        **({} if lpips is None else {lpips.label.replace("-", "_"): distance_of(lpips, a[0], b[0])}),
    }


def focused_psnr(image: Tensor, target: Tensor, focus: Tensor) -> float:
    """Peak signal-to-noise ratio in dB of two pictures (3, H, W), whose pixels count as ``focus`` (H, W) says."""
    weights = focus.double() / focus.double().mean()
    return psnr_of(float(((image - target).double().square() * weights).mean()))


@torch.no_grad()
def distance_of(distance: Distance, image: Tensor, target: Tensor) -> float:
    """Perceptual distance of two pictures (3, H, W)."""
    return float(distance(image, target))


def edge_error(image: Tensor, target: Tensor) -> float:
    """Mean |difference| of the slopes, from each pixel to the next one to the right and below, of (B, 3, H, W)."""
    error = image - target
    slopes = [error.diff(dim=axis).abs() for axis in (2, 3)]
    n = sum(slope.numel() for slope in slopes)
    return sum(float(slope.sum()) for slope in slopes) / n if n else 0.0


def psnr_of(mean_squared_error: float) -> float:
    """Peak signal-to-noise ratio in dB of pictures in [0, 1]."""
    return -10 * math.log10(mean_squared_error) if mean_squared_error > 0 else math.inf


def _as_batch(picture: np.ndarray) -> Tensor:
    return torch.from_numpy(picture).permute(2, 0, 1)[None].to(torch.float32) / 255
