"""Make the sheet of twenty paintings in docs/gallery.md: ``python docs/site/gallery_sheet.py FOLDER``.

The commands are read from the page. Paintings are kept in FOLDER, so that later runs execute only new commands.
"""

import re
import shlex
import subprocess
import sys
from pathlib import Path

from PIL import Image, ImageOps

DOCS = Path(__file__).parents[1]
SHEET = DOCS / "images" / "gallery.jpg"
RESOLUTION = 384  # pixels of the longer side of a painting
COLUMNS, SIDE, GAP = 5, 200, 6  # paintings in a row; pixels of a painting on the sheet, and between two of them
QUALITY = 80  # of JPEG


def commands_of_the_page() -> list[str]:
    """Read the commands in the page's section "Twenty paintings", in order."""
    section = (DOCS / "gallery.md").read_text().partition("## Twenty paintings")[2].partition("\n## ")[0]
    return re.findall(r"^ {4}brushexp (.*?)(?:  +#.*)?$", section, re.MULTILINE)


def painting_of(command: str, folder: Path) -> Path:
    """Run a painting command unless the folder already contains its result; return the path of the painting."""
    output = folder / re.sub(r"[^\w=.-]+", "_", command)
    painting = output / "painting.png"
    if not painting.is_file():
        settings = [f"resolution={RESOLUTION}", "threads=1", "frames=0", "report=false", f"output={output}"]
        words = [sys.executable, "-m", "brushexp", *shlex.split(command), *settings, "overwrite=true"]
        subprocess.run(words, check=True)
    return painting


def write_sheet(paintings: list[Path]) -> None:
    """Crop each painting to a square, and write the sheet with the paintings arranged row by row."""
    rows = -(-len(paintings) // COLUMNS)
    pitch = SIDE + GAP
    sheet = Image.new("RGB", (COLUMNS * pitch - GAP, rows * pitch - GAP), "white")
    for number, path in enumerate(paintings):
        row, column = divmod(number, COLUMNS)
        picture = ImageOps.fit(Image.open(path).convert("RGB"), (SIDE, SIDE), Image.Resampling.LANCZOS)
        sheet.paste(picture, (column * pitch, row * pitch))
    sheet.save(SHEET, quality=QUALITY, optimize=True)


if __name__ == "__main__":
    write_sheet([painting_of(command, Path(sys.argv[1])) for command in commands_of_the_page()])
