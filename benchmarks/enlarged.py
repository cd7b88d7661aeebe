"""How much of the finest detail of a simulated stroke `renderer=textured` still has when a painting is enlarged.

    python benchmarks/enlarged.py            a table
    python benchmarks/enlarged.py STROKE.png and draws them, simulated above, textured below

A stroke that is so many pixels wide at 4096 px, and seven times as long, is simulated at that size, and drawn with each
texture. The energy of the finest octave is the mean square of the coverage less what a Gaussian of 1 pixel keeps of it,
that of the next one, of the latter less what a Gaussian of 2 pixels keeps.
"""

import sys
from pathlib import Path

import brushexp  # noqa: F401  (before torch: it sets how threads wait)

# isort: split
import numpy as np
import torch
from PIL import Image
from scipy.ndimage import gaussian_filter

from brushexp.config.publish import prepare
from brushexp.plugins.renderer.base import window_pictures
from brushexp.registry import build_named
from brushexp.strokes.prior import width_parameter

ASPECT, INSET = 7, 0.8  # length in widths; half-windows from the middle to the ends
WIDE = (16, 32, 64, 96, 112)  # pixels at 4096: 2 to 14 of a painting of 512
SEEDS = 3


def pair(pixels: int, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Coverage (S, S) of one stroke, simulated and textured."""
    window = round(pixels * ASPECT / INSET)
    width = INSET / ASPECT
    row = torch.tensor([[-INSET, 0, 0, 0, INSET, 0, width_parameter(width), 0, 0, 0]])
    engine = build_named("engine", "fluid", {"window": window, "supersample": 1, "brushes": 8})
    renderer = build_named("renderer", "textured", {}).requires_grad_(False)
    simulated = engine(row, seed=7, first=number).images[0, 3]
    return simulated.numpy(), window_pictures(renderer, row, window, torch.tensor([number]))[0, 3].numpy()


def octaves(picture: np.ndarray) -> tuple[float, float]:
    """Energy of the finest octave and of the next."""
    fine, coarse = gaussian_filter(picture, 1.0), gaussian_filter(picture, 2.0)
    return float(((picture - fine) ** 2).mean()), float(((fine - coarse) ** 2).mean())


if __name__ == "__main__":
    prepare(Path(__file__).parents[1])
    print("| stroke at 4096 px | finest octave | the next |\n|---|---:|---:|")
    for pixels in WIDE:
        pairs = [pair(pixels, number) for number in range(SEEDS)]
        found = np.array([[octaves(picture) for picture in two] for two in pairs]).sum(0)
        share = 100 * found[1] / found[0]
        print(f"| {pixels} px wide, {ASPECT * pixels} long | {share[0]:.0f} % | {share[1]:.0f} % |", flush=True)
    if len(sys.argv) > 1:
        both = np.concatenate([picture[len(picture) // 3 : -(len(picture) // 3)] for picture in pairs[0]])
        Image.fromarray((255 * (1 - both)).round().astype(np.uint8)).save(sys.argv[1])
