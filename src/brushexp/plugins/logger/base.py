"""What every logger receives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # Lightning takes seconds to import; --help should not
    from lightning.pytorch.loggers import Logger as LightningLogger


@dataclass(frozen=True)
class Run:
    """What is known of a run: at its beginning its place and its settings, at its end everything."""

    folder: Path  # its own; what a logger writes belongs below it
    name: str = ""  # of a job of a sweep: its number
    group: str = ""  # name of the sweep that it belongs to; empty for a single run
    chosen: Mapping[str, str] = field(default_factory=dict)  # key -> value of the command line, which tells runs apart
    settings: Mapping[str, Any] = field(default_factory=dict)  # the config of the whole run, resolved
    status: str = "running"  # or completed, interrupted, failed
    metrics: Mapping[str, Any] = field(default_factory=dict)  # what metrics.json holds; empty if the run failed
    pictures: Mapping[str, Path] = field(default_factory=dict)  # name -> PNG, in the order in which they are shown
    frames: Mapping[int, bytes] = field(default_factory=dict)  # step -> JPEG of the picture on the way, a few of them
    files: Mapping[str, Path] = field(default_factory=dict)  # name -> what the run was made for, the catalogue say

    @property
    def step(self) -> int:
        """The last one; 0 if it is not known."""
        return int(self.metrics.get("steps") or 0)

    @property
    def numbers(self) -> dict[str, float]:
        """The metrics that are one finite number each."""
        return {name: value for name, value in self.metrics.items() if type(value) in (int, float) and isfinite(value)}

    @property
    def row(self) -> dict[str, Any]:
        """The metrics that fit into a table: all but lists."""
        return {name: value for name, value in self.metrics.items() if not isinstance(value, list | dict)}


class Logger(ABC):
    """Takes the curves of a run, and at its end its pictures, numbers and files.

    Whatever it raises stops the logger and never the run: the first error is logged, and no more curves come.

    >>> class Last(Logger):
    ...     def open(self, run: Run) -> LightningLogger:
    ...         from lightning.pytorch.loggers import CSVLogger
    ...         return CSVLogger(run.folder)
    ...     def finish(self, run: Run) -> None:
    ...         print(run.status, run.numbers)
    >>> Last().finish(Run(Path("."), status="completed", metrics={"psnr": 30.5, "status": "completed"}))
    completed {'psnr': 30.5}
    """

    @abstractmethod
    def open(self, run: Run) -> LightningLogger:
        """Begin, and return the Lightning logger that takes the curves; it is finalised after `finish`."""

    def finish(self, run: Run) -> None:  # noqa: B027
        """Take what else there is of the run. Called once, however it ended, also when `open` or a curve failed."""
