"""Base class for exporters to plotters and painting robots, with their options, paper and stroke plan."""

import io
import logging
import re
from abc import abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from types import ModuleType
from typing import Annotated, Any

import numpy as np
from PIL import ImageColor

from brushexp.contracts import UserError, between, one_of
from brushexp.contracts.families import Exporter

Array = np.ndarray
MM = 96 / 25.4  # CSS pixels, the unit of vpype, per millimetre
MOST_STROKES = 100_000  # maximum number in a plan; each takes milliseconds to fill, and seconds to draw
MOST_WELLS = 500
PLACE = r"-?[0-9]{1,5}(?:\.[0-9]{1,3})?x-?[0-9]{1,5}(?:\.[0-9]{1,3})?"  # x and y in mm
LIFT_SECONDS = 1.0  # estimated seconds to lift a pen, set it down, and change direction


@dataclass(frozen=True)
class PenPlan:
    """Lines that a machine draws with its pens."""

    document: Any  # vpype document; its layer (layer - 1) * len(tools) + tool holds a layer's lines of one tool
    paper: tuple[float, float]  # width and height, mm
    pen_mm: float
    tools: list[str]  # pen colours in hexadecimal, light to dark, so that no light pen picks up dark ink; or brushes
    strokes: list[int]  # number of strokes that each tool draws in whole or in part
    left_out: int  # number of invisible strokes, which are not drawn
    source: str  # origin of the painting
    notes: list[str] = field(default_factory=list)  # further lines of the report

    def runs(self) -> list[tuple[int, int, Any]]:
        """List the layer, tool and vpype lines of each run in drawing order; layers and tools are counted from 1."""
        count = max(1, len(self.tools))
        numbers = sorted(self.document.ids())
        return [((k - 1) // count + 1, (k - 1) % count + 1, self.document.layers[k]) for k in numbers]

    @property
    def lifts(self) -> int:
        return sum(len(lines) for _, _, lines in self.runs())

    @property
    def drawn(self) -> float:
        return float(self.document.length()) / MM

    @property
    def travel(self) -> float:
        """Distance in mm that pens move without drawing, between lines of the same pen or different pens."""
        ends = np.array([line[[0, -1]] for _, _, lines in self.runs() for line in lines]).reshape(-1, 2)
        return float(np.abs(ends[1:, 0] - ends[:-1, 1]).sum()) / MM

    def report(self, draws: float, moves: float) -> list[str]:
        """Describe the paper, pens and duration for given speeds of drawing and moving, in mm per minute."""
        layers = len({layer for layer, _, _ in self.runs()})
        minutes = self.drawn / draws + self.travel / moves + LIFT_SECONDS / 60 * self.lifts
        rows = [
            f"stroke plan of {self.source}",
            f"paper {self.paper[0]:g} x {self.paper[1]:g} mm, pen {self.pen_mm:g} mm",
            f"{sum(self.strokes)} strokes, {self.left_out} invisible strokes left out, {len(self.tools)} tools, "
            f"{layers} layer{'' if layers == 1 else 's'}, {self.lifts} pen lifts",
            f"drawn {self.drawn / 1000:.2f} m, travel {self.travel / 1000:.2f} m",
            f"about {minutes:.0f} minutes at {draws:.10g} mm/min and {moves:.10g} mm/min during travel",
        ]
        tools = enumerate(zip(self.tools, self.strokes, strict=True), start=1)
        rows += [f"tool {k}: {color}, {n} strokes" for k, (color, n) in tools] + self.notes
        # Some machines execute single characters (! ? ~) even within a comment.
        return [re.sub(r"[^A-Za-z0-9 .,:/#_+-]", "_", row) for row in rows]

    def svg(self) -> str:
        """Return the plan as an SVG the size of the paper, with an Inkscape layer for each run."""
        text = io.StringIO()
        load_vpype().write_svg(text, self.document, set_date=False)
        return text.getvalue()


@dataclass(kw_only=True)
class PenExporter(Exporter):
    """Base class for exporters to machines that draw with pens or brushes; its fields are their options.

    Args:
        paper: size of the paper: a3, a4, letter, ... or a size such as 300x200mm.
        landscape: whether to use the paper in landscape orientation; null = the orientation with the larger picture.
        margin_mm: minimum margin in mm; the picture is centred and fills the rest. The margin is larger where the
            plotter cannot reach.
        width_mm: width of the picture in mm; null = as large as possible.
        colors: maximum number of pens, whose colours are chosen to fit the picture.
        pens: colours of your own pens, instead of ``colors``: [black,red,"#20a080"].
        layers: number of layers, bottom to top; within a layer, strokes are drawn pen by pen, light to dark. If
            paint is opaque, more layers preserve the order of overlapping strokes better.
        pen_mm: width of the pen or brush in mm.
        passes: maximum number of parallel lines in a stroke; null = as many as fill the stroke, 1 = only its centre
            line.
        hidden: treatment of hidden parts: cut omits parts hidden by strokes of the same layer, so that the order of
            pens does not matter; skip omits only completely hidden strokes, which suits brushes; draw keeps everything.
        tolerance_mm: maximum distance between a drawn line and the curve in mm.
        wells: positions of paint wells for a dipped brush. 20x15:230x45:8x3 is a tray of 8 x 3 wells, from the
            centre of the first to the centre of the last, in mm from the lower left corner of the paper. Tools are
            then brushes, and each stroke is one movement, in order of depth; this suits paintings with ``tubes=``.
            null = pens.
        water: position where a brush is rinsed before each change of colour or brush, for example 20x80; null = no
            rinsing.
        cloth: position where the brush is wiped after rinsing; null = no wiping.
        load: length that a brush paints with one load, in brush widths.
    """

    paper: str = "a4"
    landscape: bool | None = None
    margin_mm: Annotated[float, between(0, 1000)] = 10.0
    width_mm: Annotated[float, between(0.1, 100_000, typical=200)] | None = None
    colors: Annotated[int, between(1, 64)] = 8
    pens: list[str] | None = None
    layers: Annotated[int, between(1, 10_000)] = 1
    pen_mm: Annotated[float, between(0.05, 500)] = 0.5
    passes: Annotated[int, between(1, 2000, typical=3)] | None = None
    hidden: Annotated[str, one_of("cut", "skip", "draw")] = "cut"
    tolerance_mm: Annotated[float, between(0.001, 10)] = 0.05
    wells: str | None = None
    water: str | None = None
    cloth: str | None = None
    load: Annotated[float, between(1, 1000)] = 12.0

    def __post_init__(self) -> None:
        # Invalid options raise their errors here, before anything is drawn.
        self.own_pens, self.tray, self.place("water"), self.place("cloth")
        if self.page[0] <= 2 * self.margin:
            raise UserError(
                f"margins of {self.margin:g} mm leave no room on {self.page[0]:g} x {self.page[1]:g} mm; "
                f"choose a larger paper, {self.key}.paper=a3, or smaller margins, {self.key}.margin_mm=5"
            )

    @abstractmethod
    def programs(self, plan: PenPlan) -> dict[str, str]:
        """Return the text of each file for the machine, by file name; the program comes first."""

    @property
    @abstractmethod
    def speeds(self) -> tuple[float, float]:
        """Speeds while drawing and while moving without drawing, in mm per minute."""

    @property
    def margin(self) -> float:
        return self.margin_mm

    def check(self, count: int, size: tuple[int, int]) -> None:
        self.frame(size)
        if count > MOST_STROKES:
            excess = f"{count} strokes are more than the {MOST_STROKES} that a plan can hold"
            raise UserError(f"{self.key}: {excess}; paint with fewer (strokes=), or use to=svg")

    @cached_property
    def page(self) -> tuple[float, float]:
        """Shorter and longer side of the paper in mm."""
        vpype, text = load_vpype(), self.paper.lower()
        names = sorted(name for name, (short, _) in vpype.PAGE_SIZES.items() if short > 0)
        sides = [0.0]
        if text in names or text.replace("x", "").strip("0123456789."):  # sizes have units
            with suppress(ValueError):
                sides = sorted(round(side / MM, 6) for side in vpype.convert_page_size(text))
        if not 1 <= sides[0] <= sides[-1] <= 100_000:
            raise UserError(
                f"{self.key}.paper={self.paper} is not a paper; choose one of {', '.join(names)}, "
                f"or a size such as {self.key}.paper=300x200mm"
            )
        return sides[0], sides[1]

    @cached_property
    def own_pens(self) -> Array | None:
        """Colours (K, 3), in [0, 1], of the user's pens; None if pens may have any colour."""
        if self.pens is None:
            return None
        if not 1 <= len(self.pens) <= 256:
            raise UserError(f"{self.key}.pens has {len(self.pens)}; give 1 to 256 colours, {self.key}.pens=[black]")
        try:
            return np.array([ImageColor.getrgb(pen)[:3] for pen in self.pens]) / 255
        except ValueError as error:
            raise UserError(f"{self.key}.pens: {error}; write '{self.key}.pens=[black,\"#c03020\"]'") from None

    @cached_property
    def tray(self) -> list[complex]:
        """Positions of the wells, row by row, in mm from the lower left corner of the paper; empty for pens."""
        if self.wells is None:
            return []
        found = re.fullmatch(f"({PLACE}):({PLACE}):([0-9]{{1,3}})x([0-9]{{1,3}})", self.wells)
        if found is None or not 1 <= int(found[3]) * int(found[4]) <= MOST_WELLS:
            cure = f"try {self.key}.wells=20x15:230x45:8x3, from the first to the last of 8 x 3"
            raise UserError(f"{self.key}.wells={self.wells} is not a tray of 1 to {MOST_WELLS} wells; {cure}")
        first, last = (_place(found[k]) for k in (1, 2))
        columns, rows = (np.linspace(0, 1, int(found[k])) for k in (3, 4))
        return [complex(first.real + x * (last - first).real, first.imag + y * (last - first).imag)
                for y in rows for x in columns]  # fmt: skip

    def place(self, name: str) -> complex | None:
        """Parse the position given in an option, in mm from the lower left corner of the paper."""
        text = getattr(self, name)
        if text is not None and not re.fullmatch(PLACE, text):
            raise UserError(f"{self.key}.{name}={text} is not a place in mm; try {self.key}.{name}=20x80")
        return None if text is None else _place(text)

    def frame(self, size: tuple[int, int]) -> tuple[tuple[float, float], Array, float]:
        """Compute the paper size and a centred picture's corner (2,) in mm, and the picture's scale in mm per pixel."""

        def room(paper: tuple[float, float]) -> float:
            return round(min((side - 2 * self.margin) / n for side, n in zip(paper, size[::-1], strict=True)), 9)

        upright, across = self.page, self.page[::-1]
        paper = max({None: (upright, across), False: (upright,), True: (across,)}[self.landscape], key=room)
        scale = room(paper)
        if self.width_mm is not None:
            if self.width_mm > scale * size[1] + 1e-6:
                raise UserError(
                    f"{self.key}.width_mm={self.width_mm:g} is too wide for {paper[0]:g} x {paper[1]:g} mm and its "
                    f"margins; try {self.key}.width_mm={np.floor(10 * scale * size[1] + 1e-6) / 10:g}"
                )
            scale = self.width_mm / size[1]
        return paper, (np.array(paper) - scale * np.array(size[::-1])) / 2, scale


def _place(text: str) -> complex:
    return complex(*map(float, text.split("x")))


def load_vpype() -> ModuleType:
    """Import the optional library vpype, which is slow to import; raise UserError if it is not installed."""
    try:
        with quiet_vpype():
            import vpype  # noqa: PLC0415
            import vpype_cli  # noqa: F401, PLC0415
    except ImportError as error:
        raise UserError(
            "to=hpgl and to=gcode need vpype, which is not installed; pip install 'brushexp[plot]'"
        ) from error
    return vpype


@contextmanager
def quiet_vpype() -> Iterator[None]:
    """Mute vpype's messages; afterwards, restore the root logger's level and handlers, which vpype changes."""
    level, handlers = logging.root.level, [*logging.root.handlers]
    logging.disable(logging.INFO)
    try:
        yield
    finally:
        logging.root.setLevel(level)
        logging.root.handlers[:] = handlers
        logging.disable(logging.NOTSET)
