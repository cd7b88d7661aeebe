"""What a finished painting leaves in its folder."""

from __future__ import annotations

import math
from pathlib import Path

import torch
from torch import Tensor

from brushexp.blend.base import Blend
from brushexp.files import to_bytes
from brushexp.order.base import front_to_back
from brushexp.renderer.base import Renderer
from brushexp.strokes.storage import Saved

BAND = 2**22  # pixels that are painted at once, so that a huge picture needs little more memory than its bytes
LEAST = 64  # rows: bands do not get lower than this for the sake of the layers' memory


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
    strokes = saved.strokes.moved(zoom=zoom)
    picture = torch.empty(height, width, 3, dtype=torch.uint8)
    rows = renderer.rows(strokes)
    top, number = 0, torch.arange(len(strokes))
    while top < height:
        band = min(max(1, BAND // width), height - top)
        if rows is not None:
            number = _within(rows, top, band)
            while band > LEAST and len(number) > (renderer.at_once or len(number)):
                band = band // 2
                number = _within(rows, top, band)
        layers = renderer(strokes[number].moved(shift=(0, -top)), number)
        image = blend(layers, front_to_back(saved.depth[number]), (band, width), saved.background).image
        picture[top : top + band] = torch.from_numpy(to_bytes(image))
        top += band
    return picture


def _within(rows: Tensor, top: int, height: int) -> Tensor:
    """Numbers of the strokes whose rows (N, 2) meet the ``height`` rows from ``top`` on."""
    return ((rows[:, 1] > top) & (rows[:, 0] < top + height)).nonzero()[:, 0]


def summary_line(folder: Path, metrics: dict[str, object]) -> str:
    """One line per result: where the painting is, how good, how long."""
    psnr, ssim, seconds = metrics["psnr"], metrics["ssim"], metrics["seconds"]
    quality = f"{psnr:.2f} dB" if isinstance(psnr, float) and math.isfinite(psnr) else "identical to the target"
    if ssim is not None:
        quality += f", SSIM {ssim:.3f}"
    strokes = f"{metrics['n_strokes']} strokes in {seconds:.1f} s"
    return f"{folder / 'painting.png'}: {quality}, {strokes} ({metrics['seconds_total']:.1f} s in all)"
