"""Find the scale at which strokes are recovered best, and a criterion to choose it, on known rescaled paintings.

    python benchmarks/recovery_scale.py scales.csv

Paints the `PAINTINGS`, enlarges or reduces each, and recovers its strokes at the scales that resample it to each of
`SIDES`, and at the scale that `recover` chooses. The file gets a row per painting and scale: F1, and the quantities
that a criterion can use without the truth. Existing rows are kept, so an interrupted run continues. At the end it
prints, per criterion, how often the chosen scale lies within a factor of 1.4 of the best one, and F1 there.
"""

import argparse
import csv
from pathlib import Path

import numpy as np
import torch
from brushexp_recovery.benchmark.scenes import Scene, paint_scene
from brushexp_recovery.find.regions import find_regions
from brushexp_recovery.find.scale import find_zoom
from brushexp_recovery.model.recovery_model import load_model
from brushexp_recovery.raster.labels import count_pixels
from brushexp_recovery.raster.overlap import MATCH_IOU, overlaps_between
from brushexp_recovery.raster.resampling import nearest_pixels, resample

from brushexp.contracts.runs import load_plugins

SEED, SIDE = 61, 256  # seed, and side in pixels of the paintings
PAINTINGS = (  # kind, strokes, number, enlargement, look
    ("impasto", 20, 0, 0.6, "clean"),
    ("textured", 60, 0, 2.0, "hard"),
    ("daubs", 20, 0, 1.0, "hard"),
    ("scanned", 60, 0, 0.6, "clean"),
    ("knife", 20, 0, 2.0, "clean"),
    ("wet_in_wet", 60, 0, 1.0, "hard"),
    ("hatching", 20, 0, 2.0, "hard"),
    ("slabs", 60, 0, 2.0, "clean"),
    ("impasto", 60, 1, 2.0, "hard"),
    ("textured", 20, 1, 2.0, "clean"),
    ("daubs", 60, 1, 0.6, "clean"),
    ("scanned", 20, 1, 2.0, "hard"),
    ("knife", 60, 1, 1.0, "hard"),
    ("wet_in_wet", 20, 1, 0.6, "clean"),
    ("hatching", 60, 1, 2.0, "clean"),
    ("slabs", 20, 1, 1.0, "hard"),
)
SIDES = (64, 90, 128, 181, 256, 362)  # sides in pixels to which a painting is resampled
NEAR = 1.4  # largest ratio to the best scale that counts as near
LEAST_PIXELS = 12  # of the smallest stroke that counts
FEWEST_REGIONS = 25  # for the candidate criterion
GAIN = 1.05  # factor by which a scale must beat the present choice
FIELDS = ("painting", "scale", "is_present", "f1", "regions", "explained", "rooted")


def f1_of(known, found):
    """Compute F1 at an IoU of 0.5 of two label images (H, W)."""
    counts = [count_pixels(labels, int(labels.max()) + 1) for labels in (known, found)]
    iou = overlaps_between(known, found, len(counts[0]), len(counts[1])).iou
    return 2 * (iou >= MATCH_IOU).sum() / max(sum((count >= LEAST_PIXELS).sum() for count in counts), 1)


def look_at(model, image, labels, scale):
    """Recover strokes at a scale, and compute F1 and the quantities that need no truth."""
    regions = find_regions(model, image, scale, 1, lambda *_: None)
    area = count_pixels(regions.labels, len(regions.chance))
    return {
        "f1": f1_of(labels, regions.labels),
        "regions": len(area),
        "explained": (area * regions.chance).sum() / labels.size,
        "rooted": (np.sqrt(area) * regions.chance).sum() / np.sqrt(labels.size),
    }


def measure(options, path, done):
    """Write missing rows to the file."""
    model = load_model(options.weights)
    classifiers = model.classifiers()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, FIELDS)
        if not done:
            writer.writeheader()
        for kind, count, number, size, look in PAINTINGS:
            name = f"{kind} {count} {number} {size} {look}"
            if name in done:
                continue
            painting = paint_scene(Scene(kind, count, number), SIDE, SEED)
            image = np.clip(resample(getattr(painting, look).astype(np.float32), size), 0, 1)
            rows = (nearest_pixels(a, b) for a, b in zip(image.shape, painting.truth.labels.shape, strict=False))
            labels = painting.truth.labels[np.ix_(*rows)]
            present = find_zoom(model, classifiers, image)
            ladder = [(present, 1), *((side / len(image), 0) for side in SIDES)]
            lines = [
                {"painting": name, "scale": scale, "is_present": is_present} | look_at(model, image, labels, scale)
                for scale, is_present in ladder
            ]
            writer.writerows(lines)  # all rows of a picture or none
            file.flush()


def candidate(lines):
    """Choose the scale whose regions explain most, if they are enough and clearly beat those of the present one."""
    present = next(line for line in lines if int(line["is_present"]))
    enough = [line for line in lines if int(line["regions"]) >= FEWEST_REGIONS] or [present]
    best = max(enough, key=lambda line: float(line["explained"]))
    return best if float(best["explained"]) > GAIN * float(present["explained"]) else present


CRITERIA = {
    "present": lambda lines: next(line for line in lines if int(line["is_present"])),
    "explained": lambda lines: max(lines, key=lambda line: float(line["explained"])),
    "explained by 25 regions, 5 % better": candidate,
    "explained, by roots of areas": lambda lines: max(lines, key=lambda line: float(line["rooted"])),
    "the truth": lambda lines: max(lines, key=lambda line: float(line["f1"])),
}


def report(rows):
    """Print how well each criterion chooses."""
    pictures = {}
    for row in rows:
        pictures.setdefault(row["painting"], []).append(row)
    print(f"{len(pictures)} pictures\n\n| criterion | within {NEAR} times the best | F1 |\n|---|---:|---:|")
    for name, choose in CRITERIA.items():
        chosen = [choose(lines) for lines in pictures.values()]
        best = [CRITERIA["the truth"](lines) for lines in pictures.values()]
        ratio = [abs(np.log(float(a["scale"]) / float(b["scale"]))) for a, b in zip(chosen, best, strict=True)]
        near = np.mean(np.array(ratio) <= np.log(NEAR) + 1e-9)
        print(f"| {name} | {near:.2f} | {np.mean([float(line['f1']) for line in chosen]):.3f} |")


def main():
    """Measure, then report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--weights", default="strokes")
    options = parser.parse_args()
    torch.set_num_threads(1)
    load_plugins(Path("plugins"), warns=False)
    rows = list(csv.DictReader(options.file.open())) if options.file.is_file() else []
    measure(options, options.file, {row["painting"] for row in rows})
    report(csv.DictReader(options.file.open()))


if __name__ == "__main__":
    main()
