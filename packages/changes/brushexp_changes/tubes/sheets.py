"""Export a plan for painting by hand: ``to=plan``."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
from torch.nn.functional import interpolate

from brushexp.contracts import Rule, UserError, above, between, register
from brushexp.contracts.families import Exporter, ExportJob
from brushexp.contracts.files import replacing, write_text
from brushexp.contracts.painting import recorded_settings
from brushexp.contracts.pictures import check_ratio, load_picture
from brushexp.contracts.results import csv_table
from brushexp.contracts.strokes import curve_of
from brushexp.contracts.tasks import PICTURE
from brushexp_changes.tubes.amounts import hours_of, millilitres_of_tubes
from brushexp_changes.tubes.difference import median_difference
from brushexp_changes.tubes.plan import Plan

log = logging.getLogger(__name__)
BRUSH_MM = (0.5, 200.0)  # narrowest and widest brush
COLUMNS = ["stage", "brush_mm", "mixture", "dip", "x1_mm", "y1_mm", "x2_mm", "y2_mm", "x3_mm", "y3_mm"]


@dataclass(frozen=True)
class Difficulty:
    """Settings for one level of difficulty of a plan."""

    options: dict[str, object]  # default options of `PlanSheets` at this difficulty
    smallest_mm: float  # side of the smallest part of the paint-by-numbers drawing
    least_visible: float  # visible share of a stroke below which it is left out


AS_PAINTED = Difficulty({}, 0.0, 0.0)
DIFFICULTIES = {
    "easy": Difficulty({"mixtures": 8, "brushes": [25.0, 12.0]}, 15.0, 0.1),
    "medium": Difficulty({"mixtures": 12, "brushes": [25.0, 12.0, 6.0]}, 8.0, 0.05),
    "hard": Difficulty({}, 0.0, 0.02),
}


def _check_difficulty(name: str, option: str) -> None:
    if name not in DIFFICULTIES:
        raise UserError(f"{option}={name} does not exist; choose one of {', '.join(DIFFICULTIES)}")


@register("to", "plan")
@dataclass(kw_only=True)
class PlanSheets(Exporter):
    """Writes ``plan.pdf``, instructions for painting by hand, and ``plan.csv``, a list of the strokes in mm.

    The PDF contains recipes with parts, swatches and amounts in ml; stages of one brush and one mixture, with a picture
    after each stage; a paint-by-numbers drawing; and sheets with a grid that show the strokes of each brush. The first
    page shows the plan played back with brushes that run dry. Options that are null take the values of ``tubes=``
    recorded in the painting; for a painting made without ``tubes=``, mixtures and brushes are chosen afterwards.

    Args:
        tubes: set of tubes, or a CSV file.
        mixtures: maximum number of mixtures.
        brushes: widths of the brushes in mm.
        width_cm: width of the painting in cm.
        load: length that a brush paints with one load, in brush widths.
        scale: scale of the sheets of strokes relative to the painting; 1 is for tracing.
        difficulty: level of difficulty, easy, medium or hard. It sets the size of the smallest part and, unless
            ``mixtures`` and ``brushes`` are given, the mixtures and brushes; null = as recorded in the painting.
        target: picture to compare the plan with, for example the run's target.png; null = none. The log reports the
            difference.
    """

    tubes: str | None = None
    mixtures: Annotated[int, between(1, 200, typical=24)] | None = None
    brushes: Annotated[list[float], between(*BRUSH_MM)] | None = None
    width_cm: Annotated[float, above(0, 2000, typical=30)] | None = None
    load: Annotated[float, between(1, 1000, typical=12)] | None = None
    scale: Annotated[float, above(0, 10)] = 1.0
    difficulty: Annotated[str, Rule(_check_difficulty)] | None = None
    target: Annotated[str, PICTURE] | None = None

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        from brushexp_changes.tubes.pages import draw_plan  # noqa: PLC0415  (Matplotlib is slow to import)
        from brushexp_changes.tubes.recorded import recorded_plan  # noqa: PLC0415  (so is Lightning)

        level = AS_PAINTED if self.difficulty is None else DIFFICULTIES[self.difficulty]
        plan, own = recorded_plan(
            job, level.options | {name: value for name, value in vars(self).items() if value is not None}
        )
        plan = plan.drop_hidden(level.least_visible)
        remarks = remarks_on(plan, own)
        log.info("to.plan: %s", "; ".join(remarks))
        if self.target is not None:
            log.info("to.plan: CIEDE2000 %.1f from the target (median)", difference_from(plan, self.target))
        with replacing(folder / "plan.pdf") as temporary:
            draw_plan(
                plan,
                title_of(job),
                remarks,
                temporary,
                scale=self.scale,
                smallest_mm=level.smallest_mm,
            )
        write_text(folder / "plan.csv", table_of(plan))
        return [folder / "plan.pdf", folder / "plan.csv"]


def title_of(job: ExportJob) -> str:
    """Name a plan after the picture that was painted, not after the folder of the run."""
    image = str(recorded_settings(job.saved).get("image") or "")
    return f"To paint: {Path(image).stem}" if image else "To paint"


def remarks_on(plan: Plan, own: bool) -> list[str]:
    """Summarise the work that a plan requires in a few lines."""
    used = len({stage.mixture for stage in plan.stages})
    paint = sum(millilitres_of_tubes(plan).values())
    return [
        f"{len(plan.order):,} strokes in {len(plan.stages)} stages, {used} mixtures, {plan.dips:,} dips",
        f"about {hours_of(plan):.1f} hours, and {paint:.0f} ml of paint" if plan.stages else "nothing to paint",
        "painted with these mixtures and brushes" if own else "mixtures and brushes applied afterwards",
    ]


def difference_from(plan: Plan, picture: str) -> float:
    """Compute the median CIEDE2000 difference between a played-back plan and a picture with the same aspect ratio."""
    played = torch.from_numpy(plan.play_back().picture()).movedim(2, 0) / 255
    height, width = played.shape[1:]
    target = load_picture(picture, max(height, width))
    check_ratio(picture, target.shape[1:], (height, width), "to.plan.target")
    target = interpolate(target[None], (height, width), mode="bilinear", align_corners=False)[0]
    return median_difference(played, target)


def table_of(plan: Plan) -> str:
    """Format a plan as CSV, one line per stroke in painting order, with positions in mm from the upper left corner."""
    curves = (curve_of(plan.strokes) / plan.pixels_per_mm).flatten(1).tolist()
    rows = []
    for stage in plan.stages:
        for k in range(stage.first, stage.last):
            place = [f"{value:.2f}" for value in curves[k]]
            rows.append([stage.number, f"{stage.brush_mm:g}", stage.mixture + 1, int(plan.used[k] == 0), *place])
    return csv_table({name: [row[number] for row in rows] for number, name in enumerate(COLUMNS)})
