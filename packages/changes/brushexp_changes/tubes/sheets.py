"""Write a plan for a person who paints: ``to=plan``."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch

from brushexp.contracts import UserError, above, between, register
from brushexp.contracts.families import Exporter, ExportJob
from brushexp.contracts.files import replacing, write_text
from brushexp.contracts.pictures import load_picture
from brushexp.contracts.results import csv_table
from brushexp.contracts.strokes import curve_of
from brushexp.contracts.tasks import PICTURE
from brushexp_changes.tubes.difference import median_difference
from brushexp_changes.tubes.plan import Plan

log = logging.getLogger(__name__)
BRUSH_MM = (0.5, 200.0)  # narrowest and widest brush
COLUMNS = ["stage", "brush_mm", "mixture", "dip", "x1_mm", "y1_mm", "x2_mm", "y2_mm", "x3_mm", "y3_mm"]


@register("to", "plan")
@dataclass(kw_only=True)
class PlanSheets(Exporter):
    """``plan.pdf``: what to mix, in which order to paint, and where; ``plan.csv`` has the strokes, in mm.

    Recipes with parts and swatches, stages of one brush and one mixture, a drawing to paint by numbers, and the strokes
    of each brush on sheets with a grid. The plan is played back, with brushes that run dry, on its first page. What is
    null is as the painting was made with ``tubes=``; another painting gets mixtures and brushes afterwards.

    Args:
        tubes: set of tubes, or a CSV file.
        mixtures: at most so many.
        brushes: widths in mm.
        width_cm: width of the painting in cm.
        load: length that a brush paints with one load, in its widths.
        scale: size of the sheets of strokes over that of the painting; 1 is to be traced.
        target: picture that the plan is compared with, such as the target.png of the run; null = none.
    """

    tubes: str | None = None
    mixtures: Annotated[int, between(1, 200)] | None = None
    brushes: Annotated[list[float], between(*BRUSH_MM)] | None = None
    width_cm: Annotated[float, above(0, 2000)] | None = None
    load: Annotated[float, between(1, 1000)] | None = None
    scale: Annotated[float, above(0, 10)] = 1.0
    target: Annotated[str, PICTURE] | None = None

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        from brushexp_changes.tubes.pages import draw_plan  # noqa: PLC0415  (Matplotlib is slow to import)
        from brushexp_changes.tubes.recorded import recorded_plan  # noqa: PLC0415  (so is Lightning)

        plan, own = recorded_plan(job, vars(self))
        remarks = self.remarks(plan, own)
        log.info("to.plan: %s", "; ".join(remarks))
        with replacing(folder / "plan.pdf") as temporary:
            draw_plan(plan, remarks, self.scale, temporary)
        write_text(folder / "plan.csv", table_of(plan))
        return [folder / "plan.pdf", folder / "plan.csv"]

    def remarks(self, plan: Plan, own: bool) -> list[str]:
        """Say in a few lines what there is to do, and how near the painting comes."""
        lines = [
            f"{len(plan.order)} strokes in {len(plan.stages)} stages, {plan.metres:.1f} m of paint, {plan.dips} dips",
            "painted under these constraints" if own else "mixtures and brushes put on afterwards",
        ]
        if self.target is not None:
            played = torch.from_numpy(plan.played().picture()).movedim(2, 0) / 255
            target = load_picture(self.target, max(played.shape))
            if target.shape != played.shape:
                raise UserError(
                    f"to.plan.target={self.target} has another shape than the painting; give its target.png"
                )
            difference = median_difference(played, target)
            lines.append(f"played back, it differs from the target by CIEDE2000 {difference:.1f} (median)")
        return lines


def table_of(plan: Plan) -> str:
    """Write a plan as CSV: a line for each stroke, in the order of painting; mm from the upper left corner."""
    curves = (curve_of(plan.strokes) / plan.pixels_per_mm).flatten(1).tolist()
    rows = []
    for stage in plan.stages:
        for k in range(stage.first, stage.last):
            place = [f"{value:.2f}" for value in curves[k]]
            rows.append([stage.number, f"{stage.brush_mm:g}", stage.mixture + 1, int(plan.used[k] == 0), *place])
    return csv_table({name: [row[number] for row in rows] for number, name in enumerate(COLUMNS)})
