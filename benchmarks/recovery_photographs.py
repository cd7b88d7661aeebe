"""Measure how well recovery recognises bare ground, and photographs that do not show paintings.

    python benchmarks/recovery_photographs.py camera.png coins.png kodim15.png kodim23.png --side 224

The script recovers strokes from photographs, resampled to ``--side`` pixels, and from known paintings of 192 pixels.
The row for each picture has the number of strokes, their median confidence, the fraction of pixels classified as bare
ground, and whether `recover` reports that the picture does not look like paint. For the paintings, the script also
prints the precision of bare pixels, and their recall on ground that no recovered stroke covers.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from brushexp_recovery.benchmark.scenes import Scene, paint_scene
from brushexp_recovery.measure.stroke_table import doubt_of_paint, tabulate_strokes
from brushexp_recovery.model.recovery_model import load_model
from brushexp_recovery.recover.pipeline import recover_with

from brushexp.contracts.pictures import load_picture
from brushexp.contracts.runs import load_plugins

SEED, NUMBER, SIDE = 61, 7, 192  # seed, number, and side in pixels of the paintings
PAINTINGS = (
    ("textured", 75, "clean"),
    ("fluid", 75, "hard"),
    ("knife", 75, "hard"),
    ("dry", 75, "clean"),
    ("hertzmann", 75, "hard"),
    ("litwinowicz", 75, "clean"),
    ("dabs", 40, "hard"),
    ("hatching", 40, "clean"),
    ("scanned", 40, "hard"),
    ("washes", 40, "clean"),
    ("wet_in_wet", 40, "hard"),
    ("slabs", 40, "clean"),
    ("impasto", 40, "hard"),
    ("daubs", 40, "clean"),
    ("textured", 75, "hard"),
    ("dry", 75, "hard"),
    ("washes", 40, "hard"),
    ("hatching", 40, "hard"),
)


def look_at(model, name, image):
    """Recover the strokes in a picture, print its row, and return the recovered painting."""
    recovered = recover_with(model, image, None, 1, lambda *_: None)
    table = tabulate_strokes(recovered)
    median = np.median(recovered.confidence) if len(table) else 0.0
    words = doubt_of_paint(table) or ""
    print(f"| {name} | {len(table)} | {median:.2f} | {table.ground:.2f} | {words.partition(': ')[2]} |", flush=True)
    return recovered


def main():
    """Print rows for photographs, then for paintings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photographs", nargs="*")
    parser.add_argument("--side", type=int, default=224)
    parser.add_argument("--weights", default="strokes")
    options = parser.parse_args()
    torch.set_num_threads(1)
    load_plugins(Path("plugins"), warns=False)
    model = load_model(options.weights)
    print("| picture | strokes | median confidence | bare | does not look like paint |\n|---|---:|---:|---:|---|")
    for path in options.photographs:
        look_at(model, Path(path).stem, load_picture(path, options.side).permute(1, 2, 0).numpy())
    right, said, bare = 0, 0, 0
    for kind, count, look in PAINTINGS:
        painting = paint_scene(Scene(kind, count, NUMBER), SIDE, SEED)
        recovered = look_at(model, f"{kind}, {look}", getattr(painting, look).astype(np.float32))
        ground = painting.truth.labels < 0
        right += (recovered.ground & ground).sum()
        said += recovered.ground.sum()
        bare += (ground & (recovered.labels < 0)).sum()
    print(f"\nbare pixels: precision {right / said:.2f}, recall on ground without recovered strokes {right / bare:.2f}")


if __name__ == "__main__":
    main()
