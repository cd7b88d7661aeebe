"""Export stroke plans as HPGL, the language of pen plotters since 1977."""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from brushexp.contracts import UserError, between, register
from brushexp.contracts.families import ExportJob
from brushexp_exports.plotters.pens import MM, PenExporter, PenPlan, load_vpype

UNKNOWN_PLOTTER = "brushexp"  # our name in vpype for a plotter with its origin at the lower left corner of the paper
DRAW_SPEED, MOVE_SPEED = 20, 38  # cm/s while drawing and between lines; typical of plotters of the HPGL era


@register("to", "hpgl")
@dataclass(kw_only=True)
class Hpgl(PenExporter):
    """Writes ``painting.hpgl``, a stroke plan for pen plotters, with a report (``.txt``) and a picture (``.svg``).

    The plan is written by vpype, which supports the paper sizes and origins of many plotters. Old plotters do not
    accept comments in HPGL, so the text of `PenPlan.report` is a separate file. Tools are the pens in the carousel:
    ``SP1``, ``SP2``, ... The plotter's rounding to 1/40 mm is added to ``tolerance_mm``.

    Args:
        plotter: name of the plotter in vpype (hp7475a, hp7550, dxy, ...) or in your ~/.vpype.toml; null = any plotter
            with its origin at the lower left corner of the paper, x to the right, y up.
        speed: speed while drawing, in cm per second; null = the plotter's own speed.
    """

    plotter: str | None = None
    speed: Annotated[int, between(1, 1000, typical=20)] | None = None

    @property
    def speeds(self) -> tuple[float, float]:
        return 600 * (self.speed or DRAW_SPEED), 600 * MOVE_SPEED

    @property
    def margin(self) -> float:
        if self.plotter is None:
            return self.margin_mm
        plotter, paper = self._device(self.plotter)
        if paper.paper_size is None or paper.x_range is None or paper.y_range is None:
            return self.margin_mm
        unit, (width, height), (x, y) = plotter.plotter_unit_length, paper.paper_size, paper.origin_location
        y = height - y if paper.origin_location_reference == "botleft" else y
        ups = [y - unit * k if paper.y_axis_up else y + unit * k for k in paper.y_range]
        acrosses = [x + unit * k for k in paper.x_range]
        beyond_reach = max(min(acrosses), width - max(acrosses), min(ups), height - max(ups))
        return max(self.margin_mm, beyond_reach / MM)

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        from brushexp_exports.plotters.program import write_plan  # noqa: PLC0415  (needs the extra plot)

        return write_plan(job, self, folder)

    def programs(self, plan: PenPlan) -> dict[str, str]:
        vpype = load_vpype()
        device, page, count = UNKNOWN_PLOTTER, UNKNOWN_PLOTTER, max(1, len(plan.tools))
        if self.plotter is None:
            width, height = (f"{side}mm" for side in plan.paper)
            sheet = {"name": page, "paper_size": [width, height], "y_axis_up": True, "origin_location": ["0mm", height]}
            vpype.config_manager.config.setdefault("device", {})[device] = {
                "name": device,
                "plotter_unit_length": "0.025mm",
                "pen_count": count,
                "paper": [sheet | {"final_pu_params": "0,0"}],
            }
        else:
            plotter, paper = self._device(self.plotter)
            device, page, count = self.plotter, paper.name, plotter.pen_count
        if len(plan.tools) > count:
            raise UserError(f"{device} has {count} pens, fewer than {len(plan.tools)}; set to.hpgl.colors={count}")
        document = plan.document.empty_copy()
        for layer, tool, lines in plan.runs():  # vpype draws layers by number, with pen 1 + (number - 1) % pen_count
            document.add(lines, (layer - 1) * count + tool)
        text = io.StringIO()
        if document.is_empty():
            text.write("IN;DF;PU;SP0;IN;\n")
        else:
            vpype.write_hpgl(text, document, page, plan.paper[0] > plan.paper[1], False, device, self.speed, quiet=True)
        notes = "\n".join([*plan.report(*self.speeds), ""])
        return {"painting.hpgl": text.getvalue(), "painting.hpgl.txt": notes}

    def _device(self, name: str) -> tuple[Any, Any]:
        """Look up the plotter and its paper in vpype's list of devices."""
        vpype = load_vpype()
        try:
            plotter = vpype.config_manager.get_plotter_config(name)
        except ValueError as error:  # vpype 1.15 has a typo in one of its device files
            raise UserError(f"vpype cannot read its data on plotter {name} ({error}); choose another") from error
        if plotter is None:
            names = ", ".join(each for each in vpype.config_manager.get_plotter_list() if each != UNKNOWN_PLOTTER)
            raise UserError(f"to.hpgl.plotter={name} is not known to vpype; choose one of {names}")
        paper = plotter.paper_config(self.paper.lower())
        if paper is None:
            names = ", ".join(page.name for page in plotter.paper_configs)
            raise UserError(f"plotter {name} does not support to.hpgl.paper={self.paper}; it supports {names}")
        return plotter, paper
