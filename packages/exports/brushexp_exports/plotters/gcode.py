"""Export stroke plans as G-code, the language of most self-built machines."""

import io
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from brushexp.contracts import UserError, between, register
from brushexp.contracts.families import ExportJob
from brushexp_exports.plotters.pens import PenExporter, PenPlan, load_vpype, quiet_vpype

Speed = Annotated[float, between(1, 1_000_000)]


@register("to", "gcode")
@dataclass(kw_only=True)
class Gcode(PenExporter):
    """Writes ``painting.gcode``, a stroke plan for plotters and painting robots, with a picture of the plan.

    Coordinates are in millimetres from the lower left corner of the paper, with y upwards. The file is written by the
    vpype-gcode plugin. Many plotters lift the pen with a servo: ``'to.gcode.up=M5' 'to.gcode.down=M3 S90'``.

    Args:
        feed: speed while drawing, in mm per minute.
        travel: speed between strokes, in mm per minute, for the time estimate; the machine sets the speed of G0.
        up: command that lifts the pen.
        down: command that lowers the pen.
        change: command that waits for another tool; {tool} is its number and {color} its colour. A plan for one pen
            contains no tool change, because the pen is already in the holder. Machines with an automatic tool changer
            accept 'M6 T{tool}'; GRBL does not.
    """

    feed: Speed = 1500.0
    travel: Speed = 5000.0
    up: str = "G0 Z5"
    down: str = "G1 Z0 F600"
    change: str = "M0 ; tool {tool}, {color}"

    def __post_init__(self) -> None:
        super().__post_init__()
        for key, text in (("up", self.up), ("down", self.down), ("change", self.change)):
            if not text.isascii() or not text.isprintable():
                raise UserError(f"to.gcode.{key}={text!r} is not one line of ASCII; write 'to.gcode.{key}=M3 S90'")
        try:
            self.change.format(tool=1, color="#000000")
        except (LookupError, ValueError, AttributeError, TypeError) as error:
            wrong = f"to.gcode.change={self.change!r} has fields other than {{tool}} and {{color}}"
            raise UserError(f"{wrong}; write 'to.gcode.change=M6 T{{tool}}'") from error

    @property
    def speeds(self) -> tuple[float, float]:
        return self.feed, self.travel

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        from brushexp_exports.plotters.program import write_plan  # noqa: PLC0415  (needs the extra plot)

        return write_plan(job, self, folder)

    def programs(self, plan: PenPlan) -> dict[str, str]:
        vpype = load_vpype()
        from vpype_cli.state import State  # noqa: PLC0415  (slow to import)
        from vpype_gcode.gwrite import gwrite  # noqa: PLC0415

        head = [*plan.report(*self.speeds), "millimetres from the lower left corner of the paper, y up"]
        document = self._with_changes(plan)
        up, down = (text.replace("{", "{{").replace("}", "}}") for text in (self.up, self.down))
        vpype.config_manager.config.setdefault("gwrite", {})["brushexp"] = {
            "unit": "mm",
            "vertical_flip": True,
            "document_start": "".join(f"; {row}\n" for row in head) + f"G21\nG90\n{up}\n",
            "layer_start": f"; {{vp_name}}\n{{change}}{up}\n",
            "segment_first": f"G0 X{{x:.3f}} Y{{y:.3f}}\n{down}\nG1 F{self.feed:.10g}\n",
            "segment": "G1 X{x:.3f} Y{y:.3f}\n",
            "line_end": f"{up}\n",
            "document_end": "G0 X0 Y0\nM2\n",
        }
        text = io.StringIO()
        text.name = "painting.gcode"
        with quiet_vpype():
            gwrite.callback(output=text, profile="brushexp", default=())(State(document))
        return {"painting.gcode": text.getvalue()}

    def _with_changes(self, plan: PenPlan) -> Any:
        """Copy a plan's document, and add tool changes to layers whose tool is not already in the holder."""
        document = deepcopy(plan.document)
        held = 1 if len(plan.tools) == 1 else None
        for (_, tool, _), number in zip(plan.runs(), sorted(document.ids()), strict=True):
            change = self.change.format(tool=tool, color=plan.tools[tool - 1]) + "\n"
            document.layers[number].set_property("change", "" if tool == held else change)
            held = tool
        return document
