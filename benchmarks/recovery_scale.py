"""Find the best scale for recovering strokes from rescaled known paintings, and compare it with the automatic scale.

    python benchmarks/recovery_scale.py scales.csv
    python benchmarks/recovery_scale.py others.csv --rounds 3 7 --sides

In each round, the script paints a picture of each of the `KINDS`, enlarges or reduces it, and recovers its strokes:
with one search and with all `SEARCHES` at the scale that `recover` chooses, and with one search at each scale that
resamples the picture to one of the ``--sides`` (which may be empty). The file gets a row per painting and scale, with
F1 and the quantities that a criterion can use without ground truth. Existing rows are kept, so an interrupted run
continues. Finally, the script prints for each criterion how often the chosen scale is within a factor of 1.4 of the
best scale, the F1 at the chosen scale, and the improvement from one search to all searches.
"""

import argparse
import csv
from pathlib import Path
from zlib import crc32

import numpy as np
import torch
from brushexp_recovery.benchmark.scenes import Scene, paint_scene
from brushexp_recovery.find.regions import SEARCHES, find_regions
from brushexp_recovery.find.scale import BEST_WIDTH, find_zoom, weighted_median
from brushexp_recovery.model.recovery_model import load_model
from brushexp_recovery.raster.labels import count_pixels
from brushexp_recovery.raster.overlap import MATCH_IOU, overlaps_between
from brushexp_recovery.raster.resampling import nearest_pixels, resample
from brushexp_recovery.synthesis.ageing import weather

from brushexp.contracts.runs import load_plugins

SEED, SIDE = 61, 256  # seed and side in pixels of the paintings
KINDS = (
    "textured",
    "daubs",
    "impasto",
    "knife",
    "scanned",
    "dabs",
    "hertzmann",
    "wet_in_wet",
    "litwinowicz",
    "washes",
    "slabs",
    "hatching",
    "dry",
    "fluid",
)
COUNTS = (20, 60, 120)  # strokes
ENLARGEMENTS = (0.6, 1.0, 2.0, 3.0)
LOOKS = ("clean", "hard", "photo")  # photo: weathered after the enlargement, so that the weave is fine
PHOTO_STRENGTH = 1.5  # of weathering
SIDES = (64, 90, 128, 181, 256, 362)  # sides in pixels of a painting at the scales of the ladder
NEAR = 1.4  # times the best scale, within which a scale is near it
ROUNDING = 0.012  # of the logarithm of a scale: a step of the ladder, by 1.414, still counts as near
LEAST_PIXELS = 12  # of a stroke that counts
FEWEST_REGIONS = 25  # of the candidate criterion
GAIN = 1.05  # by which it must beat the present choice
DIFFERENCE = 0.01  # of F1, from which on a painting counts as better or worse
RESAMPLES = 10_000  # of the bootstrap over paintings
FIELDS = ("painting", "scale", "choice", "f1", "regions", "explained", "rooted", "by_width")
PRESENT, ALL, LADDER = "present", "all searches", "ladder"  # choices


def list_pictures(first, last):
    """List the kind, stroke count, round, enlargement and look of each painting in rounds ``first`` to ``last - 1``."""
    pictures = []
    for turn in range(first, last):
        for number, kind in enumerate(KINDS):
            count = COUNTS[(number + turn) % len(COUNTS)]
            enlargement = ENLARGEMENTS[(number + 3 * turn + turn // 4) % len(ENLARGEMENTS)]
            pictures.append((kind, count, turn, enlargement, LOOKS[(number // 3 + turn) % len(LOOKS)]))
    return pictures


def make_picture(kind, count, turn, enlargement, look):
    """Paint a rescaled picture (H, W, 3); return it, its labels, and the scale that suits its stroke widths."""
    painting = paint_scene(Scene(kind, count, turn), SIDE, SEED)
    before = painting.hard if look == "hard" else painting.clean
    image = np.clip(resample(before.astype(np.float32), enlargement), 0, 1)
    if look == "photo":
        random = np.random.default_rng([SEED, turn, crc32(kind.encode())])
        image = np.clip(weather(image, random, PHOTO_STRENGTH), 0, 1).astype(np.float32)
    truth = painting.truth
    pixels = (nearest_pixels(size, own) for size, own in zip(image.shape[:2], truth.labels.shape, strict=True))
    width = weighted_median(truth.width[truth.counts], truth.visible[truth.counts].astype(float))
    return image, truth.labels[np.ix_(*pixels)], BEST_WIDTH / (width * enlargement)


def f1_of(known, found):
    """Compute the F1 score between two label images (H, W) at an IoU of 0.5."""
    counts = [count_pixels(labels, int(labels.max()) + 1) for labels in (known, found)]
    iou = overlaps_between(known, found, len(counts[0]), len(counts[1])).iou
    return 2 * (iou >= MATCH_IOU).sum() / max(sum((count >= LEAST_PIXELS).sum() for count in counts), 1)


def look_at(model, image, labels, scale, searches):
    """Recover strokes at a scale; return F1 and the quantities that need no ground truth."""
    regions = find_regions(model, image, scale, 1, lambda *_: None, searches)
    area = count_pixels(regions.labels, len(regions.chance))
    return {
        "scale": scale,
        "f1": f1_of(labels, regions.labels),
        "regions": len(area),
        "explained": (area * regions.chance).sum() / labels.size,
        "rooted": (np.sqrt(area) * regions.chance).sum() / np.sqrt(labels.size),
    }


def measure(options, path, done):
    """Measure the paintings that are not in the file yet, and append their rows."""
    model = load_model(options.weights)
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, FIELDS)
        if not done:
            writer.writeheader()
        for picture in list_pictures(*options.rounds):
            name = " ".join(map(str, picture))
            if name in done:
                continue
            image, labels, by_width = make_picture(*picture)
            present = find_zoom(model, model.classifiers(), image)
            looks = [(PRESENT, present, SEARCHES[:1]), (ALL, present, SEARCHES)]
            looks += [(LADDER, side / len(image), SEARCHES[:1]) for side in options.sides]
            lines = [
                {"painting": name, "choice": choice, "by_width": by_width}
                | look_at(model, image, labels, scale, searches)
                for choice, scale, searches in looks
            ]
            writer.writerows(lines)  # all of a picture, or none
            file.flush()


def choose_explained(lines):
    """Choose a scale with enough regions and the highest ``explained``, or the automatic scale if the gain is small."""
    enough = [line for line in lines if line["regions"] >= FEWEST_REGIONS] or lines[:1]
    best = max(enough, key=lambda line: line["explained"])
    return best["scale"] if best["explained"] > GAIN * lines[0]["explained"] else lines[0]["scale"]


CRITERIA = {  # of lines, the present one first
    "the present choice": lambda lines: lines[0]["scale"],
    "explained": lambda lines: max(lines, key=lambda line: line["explained"])["scale"],
    "explained by 25 regions, 5 % better": choose_explained,
    "explained, by roots of areas": lambda lines: max(lines, key=lambda line: line["rooted"])["scale"],
    "the true median width": lambda lines: lines[0]["by_width"],
    "the truth": lambda lines: max(lines, key=lambda line: line["f1"])["scale"],
}


def f1_at(lines, scale):
    """Interpolate F1 at a scale between measured scales."""
    ordered = sorted(lines, key=lambda line: line["scale"])
    scales = np.log([line["scale"] for line in ordered])
    return float(np.interp(np.log(scale), scales, [line["f1"] for line in ordered]))


def report(rows):
    """Print how well each criterion chooses the scale, and how much several searches improve on one search."""
    pictures = {}
    for row in rows:
        line = {key: value if key in ("painting", "choice") else float(value) for key, value in row.items()}
        pictures.setdefault(row["painting"], {}).setdefault(row["choice"], []).append(line)
    print(f"{len(pictures)} pictures")
    if all(LADDER in lines for lines in pictures.values()):
        print(f"\n| criterion | within {NEAR} times the best | F1 |\n|---|---:|---:|")
        single = [lines[PRESENT] + lines[LADDER] for lines in pictures.values()]
        best = [CRITERIA["the truth"](lines) for lines in single]
        for name, choose in CRITERIA.items():
            chosen = [choose(lines) for lines in single]
            ratios = [abs(np.log(one / other)) for one, other in zip(chosen, best, strict=True)]
            near = np.mean(np.array(ratios) <= np.log(NEAR) + ROUNDING)
            f1 = np.mean([f1_at(lines, scale) for lines, scale in zip(single, chosen, strict=True)])
            print(f"| {name} | {near:.2f} | {f1:.3f} |")
    before, after = (np.array([lines[choice][0]["f1"] for lines in pictures.values()]) for choice in (PRESENT, ALL))
    gain, random = after - before, np.random.default_rng(SEED)
    draws = random.integers(len(gain), size=(RESAMPLES, len(gain)))
    low, high = np.quantile(gain[draws].mean(1), [0.025, 0.975])
    print(f"\nF1 {before.mean():.3f} by one search, {after.mean():.3f} by all")
    print(f"gain {gain.mean():+.3f} ({low:+.3f} to {high:+.3f})")
    print(f"{(gain > DIFFERENCE).sum()} better, {(gain < -DIFFERENCE).sum()} worse")


def main():
    """Measure the missing paintings, then report on all of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--rounds", type=int, nargs=2, default=(0, 3), metavar=("FIRST", "END"))
    parser.add_argument("--sides", type=int, nargs="*", default=SIDES)
    parser.add_argument("--weights", default="strokes")
    options = parser.parse_args()
    torch.set_num_threads(1)
    load_plugins(Path("plugins"), warns=False)
    rows = list(csv.DictReader(options.file.open())) if options.file.is_file() else []
    measure(options, options.file, {row["painting"] for row in rows})
    report(csv.DictReader(options.file.open()))


if __name__ == "__main__":
    main()
