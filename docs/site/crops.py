"""Arrange enlarged crops of paintings side by side.

    python docs/site/crops.py docs/images/renderers.jpg 3 astronaut:70,250,160 analytic=runs/0 textured=runs/2 ...

Each row is given as a title and the left edge, top edge and side of its crop, in pixels, followed by its paintings.
"""

import sys
from pathlib import Path

from brushexp_studies.contact_sheet import SheetCell, draw_sheet
from PIL import Image


def part_of(folder: str, left: int, top: int, side: int, zoom: int) -> Image.Image:
    """Crop a square from a run's painting, and enlarge it without smoothing."""
    with Image.open(Path(folder) / "painting.png") as opened:
        part = opened.convert("RGB").crop((left, top, left + side, top + side))
    return part.resize((zoom * side, zoom * side), Image.Resampling.NEAREST)


def main(out: Path, zoom: int, words: list[str]) -> None:
    """Write the sheet of crops to a file."""
    rows: list[list[SheetCell]] = []
    for word in words:
        if ":" in word:
            title, _, numbers = word.partition(":")
            left, top, side = map(int, numbers.split(","))
            rows.append([])
        else:
            name, _, folder = word.partition("=")
            rows[-1].append(SheetCell(part_of(folder, left, top, side, zoom), (f"{name}, {title}",)))
    draw_sheet(rows, f"enlarged {zoom} times", zoom * side).save(out, quality=88, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3:])
