"""What the thesis's top-k costs in dB: a finished painting drawn with the k uppermost strokes of each pixel.

python benchmarks/topk.py RUN [RUN ...]      folders of finished runs
"""

import sys
from pathlib import Path

import brushexp  # noqa: F401  (before torch: it sets how threads wait)

# isort: split
import numpy as np
import torch
from PIL import Image

from brushexp.app.command_line import prepare
from brushexp.painting.metrics import psnr_of
from brushexp.painting.outputs import export_job, renderer_of
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.blend.topk import TopK
from brushexp.plugins.export.png import pixels
from brushexp.strokes.storage import load_catalogue


def psnr(folder: Path, blend: Blend) -> float:
    """PSNR of a run's catalogue, drawn anew, against the run's target."""
    saved = load_catalogue(folder / "catalogue.h5")
    picture = pixels(export_job(saved, renderer_of(saved), blend, saved.renderer)).astype(np.float64)
    with Image.open(folder / "target.png") as image:
        target = np.asarray(image).astype(np.float64)
    return psnr_of(float(((picture - target) ** 2).mean()) / 255**2)


if __name__ == "__main__":
    prepare(Path(__file__).parents[1])
    torch.set_grad_enabled(False)
    blends: dict[str, Blend] = {"tiled": Tiled()} | {f"topk k={k}": TopK(k=k) for k in (4, 8, 16)}
    print(f"| painting | {' | '.join(blends)} |\n|{'---|' * (len(blends) + 1)}")
    for folder in map(Path, sys.argv[1:]):
        print(
            f"| {folder.name} | {' | '.join(f'{psnr(folder, blend):.2f}' for blend in blends.values())} |", flush=True
        )
