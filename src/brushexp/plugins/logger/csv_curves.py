"""Curves as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from brushexp.plugins.logger.base import Logger, Run
from brushexp.registry import register

if TYPE_CHECKING:
    from lightning.pytorch.loggers import Logger as LightningLogger


@register("logger", "csv")
class CsvCurves(Logger):
    """``curves/metrics.csv`` in the run's folder: losses and PSNR by step."""

    def open(self, run: Run) -> LightningLogger:
        from lightning.pytorch.loggers import CSVLogger  # noqa: PLC0415

        return CSVLogger(run.folder, name="", version="curves")
