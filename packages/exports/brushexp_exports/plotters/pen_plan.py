"""Plan pen drawings: strokes are filled with lines and drawn by layer and pen, in an order with little travel.

shapely computes outlines and fills, vpype orders lines, and a grid of stroke numbers identifies hidden parts of
strokes. Lengths are in millimetres, with x to the right and y down from the paper's upper left corner. Lines are arrays
of complex numbers.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import shapely
from PIL import Image, ImageDraw

from brushexp.contracts.families import ExportJob
from brushexp.contracts.files import with_progress
from brushexp.contracts.pictures import hex_of, nearest_ink, palette, to_lab, to_rgb
from brushexp.contracts.strokes import Strokes, curve_of, half_width_of
from brushexp_exports.plotters.pens import MM, PenExporter, PenPlan, load_vpype, quiet_vpype

Array = np.ndarray

LEAST_OPACITY = 0.05  # opacity below which strokes are not drawn
OPAQUE = 0.5  # opacity above which a stroke hides the strokes below it
JOINED_PENS = 2.0  # maximum distance, in pen widths, of a next line that is reached without lifting the pen
CELLS = 500, 2000  # minimum and maximum number of grid cells along the picture's longer side
CHORDS = 256  # number of chords of a curve before simplification
AT_ONCE = 4096  # number of curves flattened in one batch
MOST_SWAPPED = 20_000  # maximum number of lines whose order is improved by swaps, whose cost grows quadratically


class OnPaper(NamedTuple):
    """N strokes, bottom to top, and their positions on the paper."""

    strokes: Strokes  # in pixels
    middles: Array  # (N,) curves as shapely lines
    widths: Array  # (N,)
    frame: tuple[float, ...]  # left, top, right and bottom of the painting
    paper: tuple[float, float]  # width and height


def place_on_paper(job: ExportJob, machine: PenExporter) -> OnPaper:
    """Place a painting on a machine's paper; raise UserError if it is too large for the paper or for a plan."""
    machine.check(len(job.strokes), job.size)
    paper, corner, scale = machine.frame(job.size)
    frame = (*corner, *(corner + scale * np.array(job.size[::-1])))
    strokes = job.strokes.map(lambda value: value.detach().cpu().double()[job.bottom_up.cpu()])
    middles = flatten(corner + scale * curve_of(strokes).numpy(), machine.tolerance_mm / 2)
    return OnPaper(strokes, middles, 2 * scale * half_width_of(strokes).numpy(), frame, paper)


def pen_plan(job: ExportJob, machine: PenExporter) -> PenPlan:
    """Plan the lines that draw a painting with pens; raise UserError if it is too large for the paper or for a plan."""
    strokes, middles, widths, frame, paper = place_on_paper(job, machine)
    opacity = strokes.opacity.numpy()
    outlines = shapely.clip_by_rect(shapely.buffer(middles, widths / 2, quad_segs=16), *frame)
    drawable = (opacity >= LEAST_OPACITY) & (widths > 0) & ~shapely.is_empty(outlines)
    layer = np.arange(len(strokes)) * machine.layers // max(1, len(strokes))
    grid = _Grid(frame, machine.pen_mm)
    tops = [grid.topmost(outlines, drawable & (opacity >= OPAQUE) & (layer == k)) for k in range(machine.layers)]
    above_all = np.maximum.reduce(tops)
    candidates = np.flatnonzero(drawable & ((machine.hidden == "draw") | grid.may_be_visible(above_all, outlines)))
    lines: list[list[Array]] = [[] for _ in widths]
    for k in with_progress(candidates.tolist(), len(candidates), "strokes filled"):
        filling = _fill_stroke(middles[k], widths[k], machine, frame, grid.cell / 2)
        if machine.hidden == "draw" or any(grid.is_visible(above_all, line, k).any() for line in filling):
            lines[k] = filling
            if machine.hidden == "cut":
                lines[k] = [piece for line in filling for piece in grid.cut(tops[layer[k]], line, k, machine.pen_mm)]
    visible = np.array([bool(pieces) for pieces in lines], dtype=bool)
    colors, area = grid.colors(job.bare().picture(), above_all, strokes.color.numpy())
    inks, tool = _choose_inks(colors[visible], area[visible], machine)
    tools = [hex_of(ink) for ink in inks]
    runs: dict[tuple[int, int], list[Array]] = {}
    for k, which in zip(np.flatnonzero(visible).tolist(), tool.tolist(), strict=True):
        runs.setdefault((int(layer[k]), which), []).extend(lines[k])
    counts = np.bincount(tool, minlength=len(inks)).tolist()
    layers = []
    for (k, which), pieces in sorted(runs.items()):
        also = f", layer {k + 1}" * (machine.layers > 1)
        layers.append(Layer(k * len(tools) + which + 1, which, tools[which], machine.pen_mm, also, pieces))
    document = order_layers(layers, paper, machine, joins=machine.hidden == "cut")
    return PenPlan(document, paper, machine.pen_mm, tools, counts, int((~visible).sum()), job.source)


class Layer(NamedTuple):
    """Lines drawn with one tool, which form one layer of a vpype document."""

    number: int  # counted from 1; AxiDraw selects layers by the number at the start of their name
    tool: int  # counted from 0
    color: str
    width: float
    also: str  # rest of the layer's name, after number and colour
    lines: list[Array]


def order_layers(layers: Iterable[Layer], paper: tuple[float, float], machine: PenExporter, *, joins: bool) -> Any:
    """Make a document of layers; simplify their lines, sort them to reduce travel and, with ``joins``, join them."""
    vpype = load_vpype()
    document = vpype.Document(page_size=tuple(MM * side for side in paper))
    for number, tool, color, width, also, lines in layers:
        document.add(vpype.LineCollection([MM * line for line in lines]), number)
        properties = {"tool": tool + 1, "color": color, "vp_color": color}
        properties |= {"vp_name": f"{number} - {color}{also}", "vp_pen_width": MM * width}
        for key, value in properties.items():
            document.layers[number].set_property(key, value)
    if document.is_empty():
        return document
    import vpype_cli  # noqa: PLC0415  (slow to import)

    swaps = "--two-opt --passes 5" if max(map(len, document.layers.values())) <= MOST_SWAPPED else ""
    merge = f"linemerge --tolerance {JOINED_PENS * machine.pen_mm}mm" if joins else ""
    with quiet_vpype():
        return vpype_cli.execute(
            f"linesimplify --tolerance {machine.tolerance_mm / 2}mm {merge} linesort {swaps}", document
        )


def flatten(curves: Array, tolerance: float) -> Array:
    """Convert quadratic Bezier curves (N, 3, 2) to N shapely polylines, simplified within ``tolerance``."""
    t, polylines = np.linspace(0, 1, CHORDS + 1), [np.empty(0, dtype=object)]
    weights = np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], axis=1)
    for first in range(0, len(curves), AT_ONCE):
        points = np.einsum("kp,npd->nkd", weights, curves[first : first + AT_ONCE])
        points[:, -1, 0] += 1e-6  # mm; shapely would treat a closed line as a ring without ends
        polylines.append(shapely.simplify(shapely.linestrings(points), tolerance, preserve_topology=False))
    return np.concatenate(polylines)


def _fill_stroke(
    middle: shapely.LineString, width: float, machine: PenExporter, frame: tuple[float, ...], step: float
) -> list[Array]:
    """Fill a round-ended stroke with lines (M,), clipped to the picture, with points at most ``step`` apart.

    The lines are offset curves from the outline to the centre line, at most one pen width apart, and joined where they
    stay within the picture. A stroke no wider than the pen is drawn as its centre line.
    """
    pen = machine.pen_mm
    farthest = shapely.distance(middle, shapely.points(shapely.get_coordinates(shapely.box(*frame)))).max()
    radius = min(0.5 * max(width - pen, 0.0), farthest)  # rings farther out miss the picture
    needed = int(np.ceil(2 * radius / pen - 1e-6)) + 1
    count = min(needed, machine.passes or needed)
    offsets = radius - 2 * radius / max(count - 1, 1) * np.arange(count // 2)
    # Normalised rings begin at their smallest x, and therefore next to each other.
    rings = shapely.normalize(shapely.boundary(shapely.buffer(middle, offsets, quad_segs=16)))
    parts = [*shapely.get_parts(rings)] + [middle] * (count % 2)
    parts = shapely.get_parts(shapely.segmentize(shapely.clip_by_rect(np.array(parts, dtype=object), *frame), step))
    return _join_lines([shapely.get_coordinates(part) @ (1, 1j) for part in parts], JOINED_PENS * pen)


def _join_lines(lines: list[Array], reach: float) -> list[Array]:
    """Join consecutive lines (M,) whose ends are within ``reach`` of each other; then join any other such lines."""
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
    """A grid over a ``frame`` (left, top, right, bottom), used to find hidden parts of strokes.

    Its cells are about half as wide as the ``pen``.
    """

    def __init__(self, frame: tuple[float, ...], pen: float) -> None:
        self.corner, extent = np.array(frame[:2]), np.array(frame[2:]) - np.array(frame[:2])
        self.cell = float(np.clip(pen / 2, extent.max() / CELLS[1], extent.max() / CELLS[0]))
        self.columns, self.rows = (max(1, round(side / self.cell)) for side in extent)

    def topmost(self, outlines: Array, chosen: Array) -> Array:
        """Find the topmost ``chosen`` stroke in each cell (rows, columns), counted from 1; 0 in empty cells."""
        picture = Image.new("I", (self.columns, self.rows))
        draw = ImageDraw.Draw(picture)
        for k in np.flatnonzero(chosen):
            for part in shapely.get_parts(outlines[k]):
                if isinstance(part, shapely.Polygon) and not part.is_empty:
                    corners = (shapely.get_coordinates(part.exterior) - self.corner) / self.cell - 0.5
                    draw.polygon(corners.ravel().tolist(), fill=int(k) + 1)
        return np.array(picture)

    def may_be_visible(self, top: Array, outlines: Array) -> Array:
        """Mark the strokes (N,) that may be visible because higher strokes do not cover their whole bounding boxes."""
        corners = np.nan_to_num(shapely.bounds(outlines)).reshape(-1, 2, 2) @ (1, 1j)
        (tops, lefts), (bottoms, rights) = (self._cells(corner) for corner in corners.T)
        boxes = zip(tops, bottoms + 1, lefts, rights + 1, strict=True)
        bare = ((top[first:last, left:right] <= k + 1).any() for k, (first, last, left, right) in enumerate(boxes))
        return np.fromiter(bare, dtype=bool)

    def is_visible(self, top: Array, points: Array, k: int) -> Array:
        """Mark the points (M,) of stroke ``k`` that are not hidden by another stroke."""
        return np.asarray(top[self._cells(points)] <= k + 1)

    def _cells(self, points: Array) -> tuple[Array, Array]:
        row = np.clip((points.imag - self.corner[1]) / self.cell, 0, self.rows - 1).astype(int)
        column = np.clip((points.real - self.corner[0]) / self.cell, 0, self.columns - 1).astype(int)
        return row, column

    def cut(self, top: Array, line: Array, k: int, shortest: float) -> list[Array]:
        """Cut a line (M,) of stroke ``k`` into visible parts; keep the parts that are at least ``shortest`` long."""
        visible = self.is_visible(top, line, k)
        if visible.all():
            return [line]
        changes = np.flatnonzero(np.diff(visible)) + 1
        parts = [line[part] for part in np.split(np.arange(len(line)), changes) if visible[part[0]]]
        return [part for part in parts if np.abs(np.diff(part)).sum() >= shortest]

    def colors(self, picture: Array, top: Array, own: Array) -> tuple[Array, Array]:
        """Average the picture over the cells where each stroke is on top; return colours (N, 3) and cell counts (N,).

        A stroke that is nowhere on top keeps its ``own`` colour.
        """
        cells = np.asarray(Image.fromarray(picture).resize((self.columns, self.rows), Image.Resampling.NEAREST)) / 255
        area = np.bincount(top.ravel(), minlength=len(own) + 1)[1:, None]
        sums = [np.bincount(top.ravel(), channel.ravel(), len(own) + 1)[1:] for channel in np.moveaxis(cells, 2, 0)]
        return np.where(area > 0, np.stack(sums, axis=1) / np.maximum(area, 1), own), np.maximum(area[:, 0], 1e-3)


def _choose_inks(colors: Array, area: Array, machine: PenExporter) -> tuple[Array, Array]:
    """Choose the colours (K, 3) of the tools, light to dark, and the tool (N,) for each stroke, counted from 0."""
    if len(colors) == 0:
        return np.empty((0, 3)), np.empty(0, dtype=int)
    lab = to_lab(colors)
    inks = palette(lab, area, machine.colors) if machine.own_pens is None else to_lab(machine.own_pens)
    inks = inks[np.argsort(-inks[:, 0], kind="stable")]
    used, tool = np.unique(nearest_ink(lab, inks), return_inverse=True)
    return to_rgb(inks[used]), tool
