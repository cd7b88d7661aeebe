"""Measure the fraction of pixels in saved paintings that show over a tenth of the ground, and the median stroke bend.

python benchmarks/ground.py outputs/a/catalogue.h5 outputs/b/catalogue.h5
"""

import sys
from pathlib import Path

import torch

sys.path.insert(0, str(Path(__file__).parents[1] / "src"))
from brushexp.compositing.bands import bands
from brushexp.painting.reopen import renderer_of
from brushexp.registry import build_named
from brushexp.registry.loading import load_plugins
from brushexp.strokes.bezier import shape_of
from brushexp.strokes.measures import curvature_of
from brushexp.strokes.storage import Saved, load_catalogue

VISIBLE = 0.1  # share of the light that passes through all strokes at a pixel


@torch.no_grad()
def ground_visible(saved: Saved) -> float:
    """Return the fraction of pixels at which more than a tenth of the light passes through all strokes."""
    renderer, blend, order = renderer_of(saved), build_named("blend", "tiled", {}), saved.depth.argsort(descending=True)
    on_white, on_black = (
        torch.cat(
            [band for _, band in bands(saved.strokes, order, saved.size, torch.full((3,), grey), renderer, blend)], 1
        )
        for grey in (1.0, 0.0)
    )
    return float(((on_white - on_black)[0] > VISIBLE).float().mean())


if __name__ == "__main__":
    load_plugins(Path(__file__).parents[1] / "plugins")
    print("| catalogue | strokes | ground visible | median bend |\n|---|---|---|---|")
    for path in map(Path, sys.argv[1:]):
        painting = load_catalogue(path)
        bend = curvature_of(shape_of(painting.strokes)).rad2deg().median()
        print(f"| {path} | {len(painting.strokes)} | {ground_visible(painting):.1%} | {bend:.0f}° |")
