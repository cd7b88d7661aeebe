"""The strokes as a table."""

from pathlib import Path

import torch
from torch import Tensor

from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp.strokes.bezier import curve_of, length_of
from brushexp.system.files import replacing

POINTS = tuple(f"{point}_{axis}_px" for point in ("start", "control", "end") for axis in "xy")
COLUMNS = (*POINTS, "width_px", "red", "green", "blue", "opacity", "length_px", "direction_deg")


@register("to", "csv")
class Csv(Exporter):
    """``strokes.csv``: one stroke a line, the bottom one first, for spreadsheets, pandas and R.

    Columns: ``stroke``, its number in the catalogue; ``start``, ``control``, ``end`` of its quadratic Bezier curve in
    pixels of the canvas, x to the right and y down from the upper left corner; ``width_px``, its full thickness;
    ``red``, ``green``, ``blue`` (sRGB) and ``opacity`` from 0 to 1; ``length_px`` along the curve; ``direction_deg``
    from start to end, counterclockwise as one sees it: 0 is to the right, 90 up, -90 down; empty where both are one
    point. Numbers have seven digits, which is what float32 holds.
    """

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        from pandas import DataFrame, Index  # noqa: PLC0415  (slow to import)

        path, order = folder / "strokes.csv", job.bottom_up.cpu()
        strokes = job.strokes.map(lambda value: value.detach().cpu().double()[order])
        curve, width = curve_of(strokes), strokes.width * strokes.scale
        columns = (curve.flatten(1), width, strokes.color, strokes.opacity, length_of(curve), heading_degrees(curve))
        table = DataFrame(torch.column_stack(columns).numpy(), Index(order.numpy(), name="stroke"), COLUMNS)
        with replacing(path) as temporary:
            table.to_csv(temporary, float_format="%.7g", lineterminator="\n")
        return [path]


def heading_degrees(curve: Tensor) -> Tensor:
    """Angle (N,) in degrees, in (-180, 180], from start to end of curves (N, 3, 2), y down; NaN for a point."""
    x, y = (curve[:, 2] - curve[:, 0]).unbind(1)
    angle = torch.atan2(-y, x).rad2deg()
    return torch.where((x == 0) & (y == 0), torch.nan, torch.where(angle == -180, 180.0, angle)) + 0.0  # -0 is 0
