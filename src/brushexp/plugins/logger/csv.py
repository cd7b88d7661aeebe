"""Write curves as a table."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brushexp.plugins.logger.base import Logger, Run
from brushexp.registry import register
from brushexp.system.reading import read_table

if TYPE_CHECKING:
    from lightning.pytorch.loggers import Logger as LightningLogger


@register("logger", "csv")
class CsvCurves(Logger):
    """Writes losses and PSNR by step to ``curves/metrics.csv`` in the run's folder; a resumed run appends to it."""

    def open(self, run: Run) -> LightningLogger:
        from lightning.pytorch.loggers import CSVLogger  # noqa: PLC0415

        resumed, table = run.settings.get("resume"), Path(run.folder, "curves", "metrics.csv")
        before = rows_of(Path(resumed, "curves", "metrics.csv")) if resumed else []

        class Continued(CSVLogger):
            """Keeps the interrupted run's rows up to the step at which it was resumed."""

            def begin(self, rows: list[Any]) -> None:
                table.unlink(missing_ok=True)  # Lightning would delete it, with a warning
                self.experiment.metrics = rows
                self.save()

            def log_metrics(self, metrics: dict[str, Any], step: int | None = None) -> None:
                if before:
                    self.begin([row for row in before if int(row["step"]) < (step or 0)])
                    before.clear()
                super().log_metrics(metrics, step)

        curves = Continued(run.folder, name="", version="curves")
        curves.begin(list(before))
        return curves


def rows_of(path: Path) -> list[dict[str, str]]:
    """Read the rows of a table, if it exists, without an incomplete last row that a killed process may have left."""
    return [row for row in read_table(path) if None not in row.values() and re.fullmatch(r"\d{1,15}", row["step"])]
