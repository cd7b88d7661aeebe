"""HPGL, which pen plotters have spoken since 1977."""

import io
import logging
from pathlib import Path
from typing import Any

from brushexp.errors import UserError
from brushexp.plugins.export._drawing import Drawing, Hidden
from brushexp.plugins.export._library import the_library
from brushexp.plugins.export._plan import Plan, plain, plan_of, preview
from brushexp.plugins.export.base import Exporter, Work
from brushexp.registry import register
from brushexp.system.files import write_text

log = logging.getLogger(__name__)

UNIT = "0.025mm"  # what HPGL counts in
PLAIN = "brushexp"  # under which vpype knows our plotter
SPEED, SWIFT = 20, 38  # cm/s while drawing and between: usual for plotters that were built when HPGL was


@register("to", "hpgl")
class Hpgl(Exporter):
    """``painting.hpgl``: a stroke plan for pen plotters, what it needs (``.txt``), and a picture of it (``.svg``).

    Written by vpype, which knows the papers and origins of many plotters. HPGL has no comments that old plotters take,
    so that what `Plan.report` says is beside it. Tools are the pens of the carousel: ``SP1``, ``SP2``, ...

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
        margin_mm: float = 10.0,
        width_mm: float | None = None,
        colors: int = 8,
        pens: list[str] | None = None,
        layers: int = 1,
        pen_mm: float = 0.5,
        passes: int | None = None,
        hidden: Hidden = Hidden.cut,
        tolerance_mm: float = 0.05,
        plotter: str | None = None,
        speed: int | None = None,
    ) -> None:
        if speed is not None and not 1 <= speed <= 1000:
            raise UserError(f"to.hpgl.speed={speed} is no speed in cm/s; try to.hpgl.speed={SPEED}")
        self.plotter = plotter
        self.speed = speed
        self.paper = paper.lower()
        self.drawing = Drawing(
            "hpgl", paper, landscape, margin_mm, width_mm, colors, pens, layers, pen_mm, passes, hidden, tolerance_mm,
            reach=0.0 if plotter is None else self._reach(*self._device(plotter)),
        )  # fmt: skip

    def write(self, work: Work, folder: Path) -> list[Path]:
        plan = plan_of(work, self.drawing)
        report = plan.report(600 * (self.speed or SPEED), 600 * SWIFT)
        log.info("hpgl: %s", "; ".join(report[2:5]))
        code, notes, picture = (folder / f"painting.hpgl{end}" for end in ("", ".txt", ".svg"))
        write_text(code, self.program(plan))
        write_text(notes, "\n".join([*map(plain, report), ""]))
        write_text(picture, preview(plan))
        return [code, notes, picture]

    def program(self, plan: Plan) -> str:
        """The program, in one line."""
        vpype = the_library()
        device, count = PLAIN, max(1, len(plan.tools))
        if self.plotter is None:
            vpype.config_manager.config.setdefault("device", {})[PLAIN] = _plain_plotter(plan, count)
        else:
            device, count = self.plotter, self._device(self.plotter)[0].pen_count
        if len(plan.tools) > count:
            raise UserError(
                f"plotter {device} has {count} pens, fewer than {len(plan.tools)}; set to.hpgl.colors={count}"
            )
        if not plan.runs:
            return "IN;DF;PU;SP0;IN;\n"
        document = vpype.Document(page_size=tuple(side * vpype.UNITS["mm"] for side in plan.paper))
        for run in plan.runs:  # vpype draws layers in order of their numbers, with pen 1 + (number - 1) % pen_count
            lines = [line * vpype.UNITS["mm"] for line in run.lines]
            document.add(vpype.LineCollection(lines), (run.layer - 1) * count + run.tool)
        text = io.StringIO()
        page = PLAIN if self.plotter is None else self._device(self.plotter)[1].name
        across = plan.paper[0] > plan.paper[1]
        vpype.write_hpgl(text, document, page, across, False, device, self.speed, quiet=True)
        return text.getvalue()

    def _device(self, name: str) -> tuple[Any, Any]:
        """What vpype knows of a plotter, and of the paper on it."""
        vpype = the_library()
        try:
            plotter = vpype.config_manager.get_plotter_config(name)
        except ValueError as error:  # vpype 1.15 has a slip of the pen in one of its own
            raise UserError(f"vpype cannot read what it knows of plotter {name} ({error}); choose another") from error
        if plotter is None:
            names = ", ".join(known for known in vpype.config_manager.get_plotter_list() if known != PLAIN)
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
        return max(0.0, pixels / the_library().UNITS["mm"])


def _plain_plotter(plan: Plan, pens: int) -> dict[str, Any]:
    """A plotter in the words of vpype's configuration, on the paper of a plan."""
    width, height = (f"{side}mm" for side in plan.paper)
    page = {"name": PLAIN, "paper_size": [width, height], "y_axis_up": True, "origin_location": ["0mm", height]}
    page["final_pu_params"] = "0,0"
    return {"name": PLAIN, "plotter_unit_length": UNIT, "pen_count": pens, "paper": [page]}
