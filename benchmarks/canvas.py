"""Measure how the cost per megapixel of a canvas on disk depends on its size, and how much two workers speed it up.

    python benchmarks/canvas.py             (4, 16 and 64 megapixels; about ten minutes on two idle cores)
    python benchmarks/canvas.py --sizes 4 16 64 100
    python benchmarks/canvas.py --grids 1024 900    errors along each grid's tile borders, relative to the other grid

The picture is filled with mirrored copies of scikit-image's coffee, so that tile borders cross every part of the
photograph and no edges appear between the copies. At 4 megapixels, no two tiles are painted at the same time. Every
table comes from a single run: compare the ratios, not the seconds.
"""

import argparse
import json
import math
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import zarr
from brushexp_canvases.tile import SEAM
from PIL import Image
from skimage import data

SMALL = 16  # megapixels
FAR = 40  # pixels from a border beyond which a pixel counts as far from it
SETTINGS = ("look=even", "steps=40", "report=false", "pyramid=none")


def mirror_photograph(side: int) -> Image.Image:
    """Fill a picture of ``side`` x ``side`` pixels with mirrored copies of a photograph, without visible joins."""
    picture = data.coffee()
    more = [(0, max(0, side - length)) for length in picture.shape[:2]]
    return Image.fromarray(np.pad(picture, [*more, (0, 0)], mode="symmetric")[:side, :side])


def paint_canvas(picture: Path, folder: Path, workers: int, *more: str) -> dict[str, float]:
    """Paint a picture with ``workers`` workers in a separate process, and return the metrics of the run."""
    words = [str(picture), f"canvas={folder / 'canvas.zarr'}", f"output={folder / 'run'}", f"workers={workers}", *more]
    subprocess.run([sys.executable, "-m", "brushexp", *words, *SETTINGS], check=True)
    figures: dict[str, float] = json.loads((folder / "run" / "metrics.json").read_text())
    return figures


def tell_seams(grids: tuple[int, int], workers: int) -> None:
    """Print the errors along the borders of two grids, each relative to the other grid's error at the same pixels."""
    errors, distances = [], []
    with TemporaryDirectory() as folder:
        mirror_photograph(side := round(math.sqrt(SMALL * 1e6))).save(
            picture := Path(folder, "picture.png"), compress_level=1
        )
        for tile in grids:
            paint_canvas(picture, own := Path(folder, str(tile)), workers, f"tile={tile}")
            root = zarr.open_group(own / "canvas.zarr", mode="r")
            painting, target = (root[name]["0"][:].astype(np.float32) for name in ("painting", "target"))
            errors.append(np.square(painting - target).sum(0))
            away = np.abs(np.arange(side)[:, None] + 0.5 - np.arange(tile, side, tile)).min(1)
            distances.append(np.minimum(away[:, None], away))
    for k, tile in enumerate(grids):
        places = (distances[k] < SEAM) & (distances[1 - k] > FAR)
        print(f"tile={tile}: {errors[k][places].mean() / errors[1 - k][places].mean():.3f}")


def main() -> None:
    """Print a row for each size and number of workers, or the errors along tile borders."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[4, 16, 64], help="megapixels")
    words = f"all are used up to {SMALL} megapixels, only the last above"
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2], help=words)
    parser.add_argument("--grids", type=int, nargs=2, help=f"sides of tiles; paints {SMALL} megapixels")
    options = parser.parse_args()
    if options.grids:
        tell_seams(options.grids, options.workers[-1])
        return
    Image.MAX_IMAGE_PIXELS = None
    print("| megapixels | strokes | workers | seconds | per megapixel | PSNR | seams | MB of a worker |")
    print("|---|---|---|---|---|---|---|---|")
    for megapixels in options.sizes:
        for workers in options.workers if megapixels <= SMALL else options.workers[-1:]:
            with TemporaryDirectory() as folder:
                mirror_photograph(round(math.sqrt(megapixels * 1e6))).save(
                    picture := Path(folder, "picture.png"), compress_level=1
                )
                figures = paint_canvas(picture, Path(folder), workers)
            seconds = figures["seconds"]
            print(
                f"| {megapixels} | {figures['n_strokes']:,} | {workers} | {seconds:.0f} "
                f"| {seconds / figures['megapixels']:.2f} | {figures['psnr']:.2f} | {figures['seams']:.3f} "
                f"| {figures['worker_memory_mb']:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
