"""What pens have to draw for a painting to appear on paper: filled strokes, by layer and pen, in a short order.

Outlines and fillings are shapely's, the order of lines and all file formats vpype's; which parts of a stroke are hidden
is read from a grid on which the strokes are painted with their numbers. Lengths are millimetres, x to the right and y
down from the paper's upper left corner.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from PIL import Image, ImageDraw

from brushexp.pictures.palette import nearest_ink, palette, to_lab, to_rgb
from brushexp.plugins.export._pens import Hidden, PenOptions, load_vpype, millimetre, quiet_vpype
from brushexp.plugins.export.base import ExportJob
from brushexp.strokes.bezier import curve_of, half_width_of

Array = np.ndarray

LEAST_OPACITY = 0.05  # fainter strokes are not drawn
OPAQUE = 0.5  # opacity from which a stroke hides what lies below it
LIFT_SECONDS = 1.0  # to lift a pen, set it down, and turn the machine round: an estimate
JOINED_PENS = 2.0  # widths of the pen, of which one is ink: where the next line begins as near, the pen stays down
CELLS = 500, 2000  # along the picture's longer side: the grid on which is seen what is hidden
SORT_PASSES = 5  # of two-opt
NEARBY_LINES = 4  # of a stroke, the last ones, that its next line may go on from


@dataclass(frozen=True)
class PenPlan:
    """All that is to be drawn.

    Attributes:
        document: vpype's: a layer for each layer of the painting and each pen in it, numbered
            (layer - 1) * len(tools) + tool from 1.
        paper: width and height.
        pen_mm: width of the pen.
        tools: colours in hexadecimal, tool 1 first: from light to dark, so that no light pen takes up dark ink.
        strokes: how many strokes each tool draws, or parts of.
        left_out: how many strokes are not drawn, since nothing of them is to be seen.
        unordered: travel in mm before the lines were put in order.
        source: where the painting came from.
    """

    document: Any
    paper: tuple[float, float]
    pen_mm: float
    tools: list[str]
    strokes: list[int]
    left_out: int
    unordered: float
    source: str

    def runs(self) -> list[tuple[int, int, Any]]:
        """Layer and tool, both from 1, and lines of vpype, in the order in which they are drawn."""
        count = max(1, len(self.tools))
        return [
            ((k - 1) // count + 1, (k - 1) % count + 1, self.document.layers[k]) for k in sorted(self.document.ids())
        ]

    @property
    def lifts(self) -> int:
        """How often the pen is lifted."""
        return sum(len(lines) for _, _, lines in self.runs())

    @property
    def drawn(self) -> float:
        """How far pens draw, mm."""
        return float(self.document.length()) / millimetre()

    @property
    def travel(self) -> float:
        """How far pens move without drawing, mm, from one line of a layer to the next."""
        return float(self.document.pen_up_length()) / millimetre()

    def report(self, draws: float, moves: float) -> list[str]:
        """What people want to know before they start the machine, at ``draws`` and ``moves`` mm per minute."""
        layers = len({layer for layer, _, _ in self.runs()})
        minutes = self.drawn / draws + self.travel / moves + LIFT_SECONDS / 60 * self.lifts
        rows = [
            f"stroke plan of {self.source}",
            f"paper {self.paper[0]:g} x {self.paper[1]:g} mm, pen {self.pen_mm:g} mm",
            f"{sum(self.strokes)} strokes and {self.left_out} more that cannot be seen, {len(self.tools)} tools, "
            f"{layers} layer{'' if layers == 1 else 's'}, {self.lifts} pen lifts",
            f"drawn {self.drawn / 1000:.2f} m, travel {self.travel / 1000:.2f} m, "
            f"before ordering {self.unordered / 1000:.2f} m",
            f"about {minutes:.0f} minutes at {draws:.10g} mm/min and {moves:.10g} mm/min in travel",
        ]
        tools = enumerate(zip(self.tools, self.strokes, strict=True), start=1)
        return [safe_letters(row) for row in rows] + [f"tool {k}: {color}, {n} strokes" for k, (color, n) in tools]

    def svg(self) -> str:
        """The plan as an SVG at the size of the paper, with an Inkscape layer for each run; plotters take it, too."""
        text = io.StringIO()
        load_vpype().write_svg(text, self.document, set_date=False)
        return text.getvalue()


def pen_plan(job: ExportJob, options: PenOptions) -> PenPlan:
    """What pens have to draw for a painting to appear on paper.

    Raises:
        UserError: if the picture does not fit on the paper.
    """
    vpype, mm = load_vpype(), millimetre()
    paper, corner, scale = options.frame(job.size)
    bottom_up = job.bottom_up.cpu().numpy()
    strokes = job.strokes.map(lambda value: value.detach().cpu().double())
    curves = corner + scale * curve_of(strokes).numpy()[bottom_up]
    widths = 2 * scale * half_width_of(strokes).numpy()[bottom_up]
    opacity = strokes.opacity.numpy()[bottom_up]
    frame = (*corner, *(corner + scale * np.array(job.size[::-1])))
    grid = _Grid(frame, options.pen_mm)
    middles = _flattened(curves, options.tolerance_mm / 2)
    outlines = shapely.clip_by_rect(shapely.buffer(middles, widths / 2, quad_segs=16), *frame)
    drawn = (opacity >= LEAST_OPACITY) & (widths > 0) & shapely.intersects(shapely.box(*frame), middles)
    layer = np.arange(len(bottom_up)) * options.layers // max(1, len(bottom_up))
    top = [grid.topmost(outlines, drawn & (opacity >= OPAQUE) & (layer == k)) for k in range(options.layers)]
    above_all = np.maximum.reduce(top)
    lines: list[list[Array]] = []
    for k in range(len(bottom_up)):
        found: list[Array] = []
        if drawn[k] and (options.hidden is Hidden.draw or grid.shows(above_all, outlines[k], middles[k], k)):
            found = _filled(middles[k], widths[k], options, frame)
            if options.hidden is Hidden.cut:
                found = [piece for line in found for piece in grid.pieces(top[layer[k]], line, k, options.pen_mm)]
        lines.append(found)
    shown = np.array([bool(found) for found in lines], dtype=bool)
    picture = np.concatenate([band.permute(1, 2, 0).cpu().numpy() for _, band in job.bands()])
    colors, area = grid.colors(picture, above_all, strokes.color.numpy()[bottom_up])
    tool = np.zeros(len(lines), dtype=int)
    inks, tool[shown] = _inked(colors[shown], area[shown], options)
    document = vpype.Document(page_size=tuple(mm * side for side in paper))
    tools = ["#" + "".join(f"{round(255 * channel):02x}" for channel in ink) for ink in inks]
    for rank in range(options.layers):
        for which, color in enumerate(tools):
            found = [mm * line for k in np.flatnonzero(shown & (layer == rank) & (tool == which)) for line in lines[k]]
            if found:
                number = rank * len(tools) + which + 1
                document.add(vpype.LineCollection(found), number)
                lines_of_tool = document.layers[number]
                for key, value in (
                    ("vp_color", color),
                    ("vp_name", f"layer {rank + 1}, tool {which + 1}, {color}"),
                    ("vp_pen_width", mm * options.pen_mm),
                    ("tool", which + 1),
                    ("color", color),
                ):
                    lines_of_tool.set_property(key, value)
    unordered = document.pen_up_length() / mm
    document = _ordered(
        document, options.tolerance_mm / 2, JOINED_PENS * options.pen_mm if options.hidden is Hidden.cut else None
    )
    return PenPlan(
        document, paper, options.pen_mm, tools, np.bincount(tool[shown], minlength=len(inks)).tolist(),
        int((~shown).sum()), unordered, job.source,
    )  # fmt: skip


def safe_letters(text: str) -> str:
    """Text in letters that every machine takes: some obey single characters (! ? ~) even within a comment."""
    return "".join(c if c.isascii() and (c.isalnum() or c in " .,:/#_+-") else "_" for c in text)


def _ordered(document: Any, tolerance_mm: float, join_mm: float | None) -> Any:
    """The same lines, simplified, in an order with little travel, and those joined that nearly meet."""
    import vpype_cli  # noqa: PLC0415  (slow to import)

    if document.is_empty():
        return document
    merge = "" if join_mm is None else f"linemerge --tolerance {join_mm}mm "
    with quiet_vpype():
        return vpype_cli.execute(
            f"linesimplify --tolerance {tolerance_mm}mm {merge}linesort --two-opt --passes {SORT_PASSES}", document
        )


def _flattened(curves: Array, tolerance: float) -> Array:
    """Quadratic Bezier curves (N, 3, 2) as N polylines of shapely that are within ``tolerance`` of them.

    A chord over a step h of the parameter is at most |P0 - 2 P1 + P2| h^2 / 4 from the curve. Ends that coincide are
    put a nanometre apart, because shapely takes a closed line for a ring, without ends.
    """
    curves = curves + 1e-6 * np.array([[0, 0], [0, 0], [1, 0]]) * (curves[:, :1] == curves[:, 2:]).all(
        -1, keepdims=True
    )
    bend = np.linalg.norm(curves[:, 0] - 2 * curves[:, 1] + curves[:, 2], axis=1)
    steps = np.clip(np.ceil(np.sqrt(bend / (4 * tolerance))), 1, 4096).astype(int) + 1
    owner = np.repeat(np.arange(len(curves)), steps + 1)
    t = (np.arange(len(owner)) - np.repeat(np.cumsum(steps + 1) - steps - 1, steps + 1)) / steps[owner]
    weights = np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], axis=1)
    points = np.einsum("kp,kpd->kd", weights, curves[owner])
    return np.asarray(shapely.linestrings(points, indices=owner), dtype=object) if len(curves) else np.empty(0, object)


def _filled(middle: shapely.LineString, width: float, options: PenOptions, frame: tuple[float, ...]) -> list[Array]:
    """Lines (M,) of complex points that fill a stroke with round ends, as far as they are on the picture.

    They are offsets of its curve, from the outline to the middle, at most a pen apart, and one line as long as they
    stay on the picture; no ink leaves the stroke. A stroke that is not wider than the pen is drawn along its middle.
    """
    radius = 0.5 * max(width - options.pen_mm, 0.0)
    needed = int(np.ceil(2 * radius / options.pen_mm - 1e-9)) + 1
    count = min(needed, options.passes or needed)
    picture = shapely.box(*frame)
    corners = shapely.points(shapely.get_coordinates(picture))
    near, far = shapely.distance(middle, picture), shapely.distance(middle, corners).max()
    step = 2 * radius / max(count - 1, 1)
    inner = max(0, int((radius - far) / max(step, 1e-9)))
    outer = min(count // 2, int((radius - near) / max(step, 1e-9)) + 1)
    offsets = radius - step * np.arange(inner, outer)
    rings = shapely.boundary(shapely.buffer(middle, offsets[offsets > 1e-6], quad_segs=16))
    parts = list(shapely.get_parts(rings)) + [middle] * (count % 2)
    lines: list[Array] = []
    for part in shapely.get_parts(shapely.clip_by_rect(np.array(parts, dtype=object), *frame)):
        points = shapely.get_coordinates(part) @ (1, 1j)
        if len(points) < 2:
            continue
        gaps = [min(np.abs(points[:-1] - line[-1]).min(), abs(points[-1] - line[-1])) for line in lines[-NEARBY_LINES:]]
        if not gaps or min(gaps) > JOINED_PENS * options.pen_mm:
            lines.append(points)
            continue
        nearest = len(lines) - len(gaps) + int(np.argmin(gaps))
        pen = lines[nearest][-1]
        if points[0] == points[-1]:
            begin = int(np.abs(points[:-1] - pen).argmin())
            points = np.concatenate([points[begin:-1], points[: begin + 1]])
        elif abs(points[-1] - pen) < abs(points[0] - pen):
            points = points[::-1]
        if abs(points[0] - pen) <= JOINED_PENS * options.pen_mm:
            lines[nearest] = np.concatenate([lines[nearest], points])
        else:
            lines.append(points)
    return lines


class _Grid:
    """Cells over the picture on which is seen which stroke is the uppermost.

    Args:
        frame: left, top, right and bottom of the picture on the paper.
        pen: width of the pen; cells are half as wide where that is neither too coarse nor too fine.
    """

    def __init__(self, frame: tuple[float, ...], pen: float) -> None:
        self.corner, extent = np.array(frame[:2]), np.array(frame[2:]) - np.array(frame[:2])
        self.cell = float(np.clip(pen / 2, extent.max() / CELLS[1], extent.max() / CELLS[0]))
        self.columns, self.rows = (max(1, round(side / self.cell)) for side in extent)

    def topmost(self, outlines: Array, chosen: Array) -> Array:
        """Number from 1 (rows, columns) of the uppermost of the ``chosen`` strokes in each cell, 0 for none."""
        picture = Image.new("I", (self.columns, self.rows))
        draw = ImageDraw.Draw(picture)
        for k in np.flatnonzero(chosen & ~shapely.is_empty(outlines)):
            for polygon in _polygons(outlines[k]):
                corners = (shapely.get_coordinates(polygon.exterior) - self.corner) / self.cell - 0.5
                draw.polygon(corners.ravel().tolist(), fill=int(k) + 1)
        return np.array(picture)

    def shows(self, top: Array, outline: shapely.Geometry, middle: shapely.Geometry, k: int) -> bool:
        """Whether anything can be seen of stroke ``k``."""
        left, upper, right, lower = shapely.bounds(middle if outline.is_empty else outline)
        (row, column), (below, beyond) = self._cell(left, upper), self._cell(right, lower)
        inside = np.zeros((below - row + 1, beyond - column + 1), dtype=bool)
        mask = Image.new("1", inside.shape[::-1])
        for polygon in _polygons(outline):
            corners = (shapely.get_coordinates(polygon.exterior) - self.corner) / self.cell - (column + 0.5, row + 0.5)
            ImageDraw.Draw(mask).polygon(corners.ravel().tolist(), fill=1)
        inside |= np.array(mask, dtype=bool)
        return not inside.any() or bool((top[row : below + 1, column : beyond + 1][inside] <= k + 1).any())

    def pieces(self, top: Array, line: Array, k: int, shortest: float) -> Iterator[Array]:
        """The parts of a line (M,) of stroke ``k`` that no other stroke hides; those ``shortest`` or longer."""
        points = shapely.get_coordinates(
            shapely.segmentize(shapely.linestrings(np.stack([line.real, line.imag], 1)), self.cell / 2)
        )
        row, column = self._cell(*(0.5 * (points[1:] + points[:-1])).T)
        seen = top[row, column] <= k + 1
        if seen.all():
            yield line
            return
        change = np.flatnonzero(np.diff(np.concatenate([[0], seen, [0]])))
        for begin, end in zip(change[::2], change[1::2], strict=True):
            piece = shapely.simplify(shapely.linestrings(points[begin : end + 1]), 1e-6)  # without the points between
            if piece.length >= shortest:
                yield shapely.get_coordinates(piece) @ (1, 1j)

    def colors(self, picture: Array, top: Array, own: Array) -> tuple[Array, Array]:
        """Mean colours (N, 3) of a picture where strokes are uppermost, or their ``own``, and cells (N,) there."""
        rows = (np.arange(self.rows) * picture.shape[0]) // self.rows
        columns = (np.arange(self.columns) * picture.shape[1]) // self.columns
        cells, owner = picture[rows][:, columns].reshape(-1, 3), top.ravel()
        area = np.bincount(owner, minlength=len(own) + 1)[1:, None]
        sums = np.stack([np.bincount(owner, channel, len(own) + 1)[1:] for channel in cells.T], axis=1)
        return np.where(area > 0, sums / np.maximum(area, 1), own).clip(0, 1), np.maximum(area[:, 0], 1e-3)

    def _cell(self, x: Any, y: Any) -> tuple[Any, Any]:
        row = np.clip(((y - self.corner[1]) / self.cell).astype(int), 0, self.rows - 1)
        return row, np.clip(((x - self.corner[0]) / self.cell).astype(int), 0, self.columns - 1)


def _polygons(outline: shapely.Geometry) -> list[shapely.Polygon]:
    return [part for part in shapely.get_parts(outline) if isinstance(part, shapely.Polygon) and not part.is_empty]


def _inked(colors: Array, area: Array, options: PenOptions) -> tuple[Array, Array]:
    """Colours (K, 3) of the tools that are used, from light to dark, and the tool (N,) from 0 of each stroke."""
    if len(colors) == 0:
        return np.empty((0, 3)), np.empty(0, dtype=int)
    lab = to_lab(colors)
    inks = palette(lab, area, options.colors) if options.own_pens is None else to_lab(options.own_pens)
    inks = inks[np.argsort(-inks[:, 0], kind="stable")]
    used, tool = np.unique(nearest_ink(lab, inks), return_inverse=True)
    return to_rgb(inks[used]), tool
