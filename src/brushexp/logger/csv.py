"""Curves as a table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from brushexp.logger.base import Logger
from brushexp.registry import register

if TYPE_CHECKING:
    from lightning.pytorch.loggers import Logger as LightningLogger


@register("logger", "csv")
class Csv(Logger):
    """``curves/metrics.csv`` in the run's folder: losses and PSNR by step."""

    def __init__(self) -> None: ...

    def open(self, folder: Path) -> LightningLogger:
        from lightning.pytorch.loggers import CSVLogger  # noqa: PLC0415

        return CSVLogger(folder, name="", version="curves")
