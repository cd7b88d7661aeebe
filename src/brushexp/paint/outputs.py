"""What a finished painting leaves in its folder."""

from __future__ import annotations

import math
from pathlib import Path

import torch
from torch import Tensor

from brushexp.blend.base import Blend
from brushexp.files import to_bytes
from brushexp.order.base import front_to_back
from brushexp.paint.bands import bands
from brushexp.renderer.base import Renderer
from brushexp.strokes.storage import Saved


@torch.no_grad()
def render(saved: Saved, renderer: Renderer, blend: Blend, resolution: int) -> Tensor:
    """Paint a catalogue at any size, crisp: the strokes are scaled, not the picture.

    Args:
        saved: the catalogue.
        renderer: draws its strokes.
        blend: lays them over each other.
        resolution: longer side in pixels.

    Returns:
        (H, W, 3) uint8.
    """
    height, width = saved.size
    zoom = resolution / max(height, width)
    height, width = max(1, round(height * zoom)), max(1, round(width * zoom))
    picture = torch.empty(height, width, 3, dtype=torch.uint8)
    order = front_to_back(saved.depth)
    strokes = saved.strokes.moved(zoom=zoom)
    for top, band in bands(strokes, order, (height, width), saved.background, renderer, blend):
        picture[top : top + band.shape[1]] = torch.from_numpy(to_bytes(band))
    return picture


def summary_line(folder: Path, metrics: dict[str, object]) -> str:
    """One line per result: where the painting is, how good, how long."""
    psnr, ssim, seconds = metrics["psnr"], metrics["ssim"], metrics["seconds"]
    quality = f"{psnr:.2f} dB" if isinstance(psnr, float) and math.isfinite(psnr) else "identical to the target"
    if ssim is not None:
        quality += f", SSIM {ssim:.3f}"
    strokes = f"{metrics['n_strokes']} strokes in {seconds:.1f} s"
    return f"{folder / 'painting.png'}: {quality}, {strokes} ({metrics['seconds_total']:.1f} s in all)"
