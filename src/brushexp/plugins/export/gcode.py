"""G-code, which most homemade machines speak."""

import io
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from brushexp.bounds import between
from brushexp.errors import UserError
from brushexp.plugins.export._pens import (
    Colors,
    Hidden,
    Layers,
    Margin,
    Passes,
    PenOptions,
    PenWidth,
    PictureWidth,
    Tolerance,
    load_vpype,
)
from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp.system.files import write_text

if TYPE_CHECKING:
    from brushexp.plugins.export._pen_plan import PenPlan

log = logging.getLogger(__name__)


@register("to", "gcode")
class Gcode(Exporter):
    """``painting.gcode``: a stroke plan for plotters and painting robots that speak G-code, and a picture of it.

    Millimetres from the lower left corner of the paper, y up; written by the plugin vpype-gcode. For a servo as on many
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
        margin_mm: Margin = 10.0,
        width_mm: PictureWidth | None = None,
        colors: Colors = 8,
        pens: list[str] | None = None,
        layers: Layers = 1,
        pen_mm: PenWidth = 0.5,
        passes: Passes | None = None,
        hidden: Hidden = Hidden.cut,
        tolerance_mm: Tolerance = 0.05,
        feed: Annotated[float, between(1, 1_000_000)] = 1500.0,
        travel: Annotated[float, between(1, 1_000_000)] = 5000.0,
        up: str = "G0 Z5",
        down: str = "G1 Z0 F600",
        change: str = "M6 T{tool}",
    ) -> None:
        self.options = PenOptions(
            "gcode", paper, landscape, margin_mm, width_mm, colors, pens, layers, pen_mm, passes, hidden, tolerance_mm
        )
        for key, text in (("up", up), ("down", down), ("change", change)):
            if not text.isascii() or not text.isprintable():
                raise UserError(f"to.gcode.{key}={text!r} is not one line of ASCII; write 'to.gcode.{key}=M3 S90'")
        self.feed = feed
        self.travel = travel
        self.up = up
        self.down = down
        self.change = change

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        from brushexp.plugins.export._pen_plan import pen_plan  # noqa: PLC0415  (needs the extra plot)

        plan = pen_plan(job, self.options)
        report = plan.report(self.feed, self.travel)
        log.info("gcode: %s", "; ".join(report[2:5]))
        code, picture = folder / "painting.gcode", folder / "painting.gcode.svg"
        write_text(code, self.program(plan, report))
        write_text(picture, plan.svg())
        return [code, picture]

    def program(self, plan: "PenPlan", report: list[str]) -> str:
        """The program, with what ``report`` says at its head."""
        vpype = load_vpype()
        head = [*report, "millimetres from the lower left corner of the paper, y up"]
        up, down = (text.replace("{", "{{").replace("}", "}}") for text in (self.up, self.down))
        vpype.config_manager.config.setdefault("gwrite", {})["brushexp"] = {
            "unit": "mm",
            "vertical_flip": True,
            "document_start": "".join(f"; {row}\n" for row in head) + f"G21\nG90\n{up}\n",
            "layer_start": f"; {{vp_name}}\n{self.change}\n{up}\n",
            "segment_first": f"G0 X{{x:.3f}} Y{{y:.3f}}\n{down}\nG1 F{self.feed:.10g}\n",
            "segment": "G1 X{x:.3f} Y{y:.3f}\n",
            "line_end": f"{up}\n",
            "document_end": "G0 X0 Y0\nM2\n",
        }
        from click import BadParameter  # noqa: PLC0415  (slow to import, with vpype)
        from vpype_cli.state import State  # noqa: PLC0415
        from vpype_gcode.gwrite import gwrite  # noqa: PLC0415

        text = io.StringIO()
        text.name = "painting.gcode"
        try:
            gwrite.callback(output=text, profile="brushexp", default=())(State(plan.document))
        except BadParameter as error:
            raise UserError(
                f"to.gcode.change={self.change!r} names more than {{tool}} and {{color}}; write 'M6 T{{tool}}'"
            ) from error
        return text.getvalue()
