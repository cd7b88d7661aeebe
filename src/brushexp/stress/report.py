"""The matrix of extremes on paper: a table with everything, tables to read, and a picture of all cells."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from brushexp.results.plotting import INK, new_figure, save_figure, without_math
from brushexp.stress.matrix import KINDS, Cell
from brushexp.stress.verdict import GRADIENT, PICTURE, Judgement, Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Told apart by the colour-blind too: by lightness as well as by hue.
COLORS = {Verdict.exact: "#B7DFCB", Verdict.degraded: "#F2C14E", Verdict.refused: "#C9CBD1", Verdict.broken: "#C0392B"}
MARKS = {Verdict.refused: "ref.", Verdict.broken: "BUG"}
NOTHING = 1e-12  # differences below it are 0 in the picture
ROW, MARGIN = 0.27, 2.1  # inches: height of a row, and of what stands around the rows of a kind
COLUMNS = ("kind", "scene", "renderer", "blend", "dtype", "verdict", "picture", "gradient", "note")


def counts(cells: Sequence[Cell]) -> dict[str, int]:
    """n_exact, n_degraded and so on."""
    found = [cell.judgement.verdict for cell in cells]
    return {f"n_{verdict.value}": found.count(verdict) for verdict in Verdict}


def as_csv(cells: Sequence[Cell]) -> str:
    """A row per cell."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(COLUMNS)
    for cell in cells:
        found = cell.judgement
        numbers = ["" if value is None else f"{value:.3g}" for value in (found.picture, found.gradient)]
        place = [cell.kind, cell.scene, cell.renderer, cell.blend, cell.dtype]
        writer.writerow([*place, found.verdict.value, *numbers, found.note])
    return file.getvalue()


def as_markdown(cells: Sequence[Cell]) -> str:
    """A table for each kind and renderer: a row per scene, a column per precision and blend; messages below."""
    lines = [", ".join(f"{value} {name.removeprefix('n_')}" for name, value in counts(cells).items()) + ".", ""]
    lines += [
        "The number is the largest difference of a pixel from float64, or, marked *g*, the relative difference of a "
        "gradient where only that is out of bounds. float64 is compared with every stroke at every pixel "
        "(`blend=dense`): it shows what a blend leaves out by design. The others are compared with the same blend in "
        "float64: they show what the arithmetic costs. Exact is",
        "",
        *(f"- {d}: pictures within {PICTURE[d]:.0e}, gradients within {GRADIENT[d]:.1e}" for d in PICTURE),
        "",
    ]
    notes: dict[str, int] = {}
    for kind, meaning in KINDS.items():
        for renderer in dict.fromkeys(cell.renderer for cell in cells if cell.kind == kind):
            here = [cell for cell in cells if cell.kind == kind and cell.renderer == renderer]
            lines += [f"## {kind}: renderer={renderer}", "", meaning, "", *_table(here, notes), ""]
    lines += [f"{number}. {note}" for note, number in notes.items()]
    return "\n".join([*lines, ""])


def draw(cells: Sequence[Cell], path: Path) -> None:
    """Write a PNG: a field for each cell, coloured by its verdict."""
    kinds = [kind for kind in KINDS if any(cell.kind == kind for cell in cells)]
    heights = [len({cell.scene for cell in cells if cell.kind == kind}) * ROW + MARGIN for kind in kinds]
    figure = new_figure(sum(heights) + 0.5)
    panels = figure.subplots(len(kinds), 1, squeeze=False, height_ratios=heights)[:, 0]
    for kind, axes in zip(kinds, panels, strict=True):
        _draw_kind([cell for cell in cells if cell.kind == kind], kind, axes)
    save_figure(figure, path)


def _draw_kind(cells: Sequence[Cell], kind: str, axes: Axes) -> None:
    from matplotlib.patches import Rectangle  # noqa: PLC0415

    scenes = list(dict.fromkeys(cell.scene for cell in cells))
    columns = list(dict.fromkeys((cell.renderer, cell.blend, cell.dtype) for cell in cells))
    for cell in cells:
        x, y = columns.index((cell.renderer, cell.blend, cell.dtype)), scenes.index(cell.scene)
        verdict = cell.judgement.verdict
        axes.add_patch(Rectangle((x, y), 1, 1, facecolor=COLORS[verdict], edgecolor="white", linewidth=0.8))
        color = "white" if verdict is Verdict.broken else INK
        number = _number(cell.judgement, short=True)
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
    found = counts(cells)
    summary = ", ".join(f"{value} {name.removeprefix('n_')}" for name, value in found.items())
    axes.set_title(f"{kind}: {summary}", fontsize=11, loc="left", color=INK, pad=34)


def _table(cells: Sequence[Cell], notes: dict[str, int]) -> list[str]:
    """Markdown of cells of one kind and renderer; ``notes`` gets what is to be said below."""
    scenes = list(dict.fromkeys(cell.scene for cell in cells))
    columns = list(dict.fromkeys((cell.blend, cell.dtype) for cell in cells))
    found = {(cell.scene, cell.blend, cell.dtype): cell.judgement for cell in cells}
    lines = [["scene", *(f"{blend} {dtype}" for blend, dtype in columns)], ["---"] * (len(columns) + 1)]
    for scene in scenes:
        row = [scene]
        for blend, dtype in columns:
            judgement = found[scene, blend, dtype]
            mark = f" [{notes.setdefault(judgement.note, len(notes) + 1)}]" if judgement.note else ""
            number = _number(judgement, short=False)
            row.append(f"{judgement.verdict.value}{' ' if number else ''}{number}{mark}")
        lines.append(row)
    return [f"| {' | '.join(line)} |" for line in lines]


def _number(judgement: Judgement, *, short: bool) -> str:
    """By how much: of a pixel, or, marked, of a gradient where only that is out of bounds."""
    if judgement.picture is None:
        return MARKS[judgement.verdict] if short else ""
    slope = judgement.gradient
    only_gradient = judgement.only_gradient and slope is not None
    value = slope if only_gradient and slope is not None else judgement.picture
    mark = ("g" if short else "*g* ") if only_gradient else ""
    tells = value > (NOTHING if short else 0)
    return mark + (f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e") if tells else "0")
