"""Base class for loggers, which record runs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brushexp.system.status import Status

if TYPE_CHECKING:  # Lightning takes seconds to import; --help should not
    from lightning.pytorch.loggers import Logger as LightningLogger


@dataclass(frozen=True)
class Run:
    """The description of a run: its folder and settings and, once it has ended, its results."""

    folder: Path  # folder in which a logger writes
    name: str = ""  # number of the job in a sweep
    group: str = ""  # name of the sweep, empty for a single run
    chosen: Mapping[str, str] = field(default_factory=dict)  # key -> value of the command line
    settings: Mapping[str, Any] = field(default_factory=dict)  # the config of the whole run, resolved
    status: Status = Status.AT_WORK  # or completed, interrupted, failed
    metrics: Mapping[str, Any] = field(default_factory=dict)  # contents of metrics.json; empty if the run failed
    pictures: Mapping[str, Path] = field(default_factory=dict)  # name -> PNG, in display order
    frames: Mapping[int, bytes] = field(default_factory=dict)  # step -> JPEG of the picture after some steps
    files: Mapping[str, Path] = field(default_factory=dict)  # name -> result of the run, such as the catalogue

    @property
    def step(self) -> int:
        """Number of the last step; 0 if no step has been taken."""
        return int(self.metrics.get("steps") or 0)

    @property
    def numbers(self) -> dict[str, float]:
        """Metrics that are finite numbers, by name."""
        return {name: value for name, value in self.metrics.items() if type(value) in (int, float) and isfinite(value)}

    @property
    def row(self) -> dict[str, Any]:
        """Metrics that fit in a table row: all except lists and mappings."""
        return {name: value for name, value in self.metrics.items() if not isinstance(value, list | dict)}


class Logger(ABC):
    """Records the curves of a run and, at its end, its pictures, metrics and files.

    An error stops the logger but never the run: the first error is logged, and the logger receives no more curves.

    >>> class Last(Logger):
    ...     def open(self, run: Run) -> LightningLogger:
    ...         from lightning.pytorch.loggers import CSVLogger
    ...         return CSVLogger(run.folder)
    ...     def finish(self, run: Run) -> None:
    ...         print(run.status, run.numbers)
    >>> Last().finish(Run(Path("."), status=Status.COMPLETED, metrics={"psnr": 30.5, "status": Status.COMPLETED}))
    completed {'psnr': 30.5}
    """

    @abstractmethod
    def open(self, run: Run) -> LightningLogger:
        """Return a Lightning logger for the curves, which is finalised after `finish`."""

    def finish(self, run: Run) -> None:  # noqa: B027
        """Record the run's results; called exactly once, even if the run, `open` or the logging of a curve failed."""
