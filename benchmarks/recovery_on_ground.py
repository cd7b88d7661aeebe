"""Compare the recovery of scanned strokes on plain grounds with and without the scale rule for plain grounds.

    python benchmarks/recovery_on_ground.py --seeds 0 3

The script paints the scans that ship with the program in random colours, at random positions and angles, on black,
white and brown grounds. It prints the F1 score at an IoU of 0.5 for each ground and number of strokes, pooled over the
seeds.
"""

import argparse

import numpy as np
import torch
from brushexp_recovery.find.scale import find_zoom, find_zoom_by_network
from brushexp_recovery.model.recovery_model import load_model
from brushexp_recovery.raster.labels import count_pixels
from brushexp_recovery.raster.overlap import MATCH_IOU, overlaps_between
from brushexp_recovery.raster.resampling import nearest_pixels, resample
from brushexp_recovery.recover.pipeline import recover_with
from skimage.transform import rotate

from brushexp.contracts.strokes import read_scans

SIDE = 320  # pixels of a picture before it is enlarged
LENGTHS = 90, 170  # pixels, shortest and longest stroke
ELONGATIONS = 2, 4  # length over width
GROUNDS = {"black": (0.02, 0.02, 0.02), "white": (0.96, 0.96, 0.94), "brown": (0.47, 0.35, 0.24)}
COUNTS = 3, 8
NOISE = 0.008  # standard deviation of the photograph's grain
COVERED = 0.4  # coverage from which a pixel belongs to a stroke
LEAST_PIXELS = 60  # of a visible stroke that counts


def paint(ground, count, seed, scans, enlargement):
    """Paint a square picture, `SIDE` times ``enlargement`` pixels wide; return it and its labels (-1 on the ground)."""
    random = np.random.default_rng([seed, count])
    image, labels = np.ones((SIDE, SIDE, 3)) * ground, np.full((SIDE, SIDE), -1, np.int32)
    for number in range(count):
        scan = scans[random.integers(len(scans))]
        length = random.uniform(*LENGTHS)
        size = round(length), round(length / random.uniform(*ELONGATIONS))
        tensor = torch.from_numpy(scan.astype(np.float32) / 255)[None, None]
        small = torch.nn.functional.interpolate(tensor, size, mode="area")[0, 0].numpy()
        cover = rotate(small, random.uniform(0, 180), resize=True).clip(0, 1)[:SIDE, :SIDE]
        top, left = (random.integers(0, max(1, SIDE - side)) for side in cover.shape)
        place = np.s_[top : top + cover.shape[0], left : left + cover.shape[1]]
        image[place] += cover[..., None] * (random.uniform(0.15, 0.95, 3) - image[place])
        labels[place][cover > COVERED] = number
    image = resample(image.astype(np.float32), enlargement)
    pixels = nearest_pixels(len(image), SIDE)
    return (image + random.normal(0, NOISE, image.shape)).clip(0, 1).astype(np.float32), labels[np.ix_(pixels, pixels)]


def matches(known, found):
    """Count the matched, known and found strokes in two label images."""
    sizes = [count_pixels(labels, int(labels.max()) + 1) for labels in (known, found)]
    iou = overlaps_between(known, found, len(sizes[0]), len(sizes[1])).iou
    return np.array([(iou >= MATCH_IOU).sum(), (sizes[0] >= LEAST_PIXELS).sum(), len(sizes[1])])


def main():
    """Paint the pictures, recover their strokes and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", nargs=2, type=int, default=(0, 3), help="first seed, and the one after the last")
    parser.add_argument("--enlargement", type=float, default=2.0, help="of the pictures of 320 pixels")
    options = parser.parse_args()
    torch.set_num_threads(1)
    model, scans = load_model("strokes"), read_scans()
    classifiers = model.classifiers()
    print("| ground | strokes | without | with the rule |\n|---|---:|---:|---:|")
    for name, ground in GROUNDS.items():
        for count in COUNTS:
            f1 = []
            for find in (find_zoom_by_network, find_zoom):
                counts = np.zeros(3)
                for seed in range(*options.seeds):
                    image, labels = paint(ground, count, seed, scans, options.enlargement)
                    found = recover_with(model, image, find(model, classifiers, image), 1, lambda *_: None).labels
                    counts += matches(labels, found)
                f1.append(2 * counts[0] / max(counts[1:].sum(), 1))
            print(f"| {name} | {count} | {f1[0]:.2f} | {f1[1]:.2f} |", flush=True)


if __name__ == "__main__":
    main()
