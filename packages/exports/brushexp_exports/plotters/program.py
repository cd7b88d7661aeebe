"""Write a machine program and a picture of its plan."""

import logging
from pathlib import Path

from brushexp.contracts.families import ExportJob
from brushexp.contracts.files import write_text
from brushexp_exports.plotters.brush_plan import brush_plan
from brushexp_exports.plotters.pen_plan import pen_plan
from brushexp_exports.plotters.pens import PenExporter

log = logging.getLogger(__name__)


def write_plan(job: ExportJob, machine: PenExporter, folder: Path) -> list[Path]:
    """Plan the drawing, and write the machine's program and a picture of the plan to a folder."""
    plan = pen_plan(job, machine) if machine.wells is None else brush_plan(job, machine)
    log.info("%s: %s", machine.key, "; ".join(plan.report(*machine.speeds)[2:5]))
    texts = machine.programs(plan)
    texts[f"{next(iter(texts))}.svg"] = plan.svg()
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]
