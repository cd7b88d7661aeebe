"""G-code, which most homemade machines speak."""

import logging
from itertools import pairwise
from pathlib import Path

import numpy as np

from brushexp.errors import UserError
from brushexp.plugins.export._drawing import Drawing, Hidden
from brushexp.plugins.export._plan import Plan, plain, plan_of, preview
from brushexp.plugins.export.base import Exporter, Work
from brushexp.registry import register
from brushexp.system.files import write_text

log = logging.getLogger(__name__)


@register("to", "gcode")
class Gcode(Exporter):
    """``painting.gcode``: a stroke plan for plotters and painting robots that speak G-code, and a picture of it.

    Millimetres from the lower left corner of the paper, y up. It is written here and not with the plugin vpype-gcode,
    whose templates know nothing of a tool that stays in the hand from one layer to the next. For a servo as on many
    plotters: ``'to.gcode.up=M5' 'to.gcode.down=M3 S90'``.

    Args:
        paper: a3, a4, letter, ... or a size such as 300x200mm.
        landscape: true or false; null = as the picture is larger.
        margin_mm: least margin; the picture is as large as it leaves room for, in the middle of the paper.
        width_mm: width of the picture; null = as large as fits.
        colors: tools at most; their colours are those that suit the picture best.
        pens: colours of the pens that you have, in place of ``colors``: [black,red,"#20a080"].
        layers: from the bottom to the top; in each, strokes are drawn tool by tool, from light to dark. With 1 all of
            the picture is; opaque paint keeps the depth of strokes between layers.
        pen_mm: width of the pen or brush.
        passes: lines beside each other in a stroke, at most; null = as many as fill it, 1 = its middle line alone.
        hidden: cut: what strokes of the same layer hide is left out, so that the order of tools does not matter; skip:
            strokes that are hidden wholly are left out, the others stay whole, as a brush wants them; draw: all.
        tolerance_mm: how far a drawn line may be from the curve.
        feed: mm per minute while drawing.
        travel: mm per minute between strokes, for the estimate: how fast G0 is, is the machine's own business.
        up: lifts the pen.
        down: sets it down.
        change: takes another tool; {tool} stands for its number and {color} for its colour. Machines without M6 may
            want 'M0'.
    """

    def __init__(
        self,
        *,
        paper: str = "a4",
        landscape: bool | None = None,
        margin_mm: float = 10.0,
        width_mm: float | None = None,
        colors: int = 8,
        pens: list[str] | None = None,
        layers: int = 1,
        pen_mm: float = 0.5,
        passes: int | None = None,
        hidden: Hidden = Hidden.cut,
        tolerance_mm: float = 0.05,
        feed: float = 1500.0,
        travel: float = 5000.0,
        up: str = "G0 Z5",
        down: str = "G1 Z0 F600",
        change: str = "M6 T{tool}",
    ) -> None:
        self.drawing = Drawing(
            "gcode", paper, landscape, margin_mm, width_mm, colors, pens, layers, pen_mm, passes, hidden, tolerance_mm
        )
        for key, value in (("feed", feed), ("travel", travel)):
            if not 1 <= value <= 1_000_000:
                raise UserError(f"to.gcode.{key}={value:g} is no speed in mm/min; try to.gcode.{key}=1500")
        for key, text in (("up", up), ("down", down), ("change", change)):
            if not text.isascii() or not text.isprintable():
                raise UserError(f"to.gcode.{key}={text!r} is not one line of ASCII; write 'to.gcode.{key}=M3 S90'")
        self.feed = feed
        self.travel = travel
        self.up = up
        self.down = down
        self.change = change

    def write(self, work: Work, folder: Path) -> list[Path]:
        plan = plan_of(work, self.drawing)
        report = plan.report(self.feed, self.travel)
        log.info("gcode: %s", "; ".join(report[2:5]))
        code, picture = folder / "painting.gcode", folder / "painting.gcode.svg"
        write_text(code, "\n".join([*(f"; {plain(row)}" for row in report), *self.program(plan), ""]))
        write_text(picture, preview(plan))
        return [code, picture]

    def program(self, plan: Plan) -> list[str]:
        """The blocks of the program."""
        rows = ["; millimetres from the lower left corner of the paper, y up", "G21", "G90", self.up]
        hand = 0
        for run in plan.runs:
            rows.append(f"; layer {run.layer}, tool {run.tool}, {plan.tools[run.tool - 1]}")
            if run.tool != hand:
                hand = run.tool
                rows += [self.change.replace("{tool}", str(hand)).replace("{color}", plan.tools[hand - 1]), self.up]
            for line in run.lines:
                rows += self._drawn(line, plan.paper[1])
        return [*rows, "G0 X0 Y0", "M2"]

    def _drawn(self, line: np.ndarray, height: float) -> list[str]:
        """One line: there, pen down, along, pen up. Points that are the same micrometre are one."""
        places = [f"X{x + 0.0:.3f} Y{y + 0.0:.3f}" for x, y in zip(
            line.real.round(3).tolist(), (height - line.imag).round(3).tolist(), strict=True
        )]  # fmt: skip
        goals = [place for before, place in pairwise(places) if place != before]
        steps = [f"G1 {goal}" for goal in goals or places[:1]]
        steps[0] += f" F{self.feed:.10g}"
        return [f"G0 {places[0]}", self.down, *steps, self.up]
