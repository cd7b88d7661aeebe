"""Open the loggers of a run, forward its curves and results to them, and drop loggers that fail."""

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from textwrap import shorten
from typing import Any, Self

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from lightning.pytorch.loggers import Logger as LightningLogger
from omegaconf import DictConfig, OmegaConf

from brushexp.plugins.logger.base import Logger, Run
from brushexp.registry import take_built
from brushexp.system.status import UNFINISHED, Status

log = logging.getLogger(__name__)


class Trackers(LightningLogger):
    """A Lightning logger that forwards everything to all trackers of a run and drops those that fail."""

    name = version = ""

    def __init__(self, chosen: Mapping[str, Logger], run: Run) -> None:
        super().__init__()
        self.chosen, self.run = chosen, run
        self.curves: dict[str, LightningLogger] = {}
        self.stopped: set[str] = set()
        self.row: dict[str, float] = {}  # values of the current step
        self.step: int | None = None

    def __enter__(self) -> Self:
        for name, tracker in self.chosen.items():
            with self._catch_failure(name):
                self.curves[name] = tracker.open(self.run)
        return self

    def log_metrics(self, metrics: dict[str, float], step: int | None = None) -> None:
        """Collect the values that the module and the callbacks log in a step into one row."""
        if step != self.step:
            self._pass_on()
        self.row, self.step = self.row | metrics, step

    def _pass_on(self) -> None:
        row, self.row = self.row, {}
        if row:
            self._each(lambda curves: curves.log_metrics(row, self.step))

    def log_hyperparams(self, *_: Any, **__: Any) -> None:
        pass  # trackers get the settings when they open

    def save(self) -> None:
        self._pass_on()
        self._each(lambda curves: curves.save())

    def _each(self, act: Callable[[LightningLogger], object]) -> None:
        for name in self.curves.keys() - self.stopped:
            with self._catch_failure(name):
                act(self.curves[name])

    def report(self, metrics: Mapping[str, Any], **results: Any) -> None:
        """Store the metrics, pictures, frames and files that the trackers receive at the end of the run; see `Run`."""
        self.run = replace(self.run, metrics=metrics, **results)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._pass_on()
        told = self.run.metrics.get("status")
        status = Status(told) if told in UNFINISHED else Status.COMPLETED
        if status == Status.DIVERGED:
            status = Status.FAILED
        if kind is not None:  # Lightning turns a second Ctrl-C into SystemExit
            status = Status.INTERRUPTED if issubclass(kind, KeyboardInterrupt | SystemExit) else Status.FAILED
        for name, tracker in self.chosen.items():
            with self._catch_failure(name):
                tracker.finish(replace(self.run, status=status))
            with self._catch_failure(name):
                if name in self.curves:
                    self.curves[name].finalize("success" if status == Status.COMPLETED else str(status))

    @contextmanager
    def _catch_failure(self, name: str) -> Iterator[None]:
        try:
            yield
        except (Exception, SystemExit) as error:
            if name not in self.stopped:
                reason = shorten(f"{type(error).__name__}: {error}", 200)
                log.warning("logger=%s failed: %s; the run continues without it", name, reason)
            log.debug("logger=%s", name, exc_info=True)
            self.stopped.add(name)


def make_trackers(cfg: DictConfig, folder: Path | None) -> Trackers:
    """Make the config's trackers for a run, or for part of one, in ``folder``; without a folder, make none."""
    if folder is None:
        return Trackers({}, Run(Path()))
    settings: Any = OmegaConf.to_container(cfg, resolve=True, enum_to_str=True)
    folder = folder.resolve()
    run = Run(folder, name=folder.name, settings=settings)
    hydra = HydraConfig.get() if HydraConfig.initialized() else None
    if hydra is not None and folder.is_relative_to(whole := Path(hydra.runtime.output_dir).resolve()):  # of this run
        words = (word.lstrip("+~").partition("=") for word in hydra.overrides.task)
        run = replace(
            run,
            name=folder.name if folder == whole else f"{whole.name}/{folder.name}",
            group=whole.parent.name if hydra.mode is RunMode.MULTIRUN else "",
            chosen={key: value for key, _, value in words if key.partition(".")[0] not in ("output", "logger")},
        )
    return Trackers({choice: take_built(node) for choice, node in cfg.logger.items()}, run)
