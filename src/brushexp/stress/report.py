"""The matrix of extremes on paper: a table with everything, tables to read, and a picture of all cells."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from brushexp.results.plotting import INK, new_figure, save_figure, without_math
from brushexp.results.tables import csv_table, markdown_table
from brushexp.stress.check import GRADIENT_BOUNDS, PICTURE_BOUNDS, Check, Outcome
from brushexp.stress.matrix import KINDS, MatrixCell

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Told apart by the colour-blind too: by lightness as well as by hue.
COLORS = {Outcome.exact: "#B7DFCB", Outcome.degraded: "#F2C14E", Outcome.refused: "#C9CBD1", Outcome.broken: "#C0392B"}
MARKS = {Outcome.refused: "ref.", Outcome.broken: "BUG"}
SHOWN_AS_0 = 1e-12  # differences below it, in the picture
ROW_INCHES, MARGIN_INCHES = 0.27, 2.1  # height of a row, and of what stands around the rows of a kind


def outcome_counts(cells: Sequence[MatrixCell]) -> dict[str, int]:
    """n_exact, n_degraded and so on."""
    found = [cell.check.outcome for cell in cells]
    return {f"n_{outcome.value}": found.count(outcome) for outcome in Outcome}


def outcomes_in_words(cells: Sequence[MatrixCell]) -> str:
    """How many cells are exact, degraded and so on."""
    return ", ".join(f"{value} {name.removeprefix('n_')}" for name, value in outcome_counts(cells).items())


def matrix_csv(cells: Sequence[MatrixCell]) -> str:
    """A row per cell."""
    rows = [
        {
            "kind": cell.kind,
            "scene": cell.scene,
            "renderer": cell.renderer,
            "blend": cell.blend,
            "dtype": cell.dtype,
            "verdict": cell.check.outcome.value,
            "picture": cell.check.picture,
            "gradient": cell.check.gradient,
            "note": cell.check.note,
        }
        for cell in cells
    ]
    return csv_table(rows, significant=3)


def matrix_text(cells: Sequence[MatrixCell]) -> str:
    """A table for each kind and renderer: a row per scene, a column per precision and blend; messages below."""
    lines = [f"{outcomes_in_words(cells)}.", ""]
    lines += [
        "The number is the largest difference of a pixel from float64, or, marked *g*, the relative difference of a "
        "gradient where only that is out of bounds. float64 is compared with every stroke at every pixel "
        "(`blend=dense`): it shows what a blend leaves out by design. The others are compared with the same blend in "
        "float64: they show what the arithmetic costs. Exact is",
        "",
        *(
            f"- {dtype}: pictures within {bound:.0e}, gradients within {GRADIENT_BOUNDS[dtype]:.1e}"
            for dtype, bound in PICTURE_BOUNDS.items()
        ),
        "",
    ]
    notes: dict[str, int] = {}
    for kind, meaning in KINDS.items():
        for renderer in dict.fromkeys(cell.renderer for cell in cells if cell.kind == kind):
            rows: dict[str, dict[str, str]] = {}
            for cell in (cell for cell in cells if (cell.kind, cell.renderer) == (kind, renderer)):
                note, number = cell.check.note, _number(cell.check, short=False)
                mark = f" [{notes.setdefault(note, len(notes) + 1)}]" if note else ""
                row = rows.setdefault(cell.scene, {"scene": cell.scene})
                row[f"{cell.blend} {cell.dtype}"] = f"{cell.check.outcome.value}{' ' if number else ''}{number}{mark}"
            table = markdown_table(list(rows.values()), align="l" * len(next(iter(rows.values()))), escape=False)
            lines += [f"## {kind}: renderer={renderer}", "", meaning, "", table, ""]
    lines += [f"{number}. {note}" for note, number in notes.items()]
    return "\n".join([*lines, ""])


def draw_matrix(cells: Sequence[MatrixCell], path: Path) -> None:
    """Write a PNG: a field for each cell, coloured by its outcome."""
    kinds = [kind for kind in KINDS if any(cell.kind == kind for cell in cells)]
    scenes = [len({cell.scene for cell in cells if cell.kind == kind}) for kind in kinds]
    heights = [count * ROW_INCHES + MARGIN_INCHES for count in scenes]
    figure = new_figure(sum(heights) + 0.5)
    panels = figure.subplots(len(kinds), 1, squeeze=False, height_ratios=heights)[:, 0]
    for kind, axes in zip(kinds, panels, strict=True):
        _draw_kind([cell for cell in cells if cell.kind == kind], kind, axes)
    save_figure(figure, path)


def _draw_kind(cells: Sequence[MatrixCell], kind: str, axes: Axes) -> None:
    from matplotlib.patches import Rectangle  # noqa: PLC0415

    scenes = list(dict.fromkeys(cell.scene for cell in cells))
    columns = list(dict.fromkeys((cell.renderer, cell.blend, cell.dtype) for cell in cells))
    for cell in cells:
        x, y = columns.index((cell.renderer, cell.blend, cell.dtype)), scenes.index(cell.scene)
        outcome = cell.check.outcome
        axes.add_patch(Rectangle((x, y), 1, 1, facecolor=COLORS[outcome], edgecolor="white", linewidth=0.8))
        color = "white" if outcome is Outcome.broken else INK
        number = _number(cell.check, short=True)
        size = 6.5 if len(number) < 5 else 5.0
        axes.text(x + 0.5, y + 0.5, number, ha="center", va="center", fontsize=size, color=color)
    axes.set(xlim=(0, len(columns)), ylim=(len(scenes), 0))
    axes.set_yticks([k + 0.5 for k in range(len(scenes))], [without_math(scene) for scene in scenes], fontsize=8)
    axes.set_xticks([k + 0.5 for k in range(len(columns))], [dtype for *_, dtype in columns], fontsize=7, rotation=90)
    axes.tick_params(length=0, labelcolor=INK)
    axes.spines[:].set_visible(False)
    for k, (renderer, blend, _) in enumerate(columns):
        if k == 0 or columns[k - 1][:2] != (renderer, blend):
            width = sum(column[:2] == (renderer, blend) for column in columns)
            axes.axvline(k, color=INK, linewidth=1.4 if k == 0 or columns[k - 1][0] != renderer else 0.6)
            axes.text(k + width / 2, -0.25, without_math(f"{renderer}\n{blend}"), ha="center", va="bottom", fontsize=8)
    axes.set_title(f"{kind}: {outcomes_in_words(cells)}", fontsize=11, loc="left", color=INK, pad=34)


def _number(check: Check, *, short: bool) -> str:
    """By how much: of a pixel, or, marked, of a gradient where only that is out of bounds."""
    value = check.gradient if check.only_gradient else check.picture
    if value is None:
        return MARKS[check.outcome] if short else ""
    mark = ("g" if short else "*g* ") if check.only_gradient else ""
    tells = value > (SHOWN_AS_0 if short else 0)
    return mark + (f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e") if tells else "0")
