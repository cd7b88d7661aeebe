"""One sheet with the pictures of all runs of a sweep, side by side and labelled by what varies."""

import io
import math
from pathlib import Path

from brushexp.results.drawing import SIDE, Cell, Grid, draw, largest_side
from brushexp.results.table import (
    NOTHING,
    Result,
    collect,
    fingerprint,
    formatted,
    picture_of,
    settings,
    shortened,
    summary,
    varying,
)
from brushexp.system.files import write_bytes

COLUMNS = 6  # up to 48 pictures; larger sheets are about square
MATRIX_COLUMNS = 12  # a wider matrix is laid out row by row instead
LEGIBLE = 160  # pixels: and so is a matrix with smaller pictures
NOTED = {"psnr": "dB", "psnr_alpha": "dB in alpha", "seconds": "s"}  # metrics below a picture


def write_sheet(folder: Path) -> Path | None:
    """Write ``sheet.png`` of a sweep; None if no run has left a picture.

    That is painting.png, or what a run calls its ``picture``; a picture of many strokes gets twice the room.
    Runs that differ in two settings and cover all combinations form a matrix; others stand row by row.
    """
    results = collect(folder)
    if not any(picture_of(folder, result).is_file() for result in results):
        return None
    targets = _targets(folder, results)
    grid = _matrix(folder, results, targets) or _row_by_row(folder, results, targets)
    encoded = io.BytesIO()
    sheet = draw(grid, f"{folder.resolve().name}: {summary(results)}")
    sheet.save(encoded, format="PNG", compress_level=1)  # a third of the usual time
    write_bytes(folder / "sheet.png", encoded.getvalue())
    return folder / "sheet.png"


def _targets(folder: Path, results: list[Result]) -> dict[str, Path]:
    """The target of each run that has one; of several equal pictures, the first."""
    first: dict[str, Path] = {}
    targets = {}
    for result in results:
        path = folder / result["run"] / "target.png"
        if path.is_file():
            targets[result["run"]] = first.setdefault(fingerprint(path), path)
    return targets


def _row_by_row(folder: Path, results: list[Result], targets: dict[str, Path]) -> Grid:
    """Every target stands before the first run that was painted after it."""
    axes = varying(results)
    words = {key: _words(key, values) for key, values in axes.items()}
    cells = []
    shown = set()
    for result in results:
        target = targets.get(result["run"])
        if target is not None and target not in shown:
            shown.add(target)
            cells.append(Cell(target, ("target",)))
        chosen = settings(result)
        cells.append(_cell(folder, result, tuple(words[key][chosen.get(key, "")] for key in axes)))
    n = len(cells)
    columns = math.ceil(n / math.ceil(n / COLUMNS)) if n <= 8 * COLUMNS else math.ceil(math.sqrt(n))
    return Grid([cells[i : i + columns] for i in range(0, n, columns)], side=_side(results))


def _matrix(folder: Path, results: list[Result], targets: dict[str, Path]) -> Grid | None:
    """One setting across, one down, and the target at the head of every row; None if the runs are no such grid."""
    axes = varying(results)
    runs = {tuple(settings(result).get(key, "") for key in axes): result for result in results}
    if len(axes) != 2 or not len(runs) == len(results) == math.prod(map(len, axes.values())):
        return None
    wide_first = sorted(axes, key=lambda key: (len(axes[key]) > COLUMNS, -len(axes[key])))
    for across, down in (wide_first, wide_first[::-1]):
        columns, rows = _words(across, axes[across]), _words(down, axes[down])
        table = [[runs[tuple({across: x, down: y}[key] for key in axes)] for x in columns] for y in rows]
        heads = [{targets[result["run"]] for result in row if result["run"] in targets} for row in table]
        grid = Grid(
            [
                [*(Cell(target) for target in head), *(_cell(folder, result) for result in row)]
                for head, row in zip(heads, table, strict=True)
            ],
            row_heads=list(rows.values()),
            column_heads=["target"] * bool(targets) + list(columns.values()),
            side=_side(results),
        )
        fits = len(columns) <= MATRIX_COLUMNS and largest_side(grid) >= LEGIBLE
        if fits and all(len(head) == bool(targets) for head in heads):
            return grid
    return None


def _cell(folder: Path, result: Result, label: tuple[str, ...] = ()) -> Cell:
    run = f"run {result['run']}"
    if result["status"] == "failed":
        return Cell(None, label, (run,), alarm="failed", words=str(result.get("error", "")))
    numbers = [f"{formatted(result, key)} {unit}" for key, unit in NOTED.items()]
    state = [result["status"]] * (result["status"] != "completed")
    note = (*state, *(number for number in numbers if NOTHING not in number), run)
    path = picture_of(folder, result)
    return Cell(path, label, note) if path.is_file() else Cell(None, label, note, words="no picture")


def _side(results: list[Result]) -> int:
    """Room for a picture: a sheet of strokes is made of many small ones."""
    return 2 * SIDE if any("picture" in result for result in results) else SIDE


def _words(key: str, values: list[str]) -> dict[str, str]:
    """How each value of a setting is written on the sheet."""
    return {value: f"{key}={name}" for value, name in shortened(values).items()}
