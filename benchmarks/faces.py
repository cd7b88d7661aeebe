"""Count the faces that `find_faces` finds and misses, and its false positives, by tilt and size.

python benchmarks/faces.py              # two portraits, and pictures without faces, from scikit-image and matplotlib
python benchmarks/faces.py faces.csv    # your own pictures: lines of picture,x,y,side, or picture if it has no face
python benchmarks/faces.py faces.csv --sizes 256 512 1024 --tilts 0 30 -30 --least 0.7
"""

import argparse
import csv
import math
import sys
import time
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib
import numpy as np
import torch
from PIL import Image
from skimage.data import data_dir

sys.path.insert(0, str(Path(__file__).parents[1] / "src"))
from brushexp.pictures.face import Face
from brushexp.pictures.faces.detection import LEAST_SCORE, find_faces

NEAR = 0.4  # largest distance of a hit from the middle of a face, in sides of the face
LIKE = 2.0  # largest ratio between the sides of a hit and a face, either way
WITHOUT_FACES = (
    "brick", "chelsea", "clock_motion", "coffee", "coins", "grass", "gravel", "horse", "hubble_deep_field", "moon",
    "rocket",
)  # fmt: skip
Truth = tuple[float, float, float]  # x, y and side of a face, in pixels


@dataclass
class Count:
    """Counts of found, missed and falsely detected faces in a set of pictures."""

    faces: int = 0
    hits: int = 0
    false: int = 0
    missed: list[str] = field(default_factory=list)
    made_up: list[str] = field(default_factory=list)

    def add(self, name: str, truths: list[Truth], found: list[Face]) -> None:
        """Match detected faces one to one with the true faces of a picture, and add the result to the counts."""
        left = list(found)
        for x, y, side in truths:
            hit = next((face for face in left if is_hit(face, x, y, side)), None)
            if hit is None:
                self.missed.append(f"{name} at {x:.0f}, {y:.0f} ({side:.0f} px)")
            else:
                left.remove(hit)
        self.faces += len(truths)
        self.hits += len(found) - len(left)
        self.false += len(left)
        self.made_up += [
            f"{name} at {face.x:.0f}, {face.y:.0f} ({face.side:.0f} px, {face.score:.2f})" for face in left
        ]


def is_hit(face: Face, x: float, y: float, side: float) -> bool:
    """Check whether a detected face matches a true face, given by its centre and side in pixels."""
    return math.hypot(face.x - x, face.y - y) < NEAR * side and 1 / LIKE < face.side / side < LIKE


def samples() -> dict[str, list[Truth]]:
    """List sample pictures from scikit-image and matplotlib, and the faces in them."""
    hopper = Path(matplotlib.get_data_path()) / "sample_data" / "grace_hopper.jpg"
    pictures: dict[str, list[Truth]] = {
        str(Path(data_dir) / "astronaut.png"): [(225, 121, 100)],
        str(hopper): [(262, 223, 203)],
    }
    for name in WITHOUT_FACES:
        for suffix in (".png", ".jpg"):
            path = Path(data_dir) / (name + suffix)
            if path.exists():
                pictures[str(path)] = []
    return pictures


def read(table: Path) -> dict[str, list[Truth]]:
    """Read the true faces in each picture from a CSV file; paths are relative to the file's folder."""
    pictures: dict[str, list[Truth]] = defaultdict(list)
    with table.open() as file:
        for picture, *face in csv.reader(file):
            truths = pictures[str(table.parent / picture)]
            if any(face):
                x, y, side = map(float, face)
                truths.append((x, y, side))
    return pictures


def rotate_faces(picture: Image.Image, truths: list[Truth], tilt: float) -> tuple[Image.Image, list[Truth]]:
    """Rotate a picture and its faces clockwise by ``tilt`` degrees."""
    canvas = picture.rotate(-tilt, Image.Resampling.BICUBIC, expand=True)
    c, s = math.cos(math.radians(tilt)), math.sin(math.radians(tilt))
    moved = []
    for x, y, side in truths:
        right, down = x - picture.width / 2, y - picture.height / 2
        moved.append((canvas.width / 2 + c * right - s * down, canvas.height / 2 + s * right + c * down, side))
    return canvas, moved


def main() -> None:
    """Detect faces at each size and tilt, and print a line for each combination."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", nargs="?", type=Path, help="CSV of picture,x,y,side in pixels of the file")
    parser.add_argument("--sizes", type=int, nargs="+", default=[256, 512, 768, 1024], help="longer side in pixels")
    parser.add_argument("--tilts", type=float, nargs="+", default=[0, 15, -15, 30, -30, 45, -45], help="degrees")
    parser.add_argument("--least", type=float, default=LEAST_SCORE, help="least confidence of a face")
    parser.add_argument("--list", action="store_true", help="list each miss and each false hit")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    pictures = read(asked.table) if asked.table else samples()
    print("size  tilt  pictures  faces  found       false  s/picture")
    for size in asked.sizes:
        for tilt in asked.tilts:
            count, seconds = Count(), 0.0
            for path, truths in pictures.items():
                picture = Image.open(path).convert("RGB")
                zoom = min(1, size / max(picture.size))
                small = picture.resize([max(1, round(zoom * side)) for side in picture.size], Image.Resampling.LANCZOS)
                small, there = rotate_faces(small, [(zoom * x, zoom * y, zoom * side) for x, y, side in truths], tilt)
                planes = torch.from_numpy(np.array(small)).movedim(-1, 0) / 255
                start = time.process_time()
                found = find_faces(planes, asked.least)
                seconds += time.process_time() - start
                count.add(Path(path).name, there, found)
            share = f"{count.hits / count.faces:6.1%}" if count.faces else "     -"
            numbers = f"{count.faces:5d}  {count.hits:4d} {share}  {count.false:5d}  {seconds / len(pictures):9.2f}"
            print(f"{size:4d}  {tilt:+4.0f}  {len(pictures):8d}  {numbers}", flush=True)
            if asked.list:
                for line in count.missed:
                    print("      missed", line)
                for line in count.made_up:
                    print("      false ", line)


if __name__ == "__main__":
    main()
