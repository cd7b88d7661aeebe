"""HPGL, which pen plotters have spoken since 1977."""

import io
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    millimetre,
)
from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp.system.files import write_text

if TYPE_CHECKING:
    from brushexp.plugins.export._pen_plan import PenPlan

log = logging.getLogger(__name__)

UNIT = "0.025mm"  # what HPGL counts in
UNKNOWN_PLOTTER = "brushexp"  # under which vpype knows one whose origin is the lower left corner of the paper
DRAW_SPEED, MOVE_SPEED = 20, 38  # cm/s while drawing and between: usual for plotters that were built when HPGL was


@register("to", "hpgl")
class Hpgl(Exporter):
    """``painting.hpgl``: a stroke plan for pen plotters, what it needs (``.txt``), and a picture of it (``.svg``).

    Written by vpype, which knows the papers and origins of many plotters. HPGL has no comments that old plotters take,
    so that what `PenPlan.report` says is beside it. Tools are the pens of the carousel: ``SP1``, ``SP2``, ...

    Args:
        paper: a3, a4, letter, ... or a size such as 300x200mm.
        landscape: true or false; null = as the picture is larger.
        margin_mm: least margin; the picture is as large as it leaves room for, in the middle of the paper. It is larger
            where the plotter does not reach so far.
        width_mm: width of the picture; null = as large as fits.
        colors: pens at most; their colours are those that suit the picture best.
        pens: colours of the pens that you have, in place of ``colors``: [black,red,"#20a080"].
        layers: from the bottom to the top; in each, strokes are drawn pen by pen, from light to dark.
        pen_mm: width of the pen.
        passes: lines beside each other in a stroke, at most; null = as many as fill it, 1 = its middle line alone.
        hidden: cut: what is hidden by strokes of the same layer is left out, so that the order of pens does not matter;
            skip: strokes that are hidden wholly are left out, the others stay whole; draw: all.
        tolerance_mm: how far a drawn line may be from the curve, not counting the plotter's steps of 1/40 mm.
        plotter: its name in vpype (hp7475a, hp7550, dxy, ...), or in a ~/.vpype.toml of yours; null = any plotter whose
            origin is the lower left corner of the paper, x to the right, y up.
        speed: cm per second while drawing; null = the plotter's own.
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
        plotter: str | None = None,
        speed: Annotated[int, between(1, 1000)] | None = None,
    ) -> None:
        self.plotter = plotter
        self.speed = speed
        self.paper = paper.lower()
        self.options = PenOptions(
            "hpgl", paper, landscape, margin_mm, width_mm, colors, pens, layers, pen_mm, passes, hidden, tolerance_mm,
            reach=0.0 if plotter is None else self._reach(*self._device(plotter)),
        )  # fmt: skip

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        from brushexp.plugins.export._pen_plan import pen_plan  # noqa: PLC0415  (needs the extra plot)

        plan = pen_plan(job, self.options)
        report = plan.report(600 * (self.speed or DRAW_SPEED), 600 * MOVE_SPEED)
        log.info("hpgl: %s", "; ".join(report[2:5]))
        code, notes, picture = (folder / f"painting.hpgl{end}" for end in ("", ".txt", ".svg"))
        write_text(code, self.program(plan))
        write_text(notes, "\n".join([*report, ""]))
        write_text(picture, plan.svg())
        return [code, notes, picture]

    def program(self, plan: "PenPlan") -> str:
        """The program, in one line."""
        vpype = load_vpype()
        device, page, count = UNKNOWN_PLOTTER, UNKNOWN_PLOTTER, max(1, len(plan.tools))
        if self.plotter is None:
            vpype.config_manager.config.setdefault("device", {})[device] = _unknown_plotter(plan, count)
        else:
            plotter, paper = self._device(self.plotter)
            device, page, count = self.plotter, paper.name, plotter.pen_count
        if len(plan.tools) > count:
            raise UserError(
                f"plotter {device} has {count} pens, fewer than {len(plan.tools)}; set to.hpgl.colors={count}"
            )
        document = plan.document.empty_copy()
        for layer, tool, lines in plan.runs():  # vpype draws layers by number, with pen 1 + (number - 1) % pen_count
            document.add(lines, (layer - 1) * count + tool)
        if document.is_empty():
            return "IN;DF;PU;SP0;IN;\n"
        text = io.StringIO()
        vpype.write_hpgl(text, document, page, plan.paper[0] > plan.paper[1], False, device, self.speed, quiet=True)
        return text.getvalue()

    def _device(self, name: str) -> tuple[Any, Any]:
        """What vpype knows of a plotter, and of the paper on it."""
        vpype = load_vpype()
        try:
            plotter = vpype.config_manager.get_plotter_config(name)
        except ValueError as error:  # vpype 1.15 has a slip of the pen in one of its own
            raise UserError(f"vpype cannot read what it knows of plotter {name} ({error}); choose another") from error
        if plotter is None:
            names = ", ".join(known for known in vpype.config_manager.get_plotter_list() if known != UNKNOWN_PLOTTER)
            raise UserError(f"to.hpgl.plotter={name} is not known to vpype; choose one of {names}")
        paper = plotter.paper_config(self.paper)
        if paper is not None:
            return plotter, paper
        names = ", ".join(page.name for page in plotter.paper_configs)
        raise UserError(f"plotter {name} does not take to.hpgl.paper={self.paper}; it takes {names}")

    @staticmethod
    def _reach(plotter: Any, paper: Any) -> float:
        """Margins in mm beyond which a plotter does not come, the largest of the four."""
        if paper.paper_size is None or paper.x_range is None or paper.y_range is None:
            return 0.0
        unit, (width, height), (x, y) = plotter.plotter_unit_length, paper.paper_size, paper.origin_location
        y = height - y if paper.origin_location_reference == "botleft" else y
        ups = [y - unit * k if paper.y_axis_up else y + unit * k for k in paper.y_range]
        acrosses = [x + unit * k for k in paper.x_range]
        pixels = max(min(acrosses), width - max(acrosses), min(ups), height - max(ups))
        return max(0.0, pixels / millimetre())


def _unknown_plotter(plan: "PenPlan", pens: int) -> dict[str, Any]:
    """A plotter in the words of vpype's configuration, on the paper of a plan."""
    width, height = (f"{side}mm" for side in plan.paper)
    page = {
        "name": UNKNOWN_PLOTTER,
        "paper_size": [width, height],
        "y_axis_up": True,
        "origin_location": ["0mm", height],
    }
    page["final_pu_params"] = "0,0"
    return {"name": UNKNOWN_PLOTTER, "plotter_unit_length": UNIT, "pen_count": pens, "paper": [page]}
