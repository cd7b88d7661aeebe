"""The matrix of extremes on paper: a table with everything, tables to read, and a picture of all cells."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from brushexp.reporting.plotting import INK, new_figure, save_figure, without_math
from brushexp.reporting.tables import csv_table, markdown_table
from brushexp_extremes.check import GRADIENT_BOUNDS, PICTURE_BOUNDS, Outcome
from brushexp_extremes.matrix import KINDS, MatrixCell

# Of exact, degraded, refused and broken cells: told apart by the colour-blind too, by lightness as well as by hue.
COLORS = ("#B7DFCB", "#F2C14E", "#C9CBD1", "#C0392B")
ROW_INCHES, MARGIN_INCHES = 0.2, 2.5  # height of a row, and of what stands around the rows
HEAD = """# The matrix of extremes

`brushexp experiment=extremes` has written this page; what the outcomes mean and why some cells are degraded is in \
[numerics.md](numerics.md).

![Outcomes](extremes.png)

{counts}.

The number is the largest difference of a pixel from float64, or, marked *g*, the relative difference of a gradient \
where only that is out of bounds. float64 is compared with every stroke at every pixel (`blend=dense`): it shows what \
a blend leaves out by design. The others are compared with the same blend in float64: they show what the arithmetic \
costs. Exact is
"""


def outcome_counts(cells: Sequence[MatrixCell]) -> dict[str, int]:
    """n_exact, n_degraded and so on."""
    found = [cell.check.outcome for cell in cells]
    return {f"n_{outcome.value}": found.count(outcome) for outcome in Outcome}


def outcomes_in_words(cells: Sequence[MatrixCell]) -> str:
    """How many cells are exact, degraded and so on."""
    return ", ".join(f"{value} {name.removeprefix('n_')}" for name, value in outcome_counts(cells).items())


def matrix_csv(cells: Sequence[MatrixCell]) -> str:
    """A row per cell."""
    keys = ("kind", "scene", "renderer", "blend", "dtype", "verdict", "picture", "gradient", "note")
    rows = [vars(cell) | vars(cell.check) | {"verdict": cell.check.outcome.value} for cell in cells]
    return csv_table([{key: row[key] for key in keys} for row in rows], significant=3)


def matrix_text(cells: Sequence[MatrixCell]) -> str:
    """A table for each kind and renderer: a row per scene, a column per precision and blend; messages below."""
    bounds = [
        f"- {dtype}: pictures within {bound:.0e}, gradients within {GRADIENT_BOUNDS[dtype]:.1e}"
        for dtype, bound in PICTURE_BOUNDS.items()
    ]
    lines, notes = [HEAD.format(counts=outcomes_in_words(cells)), *bounds, ""], dict[str, int]()
    tables = dict.fromkeys((cell.kind, cell.renderer) for cell in cells)
    for kind, renderer in sorted(tables, key=lambda table: list(KINDS).index(table[0])):
        rows: dict[str, dict[str, str]] = {}
        for cell in (cell for cell in cells if (cell.kind, cell.renderer) == (kind, renderer)):
            note = cell.check.note
            mark = f" [{notes.setdefault(note, len(notes) + 1)}]" if note else ""
            row = rows.setdefault(cell.scene, {"scene": cell.scene})
            row[f"{cell.blend} {cell.dtype}"] = f"{cell.check.outcome.value} {number_of(cell)}".rstrip() + mark
        text = markdown_table(list(rows.values()), align="l" * len(row), escape=False)
        lines += [f"## {kind}: renderer={renderer}", "", KINDS[kind], "", text, ""]
    return "\n".join([*lines, *(f"{number}. {note}" for note, number in notes.items()), ""])


def draw_matrix(cells: Sequence[MatrixCell], path: Path) -> None:
    """Write a PNG: a field for each cell, coloured by its outcome."""
    from matplotlib.colors import ListedColormap  # noqa: PLC0415

    rows = list(dict.fromkeys((cell.kind, cell.scene) for cell in cells))
    columns = list(dict.fromkeys((cell.renderer, cell.blend, cell.dtype) for cell in cells))
    figure, levels = new_figure(ROW_INCHES * len(rows) + MARGIN_INCHES), np.full((len(rows), len(columns)), np.nan)
    axes = figure.subplots()
    for cell in cells:
        y, x = rows.index((cell.kind, cell.scene)), columns.index((cell.renderer, cell.blend, cell.dtype))
        levels[y, x] = list(Outcome).index(cell.check.outcome)
        axes.text(x, y, number_of(cell).replace("*", ""), ha="center", va="center", fontsize=5, color=INK)
    axes.imshow(levels, cmap=ListedColormap(COLORS), vmin=-0.5, vmax=len(COLORS) - 0.5, aspect="auto")
    axes.set_yticks(range(len(rows)), [without_math(f"{scene}, {kind}") for kind, scene in rows], fontsize=7)
    axes.set_xticks(range(len(columns)), [without_math(" ".join(words)) for words in columns], fontsize=7, rotation=90)
    axes.set_title(outcomes_in_words(cells), fontsize=11, loc="left", color=INK)
    save_figure(figure, path)


def number_of(cell: MatrixCell) -> str:
    """By how much a cell differs: of a pixel, or, marked, of a gradient where only that is out of bounds."""
    check = cell.check
    if check.picture is None:
        return ""
    moved = check.outcome is Outcome.degraded and check.picture <= PICTURE_BOUNDS[cell.dtype]
    value = check.gradient if moved else check.picture
    return "*g* " * moved + (f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e") if value else "0")
