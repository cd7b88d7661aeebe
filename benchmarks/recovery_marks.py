"""Measure how much marking a few strokes improves the recovery of other strokes, in known and in hand-marked paintings.

    python benchmarks/recovery_marks.py --kinds impasto daubs dabs
    python benchmarks/recovery_marks.py --kinds --hand FOLDER        # NAME.json and NAME.png

In each weathered painting with known strokes, ``--marks`` random strokes take the place of hand-drawn marks: as with
``recover marks=``, they determine the scale and train the region scorers. A row has the recall of the other strokes at
an IoU of 0.5, before and after training, and the F1 of all regions. Hand-drawn marks are split in half: one half is
used for training and the other for testing, and then the halves are swapped.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from brushexp_recovery.benchmark.scenes import Scene, paint_scene
from brushexp_recovery.find.regions import find_regions
from brushexp_recovery.marks.mark_regions import overlaps_of_pixels, pixels_of_mark
from brushexp_recovery.marks.marks_file import Mark, Marks, read_marks
from brushexp_recovery.measure.contours import outlines_of
from brushexp_recovery.model.recovery_model import load_model
from brushexp_recovery.raster.labels import count_pixels, group_pixels
from brushexp_recovery.raster.overlap import overlaps_between
from brushexp_recovery.synthesis.families.family import find_families
from brushexp_recovery.train.marked_painting import choose_scale, fit_judges

from brushexp.contracts.pictures import load_picture
from brushexp.contracts.runs import load_plugins

SEED = 61
MATCH, SOFT = 0.5, 0.3  # intersection over union
LEAST_PIXELS = 12  # area of the smallest region that counts


def find(model, image, scale=None):
    """Find regions as `recover` does without marks."""
    return find_regions(model, image, scale, 1, lambda *_: None)


def find_with(model, image, marks):
    """Find regions as ``recover marks=`` does, up to the point where marks replace regions."""
    scale = choose_scale(model, image, marks)
    return find(fit_judges(model, image, marks, scale, 0), image, scale)


def marks_of(truth, chosen):
    """Make marks from the known strokes with indices ``chosen``, with outlines of their visible regions."""
    outlines = outlines_of(truth.labels, len(truth))
    strokes = [
        Mark(str(k), truth.curve[k], np.full(3, truth.width[k]), (outlines[k],) if len(outlines[k]) > 2 else ())
        for k in chosen
    ]
    return Marks(strokes, [], truth.labels.shape, None, complete=False)


def compare_known(model, options):
    """Print a row for each kind of painting with known strokes, and the means over kinds."""
    print(f"| {options.marks} marks | scale | recall of the rest | F1 |\n|---|---|---|---|")
    gains = []
    for kind in options.kinds:
        painting = paint_scene(Scene(kind, options.count, options.number), options.side, SEED)
        truth, image = painting.truth, painting.hard.astype(np.float32)
        marked = np.random.default_rng(0).permutation(np.flatnonzero(truth.counts))[: options.marks]
        rest = truth.counts & ~np.isin(np.arange(len(truth)), marked)
        results = []
        for regions in (find(model, image), find_with(model, image, marks_of(truth, marked))):
            area = count_pixels(regions.labels, len(regions.chance))
            overlaps = overlaps_between(truth.labels, regions.labels, len(truth), len(area))
            hit = np.isin(np.arange(len(truth)), overlaps.first[overlaps.iou >= MATCH])
            f1 = 2 * hit[truth.counts].sum() / (truth.counts.sum() + (area >= LEAST_PIXELS).sum())
            results.append((regions.zoom, hit[rest].mean(), f1))
        gains.append(results)
        words = [" -> ".join(f"{value:.2f}" for value in column) for column in zip(*results, strict=True)]
        print(f"| {kind} | {' | '.join(words)} |", flush=True)
    if gains:
        mean = np.mean(gains, 0)
        print(f"| mean | | {mean[0, 1]:.3f} -> {mean[1, 1]:.3f} | {mean[0, 2]:.3f} -> {mean[1, 2]:.3f} |")


def compare_hand(model, folder):
    """Print, for each picture, the recall of each half of its marks before and after training on the other half."""
    print("| marks by hand | recall at 0.5 | at 0.3 | marks in the test |\n|---|---|---|---|")
    for path in sorted(folder.glob("*.json")):
        marks = read_marks(path)
        image = load_picture(str(path.with_suffix(".png")), None).permute(1, 2, 0).numpy()
        size = image.shape[:2]
        order = np.random.default_rng(0).permutation(len(marks.strokes))
        halves = np.array_split(order, [len(order) // 2])
        before = find(model, image)
        for train, test in (halves, halves[::-1]):
            known = Marks([marks.strokes[k] for k in train], [], size, None, complete=False)
            pixels = [pixels_of_mark(marks.strokes[k], size) for k in test]
            columns = []
            for regions in (before, find_with(model, image, known)):
                groups = [group.astype(np.int64) for group in group_pixels(regions.labels, len(regions.chance))]
                overlaps = overlaps_of_pixels(pixels, groups, size[0] * size[1])
                best = np.zeros(len(pixels))
                np.maximum.at(best, overlaps.first, overlaps.iou)
                columns.append(((best >= MATCH).mean(), (best >= SOFT).mean()))
            words = [f"{one:.2f} -> {other:.2f}" for one, other in zip(*columns, strict=True)]
            print(f"| {path.stem} | {' | '.join(words)} | {len(test)} |", flush=True)


def main():
    """Run the comparison on paintings with known strokes, then on hand-marked paintings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="*", default=sorted(find_families()))
    parser.add_argument("--marks", type=int, default=20)
    parser.add_argument("--count", type=int, default=90)
    parser.add_argument("--number", type=int, default=3)
    parser.add_argument("--side", type=int, default=224)
    parser.add_argument("--hand", type=Path, help="folder with marks, NAME.json, and pictures, NAME.png")
    parser.add_argument("--weights", default="strokes")
    options = parser.parse_args()
    torch.set_num_threads(1)
    load_plugins(Path("plugins"), warns=False)
    model = load_model(options.weights)
    compare_known(model, options)
    if options.hand is not None:
        compare_hand(model, options.hand)


if __name__ == "__main__":
    main()
