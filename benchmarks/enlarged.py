"""Measure how much of the finest detail in simulated strokes `renderer=textured` preserves in enlarged paintings.

    python benchmarks/enlarged.py            print a table
    python benchmarks/enlarged.py STROKE.png also draw the strokes: simulated above, textured below

Strokes of several widths at 4096 px, each seven times as long as it is wide, are simulated at that size and
drawn with several textures. The energy in the finest octave is the mean squared difference between the coverage and the
coverage blurred by a Gaussian of 1 pixel. The energy in the next octave is the mean squared difference between blurs of
1 and 2 pixels.
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

ASPECT, INSET = 7, 0.8  # length in widths; distance from the middle to the ends in half-windows
WIDE = (16, 32, 64, 96, 112)  # pixels at 4096 px: 2 to 14 at 512 px
SEEDS = 3


def pair(pixels: int, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the coverage (S, S) of one stroke twice: as simulated, and as drawn by the textured renderer."""
    window = round(pixels * ASPECT / INSET)
    width = INSET / ASPECT
    row = torch.tensor([[-INSET, 0, 0, 0, INSET, 0, width_parameter(width), 0, 0, 0]])
    engine = build_named("engine", "fluid", {"window": window, "supersample": 1, "brushes": 8})
    renderer = build_named("renderer", "textured", {}).requires_grad_(False)
    simulated = engine(row, seed=7, first=number).images[0, 3]
    return simulated.numpy(), window_pictures(renderer, row, window, torch.tensor([number]))[0, 3].numpy()


def octaves(picture: np.ndarray) -> tuple[float, float]:
    """Return the energies in the finest octave and in the next coarser octave of a picture."""
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
