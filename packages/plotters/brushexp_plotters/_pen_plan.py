"""The plan of what pens draw: filled strokes, by layer and pen, in a short order.

Outlines and fillings are shapely's, the order of lines and all file formats vpype's; which parts of a stroke are hidden
is read from a grid on which the strokes are painted with their numbers. Lengths are millimetres, x to the right and y
down from the paper's upper left corner; lines are complex numbers, as vpype has them.
"""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from PIL import Image, ImageDraw

from brushexp.pictures.color import nearest_ink, palette, to_lab, to_rgb
from brushexp.plugins.export.base import ExportJob
from brushexp.shading.light import UNLIT
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.system.files import write_text
from brushexp.system.progress import with_progress
from brushexp_plotters._pens import MM, PenExporter, PenPlan, load_vpype, quiet_vpype

log = logging.getLogger(__name__)
Array = np.ndarray

LEAST_OPACITY = 0.05  # fainter strokes are not drawn
OPAQUE = 0.5  # opacity from which a stroke hides what lies below it
JOINED_PENS = 2.0  # widths of the pen, of which one is ink: where the next line begins as near, the pen stays down
CELLS = 500, 2000  # along the picture's longer side: the grid on which is seen what is hidden
CHORDS = 256  # of a curve, before those that are not needed are left out
AT_ONCE = 4096  # curves that are flattened
MOST_SWAPPED = 20_000  # lines whose order is improved by swaps: that takes the square of their number


def write_plan(job: ExportJob, machine: PenExporter, folder: Path) -> list[Path]:
    """Plan what pens draw, and write the program of the machine and a picture of the plan into a folder."""
    plan = pen_plan(job, machine)
    log.info("%s: %s", machine.key, "; ".join(plan.report(*machine.speeds)[2:5]))
    texts = machine.programs(plan)
    texts[f"{next(iter(texts))}.svg"] = plan.svg()
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]


def pen_plan(job: ExportJob, machine: PenExporter) -> PenPlan:
    """Plan what pens draw for a painting to appear on paper; a UserError if a paper or plan cannot hold it."""
    machine.check(len(job.strokes), job.size)
    paper, corner, scale = machine.frame(job.size)
    frame = (*corner, *(corner + scale * np.array(job.size[::-1])))
    strokes = job.strokes.map(lambda value: value.detach().cpu().double()[job.bottom_up.cpu()])
    middles = _flattened(corner + scale * curve_of(strokes).numpy(), machine.tolerance_mm / 2)
    widths, opacity = 2 * scale * half_width_of(strokes).numpy(), strokes.opacity.numpy()
    outlines = shapely.clip_by_rect(shapely.buffer(middles, widths / 2, quad_segs=16), *frame)
    drawn = (opacity >= LEAST_OPACITY) & (widths > 0) & ~shapely.is_empty(outlines)
    layer = np.arange(len(strokes)) * machine.layers // max(1, len(strokes))
    grid = _Grid(frame, machine.pen_mm)
    tops = [grid.topmost(outlines, drawn & (opacity >= OPAQUE) & (layer == k)) for k in range(machine.layers)]
    above_all = np.maximum.reduce(tops)
    hopeful = np.flatnonzero(drawn & ((machine.hidden == "draw") | grid.may_be_seen(above_all, outlines)))
    lines: list[list[Array]] = [[] for _ in widths]
    for k in with_progress(hopeful.tolist(), len(hopeful), "strokes filled"):
        filled = _filled(middles[k], widths[k], machine, frame, grid.cell / 2)
        if machine.hidden == "draw" or any(grid.seen(above_all, line, k).any() for line in filled):
            lines[k] = filled
            if machine.hidden == "cut":
                lines[k] = [piece for line in filled for piece in grid.pieces(tops[layer[k]], line, k, machine.pen_mm)]
    shown = np.array([bool(found) for found in lines], dtype=bool)
    colors, area = grid.colors(replace(job, light=UNLIT).picture(), above_all, strokes.color.numpy())
    inks, tool = _inked(colors[shown], area[shown], machine)
    tools = ["#" + "".join(f"{round(255 * channel):02x}" for channel in ink) for ink in inks]
    runs: dict[tuple[int, int], list[Array]] = {}
    for k, which in zip(np.flatnonzero(shown).tolist(), tool.tolist(), strict=True):
        runs.setdefault((int(layer[k]), which), []).extend(lines[k])
    counts = np.bincount(tool, minlength=len(inks)).tolist()
    document = _document(runs, paper, tools, machine)
    return PenPlan(document, paper, machine.pen_mm, tools, counts, int((~shown).sum()), job.source)


def _document(
    runs: dict[tuple[int, int], list[Array]], paper: tuple[float, float], tools: list[str], machine: PenExporter
) -> Any:
    """Lines of (layer, tool), both from 0, simplified, in an order with little travel; those cut joined where near."""
    vpype = load_vpype()
    document = vpype.Document(page_size=tuple(MM * side for side in paper))
    for (layer, tool), lines in sorted(runs.items()):
        number, color = layer * len(tools) + tool + 1, tools[tool]
        document.add(vpype.LineCollection([MM * line for line in lines]), number)
        name, properties = f"layer {layer + 1}, tool {tool + 1}, {color}", {"tool": tool + 1, "color": color}
        properties |= {"vp_color": color, "vp_name": name, "vp_pen_width": MM * machine.pen_mm}
        for key, value in properties.items():
            document.layers[number].set_property(key, value)
    if document.is_empty():
        return document
    import vpype_cli  # noqa: PLC0415  (slow to import)

    swaps = "--two-opt --passes 5" if max(map(len, document.layers.values())) <= MOST_SWAPPED else ""
    merge = f"linemerge --tolerance {JOINED_PENS * machine.pen_mm}mm" if machine.hidden == "cut" else ""
    with quiet_vpype():
        return vpype_cli.execute(
            f"linesimplify --tolerance {machine.tolerance_mm / 2}mm {merge} linesort {swaps}", document
        )


def _flattened(curves: Array, tolerance: float) -> Array:
    """Quadratic Bezier curves (N, 3, 2) as N polylines of shapely that are within ``tolerance`` of fine ones."""
    t, found = np.linspace(0, 1, CHORDS + 1), [np.empty(0, dtype=object)]
    weights = np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], axis=1)
    for first in range(0, len(curves), AT_ONCE):
        points = np.einsum("kp,npd->nkd", weights, curves[first : first + AT_ONCE])
        points[:, -1, 0] += 1e-6  # mm: shapely takes a closed line for a ring, without ends
        found.append(shapely.simplify(shapely.linestrings(points), tolerance, preserve_topology=False))
    return np.concatenate(found)


def _filled(
    middle: shapely.LineString, width: float, machine: PenExporter, frame: tuple[float, ...], step: float
) -> list[Array]:
    """Lines (M,) that fill a stroke with round ends, as far as they are on the picture.

    They are offsets of its curve, from the outline to the middle, at most a pen apart, and one line while they stay on
    the picture, with points at most a ``step`` apart. A stroke that is not wider than the pen is its middle.
    """
    pen = machine.pen_mm
    farthest = shapely.distance(middle, shapely.points(shapely.get_coordinates(shapely.box(*frame)))).max()
    radius = min(0.5 * max(width - pen, 0.0), farthest)  # rings beyond are not on the picture
    needed = int(np.ceil(2 * radius / pen - 1e-6)) + 1
    count = min(needed, machine.passes or needed)
    offsets = radius - 2 * radius / max(count - 1, 1) * np.arange(count // 2)
    # Normalised rings begin where x is least: one beside the other.
    rings = shapely.normalize(shapely.boundary(shapely.buffer(middle, offsets, quad_segs=16)))
    parts = [*shapely.get_parts(rings)] + [middle] * (count % 2)
    parts = shapely.get_parts(shapely.segmentize(shapely.clip_by_rect(np.array(parts, dtype=object), *frame), step))
    return _joined([shapely.get_coordinates(part) @ (1, 1j) for part in parts], JOINED_PENS * pen)


def _joined(lines: list[Array], reach: float) -> list[Array]:
    """The same lines (M,), one with the next where that begins or ends within ``reach``; any two if some are left."""
    joined: list[Array] = []
    for line in lines:
        gaps = np.abs(joined[-1][-1] - line[[0, -1]]) if joined else [np.inf]
        if min(gaps) <= reach:
            joined[-1] = np.concatenate([joined[-1], line if gaps[0] <= gaps[-1] else line[::-1]])
        else:
            joined.append(line)
    if len(joined) < 2:
        return joined
    collection = load_vpype().LineCollection(joined)
    with quiet_vpype():
        collection.merge(reach)
    return list(collection)


class _Grid:
    """Cells over the picture on which is seen which stroke is the uppermost.

    Of ``frame``, the picture's left, top, right and bottom; cells are half a ``pen`` wide, or coarser, or finer.
    """

    def __init__(self, frame: tuple[float, ...], pen: float) -> None:
        self.corner, extent = np.array(frame[:2]), np.array(frame[2:]) - np.array(frame[:2])
        self.cell = float(np.clip(pen / 2, extent.max() / CELLS[1], extent.max() / CELLS[0]))
        self.columns, self.rows = (max(1, round(side / self.cell)) for side in extent)

    def topmost(self, outlines: Array, chosen: Array) -> Array:
        """Number from 1 (rows, columns) of the uppermost of the ``chosen`` strokes in each cell, 0 for none."""
        picture = Image.new("I", (self.columns, self.rows))
        draw = ImageDraw.Draw(picture)
        for k in np.flatnonzero(chosen):
            for part in shapely.get_parts(outlines[k]):
                if isinstance(part, shapely.Polygon) and not part.is_empty:
                    corners = (shapely.get_coordinates(part.exterior) - self.corner) / self.cell - 0.5
                    draw.polygon(corners.ravel().tolist(), fill=int(k) + 1)
        return np.array(picture)

    def may_be_seen(self, top: Array, outlines: Array) -> Array:
        """Whether others leave bare any cell of the boxes around strokes (N,): what is quick to find out."""
        corners = np.nan_to_num(shapely.bounds(outlines)).reshape(-1, 2, 2) @ (1, 1j)
        (tops, lefts), (bottoms, rights) = (self._cells(corner) for corner in corners.T)
        boxes = zip(tops, bottoms + 1, lefts, rights + 1, strict=True)
        seen = ((top[first:last, left:right] <= k + 1).any() for k, (first, last, left, right) in enumerate(boxes))
        return np.fromiter(seen, dtype=bool)

    def seen(self, top: Array, points: Array, k: int) -> Array:
        """Which points (M,) of stroke ``k`` no other stroke hides."""
        return np.asarray(top[self._cells(points)] <= k + 1)

    def _cells(self, points: Array) -> tuple[Array, Array]:
        """Row and column of the cells in which points (M,) are."""
        row = np.clip((points.imag - self.corner[1]) / self.cell, 0, self.rows - 1).astype(int)
        column = np.clip((points.real - self.corner[0]) / self.cell, 0, self.columns - 1).astype(int)
        return row, column

    def pieces(self, top: Array, line: Array, k: int, shortest: float) -> list[Array]:
        """The parts of a line (M,) of stroke ``k`` that no other stroke hides; those ``shortest`` or longer."""
        seen = self.seen(top, line, k)
        if seen.all():
            return [line]
        changes = np.flatnonzero(np.diff(seen)) + 1
        parts = [line[part] for part in np.split(np.arange(len(line)), changes) if seen[part[0]]]
        return [part for part in parts if np.abs(np.diff(part)).sum() >= shortest]

    def colors(self, picture: Array, top: Array, own: Array) -> tuple[Array, Array]:
        """Mean colours (N, 3) of a picture where strokes are uppermost, or their ``own``, and cells (N,) there."""
        cells = np.asarray(Image.fromarray(picture).resize((self.columns, self.rows), Image.Resampling.NEAREST)) / 255
        area = np.bincount(top.ravel(), minlength=len(own) + 1)[1:, None]
        sums = [np.bincount(top.ravel(), channel.ravel(), len(own) + 1)[1:] for channel in np.moveaxis(cells, 2, 0)]
        return np.where(area > 0, np.stack(sums, axis=1) / np.maximum(area, 1), own), np.maximum(area[:, 0], 1e-3)


def _inked(colors: Array, area: Array, machine: PenExporter) -> tuple[Array, Array]:
    """Colours (K, 3) of the tools that are used, from light to dark, and the tool (N,) from 0 of each stroke."""
    if len(colors) == 0:
        return np.empty((0, 3)), np.empty(0, dtype=int)
    lab = to_lab(colors)
    inks = palette(lab, area, machine.colors) if machine.own_pens is None else to_lab(machine.own_pens)
    inks = inks[np.argsort(-inks[:, 0], kind="stable")]
    used, tool = np.unique(nearest_ink(lab, inks), return_inverse=True)
    return to_rgb(inks[used]), tool
