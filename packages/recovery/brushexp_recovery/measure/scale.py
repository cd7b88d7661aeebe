"""Find the scale of a photograph of a painting, in millimetres per pixel."""

import csv
import re
from pathlib import Path

from brushexp.contracts import UserError
from brushexp.contracts.files import read_text

MOST_CM = 1e5  # maximum width of a painting
SIDES_APART = 0.03  # maximum relative difference of the scales from width and height


def millimetres_per_pixel(
    size: tuple[int, int], width_cm: float | None, size_cm: str | None, prefix: str = ""
) -> float | None:
    """Compute the millimetres per pixel of a photograph (H, W), or return None if the painting's size is not given.

    ``width_cm`` is the width of the part of the painting that the photograph shows; ``size_cm`` is its width and
    height, such as 92x73. Raises UserError if both are given, or if ``size_cm`` does not have the photograph's aspect
    ratio. ``prefix`` is put before the names of keys in error messages.
    """
    if width_cm is not None and size_cm is not None:
        raise UserError(f"{prefix}width_cm and {prefix}size_cm say the same; give one of them")
    if size_cm is None:
        return None if width_cm is None else 10 * width_cm / size[1]
    if not re.fullmatch(r"\d+(\.\d+)?x\d+(\.\d+)?", size_cm):
        raise UserError(f"{prefix}size_cm={size_cm} is not a width and a height; try {prefix}size_cm=92x73")
    width, height = (10 * float(side) for side in size_cm.split("x"))
    if min(width, height) <= 0:
        raise UserError(f"{prefix}size_cm={size_cm} has no area; try {prefix}size_cm=92x73")
    across, down = width / size[1], height / size[0]
    if abs(across / down - 1) > SIDES_APART:
        raise UserError(
            f"{prefix}size_cm={size_cm} does not have the shape of the photograph, {size[1]} x {size[0]} "
            f"pixels: crop that to the painting's edges, or give {prefix}width_cm=... of the part shown"
        )
    return 0.5 * (across + down)


def width_in_table(path: Path, image: str) -> float:
    """Look up a photograph's width in centimetres by its file name in a table (.csv) with columns file and width_cm.

    Raises UserError if the table is missing, or if it contains no valid width for the photograph.
    """
    lines = read_text(path, "give a table with the columns file and width_cm").splitlines()
    rows = list(csv.DictReader(lines))
    if not rows or not {"file", "width_cm"} <= rows[0].keys():
        raise UserError(f"sizes={path} has no rows with the columns file and width_cm; its first line is file,width_cm")
    name = Path(image).name
    texts = [row["width_cm"] for row in rows if row["file"] and Path(row["file"]).name == name]
    if len(texts) != 1:
        raise UserError(f"sizes={path} has {len(texts)} rows for {name}; give one: {name},92")
    try:
        width = float(texts[0])
    except (TypeError, ValueError):
        width = 0.0
    if not 0 < width < MOST_CM:
        raise UserError(f"sizes={path} has no width in centimetres for {name}; write {name},92")
    return width
