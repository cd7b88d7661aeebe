"""Compare G'MIC's Brushify with brushexp's looks: show each painting next to a detail enlarged four times.

    python benchmarks/brushify.py FIGURE.jpg astronaut@190,60 photo.jpg@20,200
    python benchmarks/brushify.py FIGURE.jpg chelsea@150,90 --looks oil vangogh --folder paintings

A picture is a file or the name of a scikit-image sample, as for image=; the numbers after @ are the left and top edges
of the detail, in pixels of the painting. With --folder, existing paintings are reused. G'MIC is separate free software
(gmic.eu; Debian package gmic) and not part of this program; if it is not installed, its column is omitted.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from urllib.parse import quote

sys.path.insert(0, str(Path(__file__).parents[1] / "src"))
import brushexp  # before torch: it sets how threads wait

# isort: split
from PIL import Image

from brushexp.pictures.load import load_picture
from brushexp.system.files import to_bytes

SIDE = 512  # pixels on the longer side of a painting
BRUSHIFY = "7,0.25,4,64,25,12,0,2,4,0.2,0.5,30,1,1,1,5,0,0.2,1"
CELL, ZOOM, GAP = 320, 4, 8  # CELL and GAP in pixels of the figure


def brushify(target: Image.Image, path: Path) -> None:
    """Paint a picture with G'MIC's Brushify and save the result."""
    with tempfile.TemporaryDirectory() as folder:
        target.save(source := Path(folder) / "target.png")
        subprocess.run(["gmic", source, "fx_brushify", BRUSHIFY, "-o", path], check=True, capture_output=True)


def paintings(picture: str, looks: list[str], folder: Path) -> list[Image.Image]:
    """Return the paintings of one picture: one by Brushify, if it is installed, followed by one in each look."""
    found = []
    for painter in [*(["brushify"] if shutil.which("gmic") else []), *looks]:
        path = folder / f"{quote(picture, safe='')}_{painter}.png"  # a/1.jpg and b/1.jpg are different pictures
        if not path.exists() and painter == "brushify":
            brushify(Image.fromarray(to_bytes(load_picture(picture, SIDE))), path)
        elif not path.exists():
            Image.fromarray(brushexp.paint(picture, look=painter, resolution=SIDE, frames=0).image).save(path)
        found.append(Image.open(path).convert("RGB"))
    return found


def row(made: list[Image.Image], left: int, top: int) -> Image.Image:
    """Combine the paintings of a picture and their enlarged details into one row."""
    height = round(CELL * made[0].height / made[0].width)
    side = CELL // ZOOM
    sheet = Image.new("RGB", (2 * len(made) * (CELL + GAP), max(height, CELL) + GAP), "white")
    for number, painting in enumerate(made):
        detail = painting.crop((left, top, left + side, top + side))
        sheet.paste(painting.resize((CELL, height), Image.Resampling.LANCZOS), (2 * number * (CELL + GAP), 0))
        place = ((2 * number + 1) * (CELL + GAP), 0)
        sheet.paste(detail.resize((CELL, CELL), Image.Resampling.BICUBIC), place)
    return sheet


def main() -> None:
    """Parse the command line, paint the pictures, and write the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("figure", type=Path)
    parser.add_argument("pictures", nargs="+", metavar="PICTURE@LEFT,TOP")
    parser.add_argument("--looks", nargs="+", default=["oil", "impasto"])
    parser.add_argument("--folder", type=Path, help="folder to keep the paintings in")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        rows = []
        for chosen in options.pictures:
            picture, _, place = chosen.rpartition("@")
            left, top = map(int, place.split(","))
            rows.append(row(paintings(picture, options.looks, folder), left, top))
    sheet = Image.new("RGB", (rows[0].width, sum(part.height for part in rows)), "white")
    for number, part in enumerate(rows):
        sheet.paste(part, (0, sum(above.height for above in rows[:number])))
    sheet.save(options.figure, quality=88)


if __name__ == "__main__":
    main()
