"""What every logger receives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # Lightning takes seconds to import; --help should not
    from lightning.pytorch.loggers import Logger as LightningLogger


class Logger(ABC):
    """Names a place for the curves of a run."""

    @abstractmethod
    def open(self, folder: Path) -> LightningLogger:
        """The Lightning logger that writes there; ``folder`` is the run's own."""
