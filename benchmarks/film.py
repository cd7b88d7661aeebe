"""Compare painting a film as a whole with painting its frames one by one, by flicker, PSNR and time.

    python benchmarks/film.py                          a piece of a photograph moving over another photograph
    python benchmarks/film.py clip.mp4 --count 12      the first 12 frames of a film
    python benchmarks/film.py --look ink --side 256
    python benchmarks/film.py --side 256 --sheet film.jpg    also save three painted frames and their changes
    python benchmarks/film.py --cut --count 5 --override steps=8    PSNR of each picture around a cut

All frames are painted with the same look and at the same size. Flicker is the mean change (in grey levels, on a scale
of 0 to 255) from one picture to the next where the target does not change, measured on the pictures as displayed, with
lighting. PSNR is computed from the colours, without lighting.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from fractions import Fraction
from itertools import islice
from pathlib import Path

import brushexp

# isort: split
import numpy as np
import torch
from brushexp_films.changes import Flicker
from brushexp_films.clips import open_clip, timed_pictures
from brushexp_films.schema import FRAMES
from PIL import Image
from skimage import data, transform

from brushexp.painting.reopen import export_job
from brushexp.pictures.load import planes_of
from brushexp.pictures.similarity import psnr_of
from brushexp.pictures.video import filming
from brushexp.strokes.storage import load_catalogue

GAIN = 8  # amplification of changes in a sheet
MOVED = 6  # pixels from picture to picture


def scene(count: int, side: int) -> list[np.ndarray]:
    """Make frames in which a round piece of one photograph moves across another photograph."""
    still = transform.resize(data.coffee()[:, 100:500], (side, side), anti_aliasing=True)
    piece = transform.resize(data.chelsea()[20:280, 110:370], (side // 3, side // 3), anti_aliasing=True)
    row, column = np.mgrid[: side // 3, : side // 3] - (side // 3 - 1) / 2
    inside = np.hypot(row, column)[..., None] < side / 6 - 1
    pictures = []
    for k in range(count):
        picture, left, top = still.copy(), side // 10 + k * side // 100, round(side * (0.3 + 0.1 * np.sin(k / 6)))
        place = picture[top : top + side // 3, left : left + side // 3]
        place[:] = np.where(inside, piece, place)
        pictures.append(np.rint(255 * picture).astype(np.uint8))
    return pictures


def cut(count: int, side: int) -> list[np.ndarray]:
    """Make frames of one photograph, then of another photograph, each moving to the left."""
    parts = (data.coffee()[:, :400], data.chelsea()[:, :300])
    larger = [transform.resize(part, (side, side + MOVED * count), anti_aliasing=True) for part in parts]
    places = [(picture, MOVED * k) for picture in larger for k in range(count)]
    return [np.rint(255 * picture[:, left : left + side]).astype(np.uint8) for picture, left in places]


def tell_pictures(folder: Path, clip: Path) -> None:
    """Print the PSNR of each picture in a painted film, rendered without lighting."""
    catalogues = sorted((folder / FRAMES).glob("*.h5"))
    for path, shown in zip(catalogues, timed_pictures(open_clip(clip)), strict=False):
        painted = export_job(load_catalogue(path)).bare().picture()
        print(f"{path.stem}: {psnr_of(float(np.square(painted / 255.0 - shown.picture / 255.0).mean())):.1f} dB")


def write_sheet(sheet: Path, folder: Path, clip: Path) -> None:
    """Save three frames, their paintings, and the change from each of these paintings to the next.

    The frames are the first, the middle and the next-to-last.
    """
    shown = [one.picture for one in timed_pictures(open_clip(clip))]
    paths = sorted((folder / FRAMES).glob("*.h5"))
    painted = [export_job(load_catalogue(path)).picture().astype(int) for path in paths]
    columns = []
    for k in (0, len(painted) // 2, len(painted) - 2):
        change = (GAIN * np.abs(painted[k + 1] - painted[k])).clip(0, 255)
        columns.append(np.vstack([shown[k], painted[k], change]))
    Image.fromarray(np.hstack(columns).astype(np.uint8)).save(sheet, quality=88, optimize=True)


def main() -> None:
    """Paint the film as a whole and frame by frame, and print the comparison as a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clip", nargs="?", help="a film; one is made by default")
    parser.add_argument("--look", default="oil")
    parser.add_argument("--side", type=int, default=512, help="longer side in pixels")
    parser.add_argument("--count", type=int, default=12, help="pictures")
    parser.add_argument("--threads", type=int, default=None)
    parser.add_argument("--cut", action="store_true", help="make a film of two photographs; print the PSNR")
    parser.add_argument("--override", nargs="+", default=[], help="keys of the painting")
    parser.add_argument("--sheet", type=Path, help="file to write three pictures of the film to")
    options = parser.parse_args()
    brushexp.list_plugins()
    make, total = (cut, 2 * options.count) if options.cut else (scene, options.count)
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(options.clip or Path(scratch) / "clip.mp4")
        if not options.clip:
            with filming(path.with_suffix(""), "mp4", (options.side, options.side), Fraction(25)) as film:
                for picture in make(options.count, options.side):
                    film.show(picture, 1)
        clip = open_clip(path)
        words = [f"image={path}", f"look={options.look}", f"resolution={options.side}"]
        words += [f"film.stop={total / float(clip.rate)}", *options.override]
        words += [] if options.threads is None else [f"threads={options.threads}"]
        folder = Path(scratch) / "run"
        command = [sys.executable, "-m", "brushexp", *words, f"output={folder}"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        if options.cut:
            tell_pictures(folder, path)
            return
        if options.sheet:
            write_sheet(options.sheet, folder, path)
        carried = json.loads((folder / "metrics.json").read_text())
        flicker, psnr, seconds = Flicker(), [], []
        for shown in islice(timed_pictures(clip), options.count):
            since = time.monotonic()
            painting = brushexp.paint(
                shown.picture, look=options.look, resolution=options.side, threads=options.threads
            )
            seconds.append(time.monotonic() - since)
            psnr.append(painting.metrics["psnr"])
            image = torch.from_numpy(np.moveaxis(painting.image, 2, 0) / np.float32(255))
            flicker.add(image, planes_of(shown.picture, options.side))
    print(f"{carried['n_frames']} pictures, {options.side} px, look={options.look}, {carried['n_strokes']} strokes\n")
    print("| | flicker | PSNR dB | seconds a picture |\n|---|---|---|---|")
    print(
        f"| carried | {255 * carried['flicker']:.3f} | {carried['psnr']:.2f} | {carried['seconds_per_frame']:.2f} |\n"
        f"| one by one | {255 * flicker.value:.3f} | {np.mean(psnr):.2f} | {np.median(seconds):.2f} |\n\n"
        f"{flicker.value / carried['flicker']:.1f} times less flicker"
    )


if __name__ == "__main__":
    main()
