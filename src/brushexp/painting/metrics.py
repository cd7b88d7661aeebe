"""How good a finished painting is."""

import math

import numpy as np
import torch
from torch import Tensor

from brushexp.features.distance import Distance, perceptual_distance
from brushexp.plugins.loss.ssim import RADIUS, dissimilarity, statistics


def picture_psnr(painting: np.ndarray, target: np.ndarray) -> float:
    """PSNR (dB) of two 8-bit pictures of one shape; infinite for equal ones."""
    return psnr_of(float(np.square((painting.astype(np.float64) - target) / 255).mean()))


@torch.no_grad()
def measure(
    painting: np.ndarray, target: np.ndarray, lpips: Distance | None = None, focus: Tensor | None = None
) -> dict[str, float | str | None]:
    """Metrics of two 8-bit RGB pictures (H, W, 3) as they are saved, over all pixels.

    They are psnr (dB, infinite for equal pictures), ssim (Wang et al., 2004; None for a picture smaller than its
    window), l1 (mean |difference|, 0 to 1), edges (the same of the differences between neighbouring pixels: how well
    edges are kept; None without neighbours), perceptual (distance in the network perceptual_backbone); with ``lpips``
    the metric of its label, lpips_alexnet for instance; with ``focus`` (H, W) psnr_focus, of the mean squared error
    weighted so.
    """
    a, b = (torch.from_numpy(picture).permute(2, 0, 1).to(torch.float32) / 255 for picture in (painting, target))
    squares, slopes = (a - b).double().square(), [(a - b).diff(dim=axis).abs().flatten() for axis in (1, 2)]
    found: dict[str, float | str | None] = {"psnr": psnr_of(float(squares.mean()))}
    if focus is not None:
        weights = focus.cpu().double()
        found["psnr_focus"] = psnr_of(float((squares * weights / weights.mean()).mean()))
    is_wide = min(painting.shape[:2]) >= 2 * RADIUS + 1
    found |= {
        "ssim": 1 - float(dissimilarity(a, b, *statistics(b)).mean()) if is_wide else None,
        "l1": float((a - b).abs().mean()),
        "edges": float(torch.cat(slopes).mean()) if any(map(len, slopes)) else None,
        "perceptual": perceptual_distance(a, b),
        "perceptual_backbone": "effl0",
    }
    if lpips is not None:
        found[lpips.label.replace("-", "_")] = float(lpips(a, b))
    return found


def psnr_of(mean_squared_error: float) -> float:
    """Peak signal-to-noise ratio in dB of pictures in [0, 1]."""
    return -10 * math.log10(mean_squared_error) if mean_squared_error > 0 else math.inf
