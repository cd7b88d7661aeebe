"""The loggers of a run: opened when it begins, told of its end, and dropped when they fail."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from textwrap import shorten
from typing import Any, Self

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from lightning.pytorch.loggers import Logger as LightningLogger
from omegaconf import DictConfig, OmegaConf

from brushexp.plugins.logger.base import Logger, Run
from brushexp.registry import build

log = logging.getLogger(__name__)
NO_SETTINGS = ("output", "logger")  # keys that do not tell how a run was made


class FailSafeLogger(LightningLogger):
    """A logger as Lightning takes it: its first exception is logged, it then gets no more curves, and the run goes on.

    Args:
        choice: its name on the command line.
        tracker: the plugin.
    """

    name = version = ""

    def __init__(self, choice: str, tracker: Logger) -> None:
        super().__init__()
        self.choice, self.tracker = choice, tracker
        self.curves: LightningLogger | None = None
        self.stopped = False

    def open(self, run: Run) -> None:
        """Begin."""
        self.curves = self._safely(self.tracker.open, run)

    def log_metrics(self, metrics: dict[str, float], step: int | None = None) -> None:
        if self.curves is not None and not self.stopped:
            self._safely(self.curves.log_metrics, metrics, step)

    def log_hyperparams(self, *_: Any, **__: Any) -> None:
        pass  # trackers get the settings when they open

    def save(self) -> None:
        if self.curves is not None and not self.stopped:
            self._safely(self.curves.save)

    def finish(self, run: Run) -> None:
        """End."""
        self._safely(self.tracker.finish, run)
        if self.curves is not None:
            self._safely(self.curves.finalize, "success" if run.status == "completed" else run.status)

    def _safely(self, call: Callable[..., Any], *arguments: Any) -> Any:
        """What the call returns, or None if it fails."""
        try:
            return call(*arguments)
        except Exception as error:
            reason = shorten(f"{type(error).__name__}: {error}", 200)
            if not self.stopped:
                log.warning("logger=%s stopped: %s; the run goes on without it", self.choice, reason)
            log.debug("logger=%s", self.choice, exc_info=True)
            self.stopped = True
            return None


class Trackers:
    """All trackers of a run, open inside ``with``.

    Args:
        chosen: name -> tracker.
        run: what is known of it.
    """

    def __init__(self, chosen: Mapping[str, Logger], run: Run) -> None:
        self.run = run
        self.loggers = [FailSafeLogger(name, tracker) for name, tracker in chosen.items()]

    def __enter__(self) -> Self:
        for logger in self.loggers:
            logger.open(self.run)
        return self

    def report(self, metrics: Mapping[str, Any], **results: Any) -> None:
        """Note what the trackers are told when the run ends: its numbers and its pictures, frames, files; see `Run`."""
        self.run = replace(self.run, metrics=metrics, **results)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        status = "interrupted" if self.run.metrics.get("status") == "interrupted" else "completed"
        if kind is not None:  # Lightning makes a second Ctrl-C a SystemExit
            status = "interrupted" if issubclass(kind, KeyboardInterrupt | SystemExit) else "failed"
        for logger in self.loggers:
            logger.finish(replace(self.run, status=status))


def trackers_of(cfg: DictConfig, folder: Path) -> Trackers:
    """Those that a config chooses, not yet opened, for a run in ``folder`` or a part of it that has its own curves.

    Raises:
        UserError: if one of them cannot work here: its package is not installed, for instance.
    """
    settings: Any = OmegaConf.to_container(cfg, resolve=True, enum_to_str=True)
    run = Run(folder, name=folder.name, settings=settings)
    if HydraConfig.initialized():
        hydra = HydraConfig.get()
        whole = Path(hydra.runtime.output_dir)
        words = (word.lstrip("+~").partition("=") for word in hydra.overrides.task)
        run = replace(
            run,
            name=folder.name if folder == whole else f"{whole.name}/{folder.name}",
            group=whole.parent.name if hydra.mode is RunMode.MULTIRUN else "",
            chosen={key: value for key, _, value in words if key.partition(".")[0] not in NO_SETTINGS},
        )
    return Trackers({choice: build(node) for choice, node in cfg.logger.items()}, run)
