"""Draw the pages of a plan: an overview, mixtures, stages, a paint-by-numbers drawing, and sheets of strokes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice, product
from math import ceil
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from brushexp.contracts import UserError
from brushexp.contracts.files import with_progress
from brushexp.contracts.strokes import curve_of, point_at
from brushexp_changes.tubes.amounts import millilitres_of_mixtures, millilitres_of_tubes
from brushexp_changes.tubes.mixtures import Mixtures
from brushexp_changes.tubes.plan import Plan, labels_of, numbered_regions

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

Array = np.ndarray
Tile = tuple[float, float, float, float]  # left, top, width and height in mm on the painting
MM = 1 / 25.4  # inches
POINTS = 72 / 25.4  # points in a mm
PAGE = 210.0, 297.0  # mm, A4
MARGIN, HEAD, LEGEND = 10.0, 14.0, 34.0  # mm
GRID = 50.0  # mm on the painting between two grid lines
ROWS, COLUMNS_OF_LEGEND = 28, 12  # table rows per page, and swatches per row of the legend
ACROSS, DOWN = 3, 4  # number of pictures of stages in a row and in a column of a page
PICTURES = ACROSS * DOWN
STAGE_SIDE = 320  # pixels on the longer side of a stage's picture
GAP, CAPTION = 4.0, 6.0  # mm between pictures, and height in mm of the caption above each
STOPS = MARGIN, 30.0, 62.0, 110.0, 140.0, 170.0  # left edges in mm of the columns in the table of stages
MOST_PAGES = 400
CHORDS = 17  # points per stroke
INK, GREY, FAINT, GROUND = "#202020", "#707070", "#b0b0b0", "#f4f2ec"


def draw_plan(
    plan: Plan,
    title: str,
    remarks: Sequence[str],
    path: Path,
    *,
    scale: float = 1.0,
    smallest_mm: float = 0.0,
) -> None:
    """Write all pages as a PDF, byte-identical for the same plan; raise UserError if there are too many pages.

    ``scale`` applies to the sheets of strokes; ``smallest_mm`` is the minimum size of an area in the paint-by-numbers
    drawing.
    """
    from matplotlib.backends.backend_pdf import PdfPages  # noqa: PLC0415  (slow to import)

    mixtures = plan.table.mixtures
    sheets = [
        (number, tile)
        for number, tile in product(range(len(plan.table.brushes)), _tiles(plan, scale))
        if len(_on_tile(plan, number, tile))
    ]
    count = 2 + len(sheets) + sum(ceil(max(1, rows) / ROWS) for rows in (len(mixtures), len(plan.stages)))
    count += ceil(len(plan.stages) / PICTURES)
    if count > MOST_PAGES:
        smaller = scale * (MOST_PAGES / count) ** 0.5
        raise UserError(f"the plan would have {count} pages, more than {MOST_PAGES}; set to.plan.scale={smaller:.2g}")
    pages = _pages(plan, title, remarks, scale, smallest_mm, sheets)
    with PdfPages(path, metadata={"CreationDate": None, "Title": title}) as file:
        for page in with_progress(pages, count, "pages"):
            file.savefig(page)


def _pages(
    plan: Plan,
    title: str,
    remarks: Sequence[str],
    scale: float,
    smallest_mm: float,
    sheets: Sequence[tuple[int, Tile]],
) -> Iterator[Figure]:
    yield _overview(plan, title, remarks)
    yield from _recipes(plan)
    yield from _stages(plan)
    yield from _pictures(plan)
    yield _by_numbers(plan, smallest_mm)
    for number, tile in sheets:
        yield _sheet(plan, number, tile, scale)


def _tiles(plan: Plan, scale: float) -> list[Tile]:
    """Divide the painting into tiles of equal size that each fit on a sheet."""
    across, down = PAGE[0] - 2 * MARGIN, PAGE[1] - 2 * MARGIN - HEAD
    height, width = (side / plan.pixels_per_mm * scale for side in plan.job.size)
    rows, columns = max(1, ceil(height / down - 1e-6)), max(1, ceil(width / across - 1e-6))
    size = width / columns / scale, height / rows / scale
    return [(column * size[0], row * size[1], *size) for row, column in product(range(rows), range(columns))]


def _page(title: str) -> tuple[Figure, Axes]:
    """Start a page with axes in mm from the page's upper left corner."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(PAGE[0] * MM, PAGE[1] * MM), facecolor="white")
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, PAGE[0]), ylim=(PAGE[1], 0))
    axes.set_axis_off()
    axes.text(MARGIN, MARGIN + 5, title, fontsize=13, color=INK, va="center", weight="bold")
    return figure, axes


def _swatch(axes: Axes, mixtures: Mixtures, number: int, corner: tuple[float, float], side: float) -> None:
    from matplotlib.patches import Rectangle  # noqa: PLC0415

    color = mixtures.color[number].tolist()
    axes.add_patch(Rectangle(corner, side, side, facecolor=color, edgecolor=FAINT, linewidth=0.4))
    light = float(mixtures.color[number].mean()) > 0.5
    middle = corner[0] + side / 2, corner[1] + side / 2
    axes.text(*middle, str(number + 1), ha="center", va="center", fontsize=side, color="black" if light else "white")


def _overview(plan: Plan, title: str, remarks: Sequence[str]) -> Figure:
    figure, axes = _page(title)
    height, width = plan.job.size
    room = PAGE[0] - 2 * MARGIN
    across = min(room, 150.0 * width / height)
    down = across * height / width
    axes.imshow(
        plan.play_back().at_most(1024).picture(), extent=(MARGIN, MARGIN + across, 24 + down, 24), aspect="auto"
    )
    axes.set(xlim=(0, PAGE[0]), ylim=(PAGE[1], 0))
    cm = [side / plan.pixels_per_mm / 10 for side in (width, height)]
    brushes = ", ".join(f"{mm:g} mm" for mm in plan.brushes_mm)
    tubes = ", ".join(f"{tube} {ml:.0f} ml" for tube, ml in millilitres_of_tubes(plan).items())
    ground = _ground(plan)
    lines = [
        *remarks,
        f"{cm[0]:.1f} x {cm[1]:.1f} cm; brushes of {brushes}; a load lasts for {plan.table.load:g} widths of a brush",
        f"tubes: {tubes}",
        "",
        "1. Mix the paints by their recipes and number them; parts are volumes.",
        f"2. {ground}",
        f"3. Draw a grid of {GRID / 10:g} cm on it, or trace the sheets of strokes.",
        "4. Paint stage after stage: large brushes first, and each from dark to light. A stroke begins at its dot.",
        "5. Dip the brush when it runs dry; rinse and wipe it between two stages.",
    ]
    wrapped = [part for line in lines for part in (wrap(line, 105, subsequent_indent="    ") or [""])]
    for k, line in enumerate(wrapped):
        axes.text(MARGIN, 34 + down + 6 * k, line, fontsize=9.5, color=INK, va="center")
    return figure


def _ground(plan: Plan) -> str:
    """Return a sentence that names the mixture for tinting the ground."""
    mixtures = plan.table.mixtures
    if not len(mixtures):
        return "Leave the ground as it is."
    number = int(plan.table.mixture_of(plan.job.saved.background.detach().cpu()[None])[0])
    return f"Tint the ground with mixture {number + 1}, thinned: {mixtures.recipe(number)}."


def _in_parts(count: int) -> Iterator[range]:
    """Divide rows among pages; without rows, return one empty page."""
    return (range(first, min(first + ROWS, count)) for first in range(0, max(1, count), ROWS))


def _recipes(plan: Plan) -> Iterator[Figure]:
    mixtures = plan.table.mixtures
    millilitres = millilitres_of_mixtures(plan)
    for rows in _in_parts(len(mixtures)):
        figure, axes = _page("Mixtures")
        for row, number in enumerate(rows):
            y = 26 + 9 * row
            _swatch(axes, mixtures, number, (MARGIN, y), 7.5)
            axes.text(MARGIN + 12, y + 4, mixtures.recipe(number), fontsize=9.5, va="center", color=INK)
            amount = f"{millilitres[number]:.1f} ml" if millilitres[number] else "not used"
            axes.text(PAGE[0] - MARGIN, y + 4, amount, fontsize=9, va="center", ha="right", color=INK)
        yield figure


def _stages(plan: Plan) -> Iterator[Figure]:
    for rows in _in_parts(len(plan.stages)):
        figure, axes = _page("Stages")
        for x, name in zip(STOPS, ("stage", "brush", "mixture", "strokes", "dips", "metres"), strict=True):
            axes.text(x, 23, name, fontsize=8, color=FAINT, va="center")
        for row, stage in enumerate(plan.stages[rows.start : rows.stop]):
            y = 26 + 9 * row
            _swatch(axes, plan.table.mixtures, stage.mixture, (62, y), 7.5)
            strokes, brush, metres = stage.last - stage.first, f"{stage.brush_mm:g} mm", f"{stage.metres:.2f}"
            for x, text in zip(STOPS, (stage.number, brush, "", strokes, stage.dips, metres), strict=True):
                axes.text(x, y + 4, str(text), fontsize=9.5, va="center", color=INK)
        yield figure


def _pictures(plan: Plan) -> Iterator[Figure]:
    """Play the plan back, and draw the painting after each stage."""
    height, width = plan.job.size
    room = (PAGE[0] - 2 * MARGIN) / ACROSS, (PAGE[1] - 2 * MARGIN - HEAD) / DOWN
    across = min(room[0] - GAP, (room[1] - GAP - CAPTION) * width / height)
    down = across * height / width
    for first in range(0, len(plan.stages), PICTURES):
        figure, axes = _page("After each stage")
        for k, stage in enumerate(plan.stages[first : first + PICTURES]):
            left = MARGIN + room[0] * (k % ACROSS)
            top = MARGIN + HEAD + CAPTION + room[1] * (k // ACROSS)
            picture = plan.after(stage.last).at_most(STAGE_SIDE).picture()
            axes.imshow(picture, extent=(left, left + across, top + down, top), aspect="auto")
            caption = f"{stage.number}: {stage.brush_mm:g} mm, mixture {stage.mixture + 1}"
            axes.text(left, top - 2.5, caption, fontsize=8, va="center", color=INK)
        axes.set(xlim=(0, PAGE[0]), ylim=(PAGE[1], 0))
        yield figure


def _by_numbers(plan: Plan, smallest_mm: float) -> Figure:
    """Draw outlines of the areas that each mixture covers, with the mixtures' numbers."""
    figure, axes = _page("By numbers")
    height, width = plan.job.size
    top = MARGIN + HEAD
    across = min(PAGE[0] - 2 * MARGIN, (PAGE[1] - top - LEGEND - MARGIN) * width / height)
    regions = numbered_regions(plan, smallest_mm)
    unit = across / regions.shape[1]
    frame = MARGIN, MARGIN + across, top + unit * regions.shape[0], top
    x = MARGIN + unit * (np.arange(regions.shape[1]) + 0.5)
    y = top + unit * (np.arange(regions.shape[0]) + 0.5)
    for number in np.unique(regions):
        if min(regions.shape) > 1:
            axes.contour(x, y, regions == number, [0.5], colors=[GREY], linewidths=0.5)
        for row, column, size in labels_of(regions == number):
            font = float(np.clip(size * unit * POINTS, 2.5, 9))
            axes.text(x[column], y[row], str(number + 1), fontsize=font, ha="center", va="center", color=INK)
    _grid(axes, plan, frame, (0.0, 0.0), across / (width / plan.pixels_per_mm))
    mixtures = plan.table.mixtures
    step = (PAGE[0] - 2 * MARGIN) / COLUMNS_OF_LEGEND
    used = [number for number in range(len(mixtures)) if number in {stage.mixture for stage in plan.stages}]
    for k, number in enumerate(islice(used, 4 * COLUMNS_OF_LEGEND)):
        place = MARGIN + step * (k % COLUMNS_OF_LEGEND), frame[2] + 8 + 8 * (k // COLUMNS_OF_LEGEND)
        _swatch(axes, mixtures, number, place, 6.5)
    return figure


def _grid(axes: Axes, plan: Plan, frame: Sequence[float], corner: tuple[float, float], scale: float) -> None:
    """Draw a painting's grid and border in a frame (left, right, bottom, top).

    The frame's upper left corner shows the point ``corner`` of the painting, in mm.
    """
    height, width = (side / plan.pixels_per_mm for side in plan.job.size)
    left, right, bottom, top = frame
    axes_of = (width, corner[0], left, right), (height, corner[1], top, bottom)
    for axis, (side, begin, first, last) in enumerate(axes_of):
        lines = np.append(np.arange(0, side, GRID), side)
        for number, place in enumerate(lines):
            at = first + scale * (place - begin)
            if not first - 1e-6 <= at <= last + 1e-6:
                continue
            edge = 1.0 if place in (0, side) else 0.35
            ends = ([at, at], [top, bottom]) if axis == 0 else ([left, right], [at, at])
            axes.plot(*ends, color=INK, linewidth=edge, solid_capstyle="butt")
            name = chr(ord("A") + number % 26) if axis == 0 else str(number + 1)
            where = (at + 1.5, top - 1.5) if axis == 0 else (left - 1.5, at + 2)
            if place < side:
                axes.text(where[0], where[1], name, fontsize=6, color=INK, ha="center", va="center")


def _sheet(plan: Plan, number: int, tile: Tile, scale: float) -> Figure:
    """Draw a sheet with the strokes of a brush within a tile, enlarged by ``scale``."""
    from matplotlib.collections import LineCollection  # noqa: PLC0415
    from matplotlib.patches import Rectangle  # noqa: PLC0415

    mm = plan.brushes_mm[number]
    part = "" if scale == 1 else f", at {scale:g} of its size"
    corner, (left, top) = tile[:2], (MARGIN, MARGIN + HEAD)
    right, bottom = left + scale * tile[2], top + scale * tile[3]
    figure, axes = _page(f"Brush of {mm:g} mm{part}: from {corner[0] / 10:.1f} cm right, {corner[1] / 10:.1f} cm down")
    clip = Rectangle((left, top), right - left, bottom - top, facecolor=GROUND, edgecolor="none")
    axes.add_patch(clip)
    rows = _on_tile(plan, number, tile)
    t = torch.linspace(0, 1, CHORDS, dtype=torch.float64)
    curves = curve_of(plan.strokes[rows]).double() / plan.pixels_per_mm
    points = (np.array([left, top]) + scale * (point_at(curves[:, None], t).numpy() - corner)).reshape(-1, CHORDS, 2)
    colors = plan.strokes.color[rows].numpy()
    breadth = mm * scale * POINTS
    for k, line in enumerate(points):
        for extra, color in ((0.5, INK), (0.0, colors[k])):
            stroke = LineCollection([line], linewidths=breadth + extra, colors=[color], capstyle="round", zorder=2 + k)
            axes.add_collection(stroke)
            stroke.set_clip_path(clip)
    _draw_numbers(axes, plan, rows, points, clip, float(np.clip(0.3 * breadth, 3.5, 12)))
    _grid(axes, plan, (left, right, bottom, top), corner, scale)
    return figure


def _draw_numbers(axes: Axes, plan: Plan, rows: torch.Tensor, points: Array, clip: Patch, size: float) -> None:
    """Label each stroke with its mixture's number, in a font of ``size`` points, and mark its beginning with a dot."""
    mixture = plan.table.mixture_of(plan.strokes.color[rows]).tolist()
    bright = plan.strokes.color[rows].mean(1).tolist()
    for k, line in enumerate(points):
        color = "black" if bright[k] > 0.45 else "white"
        style: dict[str, Any] = {"fontsize": size, "color": color, "ha": "center", "va": "center", "zorder": 2.5 + k}
        text = axes.text(line[CHORDS // 2, 0], line[CHORDS // 2, 1], str(mixture[k] + 1), clip_on=True, **style)
        (dot,) = axes.plot(*line[0], ".", color=color, markersize=0.5 * size, markeredgewidth=0, zorder=2.5 + k)
        for artist in (text, dot):
            artist.set_clip_path(clip)


def _on_tile(plan: Plan, brush: int, tile: Tile) -> torch.Tensor:
    """Find the strokes of a brush that reach into a tile, in painting order."""
    curves = curve_of(plan.strokes).double() / plan.pixels_per_mm
    reach = plan.brushes_mm[brush] / 2
    low, high = curves.amin(1) - reach, curves.amax(1) + reach
    first = torch.tensor(tile[:2]).double()
    inside = ((high > first) & (low < first + torch.tensor(tile[2:]).double())).all(1)
    return (inside & (plan.table.brush_of(plan.strokes) == brush)).nonzero()[:, 0]
