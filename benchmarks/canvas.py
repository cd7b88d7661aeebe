"""Whether a canvas on disk costs the same per megapixel at any size, and what two workers gain.

    python benchmarks/canvas.py             (4, 16 and 64 megapixels; about a quarter of an hour on two idle cores)
    python benchmarks/canvas.py --sizes 4 16

The picture is a mirrored mosaic of samples of scikit-image, the same content at every size. Every table is one run:
read the ratios, not the seconds.
"""

import argparse
import json
import math
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image
from skimage import data

SAMPLES = ("astronaut", "coffee", "chelsea", "rocket")
PATCH = 256  # pixels of a side of the pieces of the mosaic
SETTINGS = ("look=plain", "steps=40", "report=false", "pyramid=none")


def mosaic(side: int) -> Image.Image:
    """Make a picture of ``side`` x ``side`` pixels out of pieces of samples, each turned and mirrored at random."""
    random = np.random.default_rng(0)
    pieces = [getattr(data, name)()[:PATCH, :PATCH, :3] for name in SAMPLES]
    count = -(-side // PATCH)
    rows = []
    for _ in range(count):
        chosen = [np.rot90(pieces[random.integers(len(pieces))], random.integers(4)) for _ in range(count)]
        rows.append(np.concatenate(chosen, axis=1)[:, :side])
    return Image.fromarray(np.concatenate(rows)[:side])


def painted(picture: Path, folder: Path, workers: int) -> dict[str, float]:
    """Paint a picture with so many workers in a process of its own, and return its figures."""
    words = [str(picture), f"canvas={folder / 'canvas.zarr'}", f"output={folder / 'run'}", f"workers={workers}"]
    subprocess.run([sys.executable, "-m", "brushexp", *words, *SETTINGS], check=True)
    figures: dict[str, float] = json.loads((folder / "run" / "metrics.json").read_text())
    return figures


def main() -> None:
    """Print a row for each size and number of workers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[4, 16, 64], help="megapixels")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2], help="of the smallest size; the last of all")
    options = parser.parse_args()
    Image.MAX_IMAGE_PIXELS = None
    print("| megapixels | strokes | workers | seconds | per megapixel | PSNR | seams | MB of a worker |")
    print("|---|---|---|---|---|---|---|---|")
    for megapixels in options.sizes:
        for workers in options.workers if megapixels == min(options.sizes) else options.workers[-1:]:
            with TemporaryDirectory() as folder:
                mosaic(round(math.sqrt(megapixels * 1e6))).save(
                    picture := Path(folder, "picture.png"), compress_level=1
                )
                figures = painted(picture, Path(folder), workers)
            seconds = figures["seconds"]
            print(
                f"| {megapixels} | {figures['n_strokes']:,} | {workers} | {seconds:.0f} "
                f"| {seconds / figures['megapixels']:.2f} | {figures['psnr']:.2f} | {figures['seams']:.3f} "
                f"| {figures['worker_memory_mb']:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
