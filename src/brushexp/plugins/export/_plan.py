"""What a pen has to draw, whatever language the machine speaks: tools, and lines in the order in which they are drawn.

Lengths are millimetres; points are complex numbers, x to the right and y down from the paper's upper left corner.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from html import escape

import numpy as np

from brushexp.pictures.palette import nearest_ink, palette, to_lab, to_rgb
from brushexp.plugins.export._curves import distance, flattened, hatched
from brushexp.plugins.export._drawing import Drawing, Hidden
from brushexp.plugins.export._library import the_library
from brushexp.plugins.export.base import Work
from brushexp.strokes.bezier import curve_of, half_width_of

Array = np.ndarray

FAINT = 0.05  # opacity below which a stroke is not drawn
LIFT = 0.5  # seconds that it takes to lift a pen, or to set it down, and to turn the machine round: an estimate
GAP = 2.0  # widths of the pen, of which one is ink: where the next line begins as near, the pen stays down
UNDER = 0.25  # widths of the pen: so far lines go on below the edge of what hides them, lest the paper shine through
FINEST, COARSEST = 1 / 2000, 1 / 500  # of the picture's longer side: cells of the grid on which is seen what is hidden


@dataclass(frozen=True)
class Run:
    """Lines that are drawn with one tool.

    Attributes:
        layer: number of the layer, from 1 at the bottom.
        tool: number of the tool, from 1.
        lines: each (M,) points, M >= 2; a dot is the same point twice.
    """

    layer: int
    tool: int
    lines: list[Array]


@dataclass(frozen=True)
class Plan:
    """All that is to be drawn.

    Attributes:
        paper: width and height.
        pen_mm: width of the pen.
        tools: colours in hexadecimal, tool 1 first: from light to dark, so that no light pen takes up dark ink.
        runs: in the order in which they are drawn.
        strokes: how many strokes each tool draws, or parts of.
        left_out: how many strokes are not drawn, since nothing of them is to be seen.
        unordered: travel in mm if the lines were drawn as the catalogue has them.
        source: where the painting came from.
    """

    paper: tuple[float, float]
    pen_mm: float
    tools: list[str]
    runs: list[Run]
    strokes: list[int]
    left_out: int
    unordered: float
    source: str

    @cached_property
    def lifts(self) -> int:
        """How often the pen is lifted."""
        return sum(len(run.lines) for run in self.runs)

    @cached_property
    def drawn(self) -> float:
        """How far pens draw, mm."""
        return sum(float(np.abs(np.diff(line)).sum()) for run in self.runs for line in run.lines)

    @cached_property
    def travel(self) -> float:
        """How far pens move without drawing, mm, from the lower left corner and back to it."""
        return travel_of(self.runs, self.paper)

    def minutes(self, draws: float, moves: float) -> float:
        """About how long it takes at ``draws`` and ``moves`` mm per minute, without changing tools."""
        return self.drawn / draws + self.travel / moves + 2 * LIFT / 60 * self.lifts

    def report(self, draws: float, moves: float) -> list[str]:
        """What people want to know before they start the machine, at ``draws`` and ``moves`` mm per minute."""
        count = len({run.layer for run in self.runs})
        layers = f"{count} layer{'' if count == 1 else 's'}"
        rows = [
            f"stroke plan of {self.source}",
            f"paper {self.paper[0]:g} x {self.paper[1]:g} mm, pen {self.pen_mm:g} mm",
            f"{sum(self.strokes)} strokes and {self.left_out} more that cannot be seen, {len(self.tools)} tools, "
            f"{layers}, {self.lifts} pen lifts",
            f"drawn {self.drawn / 1000:.2f} m, travel {self.travel / 1000:.2f} m, "
            f"before ordering {self.unordered / 1000:.2f} m",
            f"about {self.minutes(draws, moves):.0f} minutes at {draws:.10g} mm/min and {moves:.10g} mm/min in travel",
        ]
        tools = enumerate(zip(self.tools, self.strokes, strict=True), start=1)
        return rows + [f"tool {number}: {color}, {count} strokes" for number, (color, count) in tools]


def plan_of(work: Work, drawing: Drawing) -> Plan:
    """What pens have to draw for a painting to appear on paper.

    Raises:
        UserError: if the picture does not fit on the paper.
    """
    paper, corner, scale = drawing.frame(work.size)
    layer, lines, colors, area = _lines_of(work, drawing, corner, scale)
    inks, tool = _inked(colors, area, drawing)
    runs = []
    for rank in range(drawing.layers):
        for which in range(len(inks)):
            found = [line for k in np.flatnonzero((layer == rank) & (tool == which)) for line in lines[k]]
            runs += [Run(rank + 1, which + 1, found)] if found else []
    unordered = travel_of(runs, paper)
    return Plan(
        paper=paper,
        pen_mm=drawing.pen_mm,
        tools=["#" + "".join(f"{round(255 * channel):02x}" for channel in ink) for ink in inks],
        runs=_shortened(runs, paper, GAP * drawing.pen_mm if drawing.hidden is Hidden.cut else 0.0),
        strokes=np.bincount(tool, minlength=len(inks)).tolist(),
        left_out=len(work.strokes) - len(lines),
        unordered=unordered,
        source=work.source,
    )


def _lines_of(
    work: Work, drawing: Drawing, corner: complex, scale: float
) -> tuple[Array, list[list[Array]], Array, Array]:
    """Strokes that are drawn, from the bottom: layers from 0, lines, colours (N, 3), and areas in cells.

    The colour is that of the painting where the stroke can be seen: ink is opaque, and strokes need not be.
    """
    from brushexp.plugins.export._cover import Cover  # noqa: PLC0415  (slow to import)

    extent = scale * complex(work.size[1], work.size[0])
    longest = max(extent.real, extent.imag)
    cell = min(max(drawing.pen_mm / 2, longest * FINEST), longest * COARSEST)
    bottom_up = work.bottom_up.cpu().numpy()
    curves, widths = _in_millimetres(work, corner, scale)
    opacity, color = (value.detach().cpu().double().numpy() for value in (work.strokes.opacity, work.strokes.color))
    middles = [flattened(curve, drawing.tolerance_mm)[0] for curve in curves]
    above = Cover(corner, extent, cell)
    outlines = above.outlines(middles, np.maximum(widths / 2 - UNDER * drawing.pen_mm, widths / 20))
    cover, current = above, drawing.layers
    found: list[tuple[int, list[Array], Array, Array]] = []
    for rank in range(len(bottom_up) - 1, -1, -1):
        k = bottom_up[rank]
        layer = rank * drawing.layers // len(bottom_up)
        if layer != current and drawing.layers > 1:  # a layer hides by itself what lies in those below it
            cover, current = Cover(corner, extent, cell), layer
        if opacity[k] < FAINT or outlines[k].is_empty:
            continue
        window, mask = above.under(outlines[k])
        lines: list[Array] = []
        if drawing.hidden is Hidden.draw or above.shows(window, mask):
            lines = _on_picture(curves[k], widths[k], drawing, corner, extent)
            if drawing.hidden is Hidden.cut:
                lines = [piece for line in lines for piece in cover.pieces(line, drawing.pen_mm)]
        cells = above.lay(window, mask, color[k], opacity[k])
        if cover is not above:
            cover.lay(window, mask, color[k], opacity[k])
        if lines:
            found.append((layer, lines, color[k], cells))
    found.reverse()
    cells_of = [row[3] for row in found]
    area = np.array([len(cells) for cells in cells_of], dtype=float)
    own = np.array([row[2] for row in found]).reshape(-1, 3)
    seen = above.colors(cells_of, work.background.detach().cpu().double().numpy())
    colors = np.where(area[:, None] > 0, seen, own).clip(0, 1)
    return np.array([row[0] for row in found], dtype=int), [row[1] for row in found], colors, area.clip(1e-3)


def _on_picture(curve: Array, width: float, drawing: Drawing, corner: complex, extent: complex) -> list[Array]:
    """The lines of one stroke, as far as they are on the picture."""
    middle = distance(corner + extent / 2, flattened(curve, drawing.tolerance_mm)[0])
    near, far = middle - abs(extent) / 2, middle + abs(extent) / 2
    way = hatched(curve, width, drawing.pen_mm, drawing.tolerance_mm, drawing.passes, near, far)
    end = corner + extent
    lines = the_library().crop(way, corner.real, corner.imag, end.real, end.imag)
    return list(_joined(lines, GAP * drawing.pen_mm))


def _in_millimetres(work: Work, corner: complex, scale: float) -> tuple[Array, Array]:
    """Control points (N, 3) on the paper and widths (N,)."""
    strokes = work.strokes.map(lambda value: value.detach().cpu().double())
    points = curve_of(strokes).numpy()
    return corner + scale * (points[..., 0] + 1j * points[..., 1]), 2 * scale * half_width_of(strokes).numpy()


def _inked(colors: Array, visible: Array, drawing: Drawing) -> tuple[Array, Array]:
    """Colours (K, 3) of the tools that are used, from light to dark, and the tool (N,) from 0 of each stroke."""
    if len(colors) == 0:
        return np.empty((0, 3)), np.empty(0, int)
    lab = to_lab(colors)
    inks = palette(lab, visible, drawing.colors) if drawing.own_pens is None else to_lab(drawing.own_pens)
    inks = inks[np.argsort(-inks[:, 0], kind="stable")]
    used, tool = np.unique(nearest_ink(lab, inks), return_inverse=True)
    return to_rgb(inks[used]), tool


def travel_of(runs: list[Run], paper: tuple[float, float]) -> float:
    """How far pens move without drawing, mm, from the lower left corner and back to it."""
    lines = [line for run in runs for line in run.lines]
    home = complex(0, paper[1])
    stops = np.array([home, *(line[-1] for line in lines)])
    goals = np.array([*(line[0] for line in lines), home])
    return float(np.abs(goals - stops).sum())


def _shortened(runs: list[Run], paper: tuple[float, float], gap: float) -> list[Run]:
    """The same lines in a better order, and those joined between which is no more than ``gap``."""
    from brushexp.plugins.export._ordering import ordered  # noqa: PLC0415  (slow to import)

    found: list[Run] = []
    pen = complex(0, paper[1])
    for run in runs:
        lines = ordered(run.lines, pen)
        pen = lines[-1][-1]
        found.append(Run(run.layer, run.tool, lines))
    best = found if travel_of(found, paper) <= travel_of(runs, paper) else runs
    return [Run(run.layer, run.tool, list(_joined(run.lines, gap))) for run in best]


def _joined(lines: list[Array], gap: float) -> Iterator[Array]:
    """Lines in their order, in one where the next begins no more than ``gap`` from where the last has ended."""
    parts: list[Array] = []
    for line in lines:
        if parts and not abs(line[0] - parts[-1][-1]) <= gap:
            yield np.concatenate(parts)
            parts = []
        parts.append(line)
    if parts:
        yield np.concatenate(parts)


def preview(plan: Plan) -> str:
    """The plan as a picture: an SVG at the size of the paper, with a layer of Inkscape for each run.

    It has nothing but what is drawn, so that programs which plot an SVG (those of the AxiDraw, vpype) can take it.
    """
    width, height = (f"{side:g}" for side in plan.paper)
    rows = [
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" '
        f'width="{width}mm" height="{height}mm" viewBox="0 0 {width} {height}" style="background:#fff">',
        f"<title>stroke plan of {escape(plain(plan.source))}</title>",
    ]
    look = f'fill="none" stroke-width="{plan.pen_mm:g}" stroke-linecap="round" stroke-linejoin="round"'
    for number, run in enumerate(plan.runs, start=1):
        color = plan.tools[run.tool - 1]
        label = f"{number}: layer {run.layer}, tool {run.tool}, {color}"
        rows.append(f'<g inkscape:groupmode="layer" inkscape:label="{label}" stroke="{color}" {look}>')
        for line in run.lines:
            points = " ".join(f"{x:.2f},{y:.2f}" for x, y in zip(line.real.tolist(), line.imag.tolist(), strict=True))
            rows.append(f'<path d="M{points}"/>')
        rows.append("</g>")
    return "\n".join([*rows, "</svg>", ""])


def plain(text: str) -> str:
    """Text in letters that every machine takes: some obey single characters (! ? ~) even within a comment."""
    return "".join(c if c.isascii() and (c.isalnum() or c in " .,:/#_+-") else "_" for c in text)
