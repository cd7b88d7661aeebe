"""Write strokes as a table."""

from collections.abc import Iterator
from pathlib import Path

import torch
from torch import Tensor

from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp.strokes.bezier import curve_of, drift_of, length_of, softness_of
from brushexp.strokes.saved import AT_ONCE
from brushexp.system.files import write_text

POINTS = tuple(f"{point}_{axis}_px" for point in ("start", "control", "end") for axis in "xy")
PAINT = ("red", "green", "blue", "opacity", "softness_px", "widening", "red_drift", "green_drift", "blue_drift")
COLUMNS = (*POINTS, "width_px", *PAINT, "length_px", "direction_deg")


@register("to", "csv")
class Csv(Exporter):
    """Writes ``strokes.csv``: one stroke per line, bottom first, for spreadsheets, pandas and R.

    The columns are: ``stroke``, the index in the catalogue; ``start``, ``control`` and ``end`` of the quadratic Bezier
    curve in pixels of the canvas, x to the right and y down from the upper left corner; ``width_px``, the full
    thickness; ``red``, ``green``, ``blue`` (sRGB) and ``opacity`` from 0 to 1; ``softness_px``, the width of the soft
    edge beyond the renderer's own edge; ``widening``, the fraction by which the stroke is thicker at its end and
    thinner at its start; ``red_drift``, ``green_drift`` and ``blue_drift``, which are added to the colour at the end
    and subtracted at the start; ``length_px``, the length along the curve; and ``direction_deg``, the clockwise angle
    from start to end, where 0 points right, 90 down and -90 up (empty if start and end coincide). Numbers have seven
    digits, the precision of float32. Gradient descent hardly changes the lengths and widths that ``init`` chooses.
    """

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        write_text(folder / "strokes.csv", _lines(job))
        return [folder / "strokes.csv"]


def _lines(job: ExportJob) -> Iterator[str]:
    yield ",".join(("stroke", *COLUMNS)) + "\n"
    line = "%d" + ",%.7g" * len(COLUMNS) + "\n"
    for number in job.bottom_up.cpu().split(AT_ONCE):
        strokes = job.strokes[number.to(job.strokes.position.device)].map(lambda value: value.detach().cpu().double())
        curve, width = curve_of(strokes), strokes.width * strokes.scale
        paint = strokes.color, strokes.opacity, softness_of(strokes), strokes.widening, drift_of(strokes)
        shape = length_of(curve), heading_degrees(curve)
        rows = torch.column_stack((number, curve.flatten(1), width, *paint, *shape)).tolist()
        yield "".join([line % tuple(row) for row in rows]).replace("nan\n", "\n")


def heading_degrees(curve: Tensor) -> Tensor:
    """Compute the direction from the start to the end of each curve (N, 3, 2); NaN if the two coincide.

    Directions (N,) are clockwise angles from the x axis in degrees, in (-180, 180].
    """
    x, y = (curve[:, 2] - curve[:, 0]).unbind(1)
    angle = torch.atan2(y, x).rad2deg()
    return torch.where((x == 0) & (y == 0), torch.nan, torch.where(angle == -180, 180.0, angle)) + 0.0  # no -0
