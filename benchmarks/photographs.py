"""Measure the time and memory of default paintings of 1 to 50 megapixels, and how many pixels each stroke needs.

    python benchmarks/photographs.py                     whole runs, relative to a photograph 1,024 pixels wide
    python benchmarks/photographs.py --pixels            PSNR and seconds against working pixels per stroke

The photographs are enlarged scikit-image samples with added grain. Each is painted in a separate process, after an
untimed run that compiles the kernels.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image

from brushexp.pictures.load import load_picture, samples
from brushexp.pictures.similarity import picture_psnr

ROOT = Path(__file__).parents[1]
SIDES = {"1,024 px": 1024, "12 MP": 4000, "50 MP": 8160}
GRAIN = 4  # standard deviation, levels of 255
KILOBYTES_PER_MB = 1024
STROKES = 8_000
PIXELS = (10, 20, 40, 80, 160)  # working pixels per stroke
SEEN_SIDE = 2048  # side in pixels at which paintings are compared with the photograph


def make_photograph(name: str, side: int, folder: Path) -> Path:
    """Crop a sample to 4:3, enlarge it to ``side`` pixels on its longer side, add grain, and save it as a JPEG."""
    sample = Image.open(samples()[name]).convert("RGB")
    height, width = side * 3 // 4, side
    fitted = sample.crop((0, 0, sample.width, min(sample.height, sample.width * 3 // 4)))
    pixels = np.asarray(fitted.resize((width, height), Image.Resampling.LANCZOS), dtype=np.int16)
    grain = np.random.default_rng(0).normal(0, GRAIN, (height, width, 1)).astype(np.int16)
    path = folder / f"{name}_{side}.jpg"
    Image.fromarray((pixels + grain).clip(0, 255).astype(np.uint8)).save(path, quality=92)
    return path


def paint(image: Path, folder: Path, *words: str) -> dict[str, float]:
    """Paint as a user would, and return the wall time, CPU time (s) and peak memory (MB) of the process."""
    command = [sys.executable, str(ROOT / "run.py"), f"image={image}", f"output={folder}", "overwrite=true", *words]
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(command)} failed")
    cpu, memory = used.ru_utime + used.ru_stime, used.ru_maxrss / KILOBYTES_PER_MB
    return {"wall": time.perf_counter() - start, "cpu": cpu, "memory": memory}


def print_sizes(names: list[str], folder: Path) -> None:
    """Print the time and memory of whole runs by picture size, and the ratios to the smallest picture's times."""
    print("| photograph | size | wall s | ratio | CPU s | ratio | memory MB | PSNR dB |")
    print("|---|---|---|---|---|---|---|---|")
    for name in names:
        first = None
        for size, side in SIDES.items():
            run = paint(make_photograph(name, side, folder), folder / "run")
            first = first or run
            metrics = json.loads((folder / "run" / "metrics.json").read_text())
            ratios = [run[key] / first[key] for key in ("wall", "cpu")]
            print(
                f"| {name} | {size} | {run['wall']:.1f} | {ratios[0]:.2f} | {run['cpu']:.1f} | {ratios[1]:.2f} "
                f"| {run['memory']:.0f} | {metrics['psnr']:.2f} |",
                flush=True,
            )


def print_pixels(names: list[str], folder: Path) -> None:
    """Print the PSNR of paintings with many strokes by the number of working pixels per stroke."""
    print("| photograph | pixels a stroke | working side | PSNR dB at 2,048 px | optimisation s |")
    print("|---|---|---|---|---|")
    for name in names:
        photograph = make_photograph(name, SIDES["12 MP"], folder)
        truth = np.asarray(255 * load_picture(str(photograph), SEEN_SIDE).movedim(0, 2)).round().astype(np.uint8)
        for pixels in PIXELS:
            side = math.ceil(math.sqrt(pixels * STROKES * 4 / 3))
            words = ["look=plain", "density=adaptive", f"strokes={STROKES}", f"working_resolution={side}"]
            words += ["frames=0", "report=false"]
            paint(photograph, folder / "run", *words)
            painted = load_picture(str(folder / "run" / "painting.png"), SEEN_SIDE).movedim(0, 2)
            psnr = picture_psnr(np.asarray(255 * painted).round().astype(np.uint8), truth)
            seconds = json.loads((folder / "run" / "metrics.json").read_text())["seconds"]
            print(f"| {name} | {pixels} | {side} | {psnr:.2f} | {seconds:.1f} |", flush=True)


def main() -> None:
    """Print a Markdown table by picture size or, with ``--pixels``, by working pixels per stroke."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("samples", nargs="*", default=["coffee", "astronaut"], help="samples of scikit-image")
    parser.add_argument("--pixels", action="store_true", help="compare numbers of working pixels per stroke")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        paint(samples()["coffee"], folder / "first", "resolution=64", "steps=2")
        (print_pixels if options.pixels else print_sizes)(options.samples, folder)


if __name__ == "__main__":
    main()
