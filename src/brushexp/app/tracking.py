"""The loggers of a run: opened when it begins, told of its end, and dropped when they fail."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from lightning.pytorch.loggers import Logger as LightningLogger
from omegaconf import DictConfig, OmegaConf

from brushexp.plugins.logger.base import Logger, Run
from brushexp.registry import build, plugins

log = logging.getLogger(__name__)
MESSAGE_LETTERS = 200  # of an error at most
NO_SETTINGS = ("output", "logger")  # keys that do not tell how a run was made


class FailSafeLogger(LightningLogger):
    """A logger as Lightning takes it: its first exception is logged, it then gets no more curves, and the run goes on.

    Args:
        choice: its name on the command line.
        tracker: the plugin.
    """

    def __init__(self, choice: str, tracker: Logger) -> None:
        super().__init__()
        self.choice, self.tracker = choice, tracker
        self.curves: LightningLogger | None = None
        self.stopped = False

    @property
    def name(self) -> str:
        return self.choice

    @property
    def version(self) -> str:
        return ""

    def open(self, run: Run) -> None:
        """Begin."""
        with self._caught():
            self.curves = self.tracker.open(run)

    def log_metrics(self, metrics: dict[str, float], step: int | None = None) -> None:
        if self.curves is not None and not self.stopped:
            with self._caught():
                self.curves.log_metrics(metrics, step)

    def log_hyperparams(self, *_: Any, **__: Any) -> None:
        pass  # trackers get the settings when they open

    def save(self) -> None:
        if self.curves is not None and not self.stopped:
            with self._caught():
                self.curves.save()

    def finish(self, run: Run) -> None:
        """End."""
        with self._caught():
            self.tracker.finish(run)
        if self.curves is not None:
            with self._caught():
                self.curves.finalize("success" if run.status == "completed" else run.status)

    @contextmanager
    def _caught(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            reason = f"{type(error).__name__}: {' '.join(str(error).split())[:MESSAGE_LETTERS]}"
            if not self.stopped:
                log.warning("logger=%s stopped: %s; the run goes on without it", self.choice, reason)
            log.debug("logger=%s", self.choice, exc_info=True)
            self.stopped = True


class Trackers:
    """All trackers of a run, open inside ``with``.

    Args:
        chosen: name -> tracker.
        run: what is known of it.
    """

    def __init__(self, chosen: Mapping[str, Logger], run: Run) -> None:
        self.run = run
        self.loggers = [FailSafeLogger(name, tracker) for name, tracker in chosen.items()]

    def __enter__(self) -> Trackers:
        for logger in self.loggers:
            logger.open(self.run)
        return self

    def report(
        self,
        metrics: Mapping[str, Any],
        *,
        pictures: Mapping[str, Path] = {},
        frames: Mapping[int, bytes] = {},
        files: Mapping[str, Path] = {},
    ) -> None:
        """Note what the trackers are to be told when the run ends; see `Run`. Infinite numbers become None."""
        known = {name: value if _is_json(value) else None for name, value in metrics.items()}
        self.run = replace(self.run, metrics=known, pictures=pictures, frames=frames, files=files)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        status = "completed" if self.run.metrics.get("status") != "interrupted" else "interrupted"
        if kind is not None:  # Lightning makes a second Ctrl-C a SystemExit
            status = "interrupted" if issubclass(kind, KeyboardInterrupt | SystemExit) else "failed"
        for logger in self.loggers:
            logger.finish(replace(self.run, status=status))


def _is_json(value: Any) -> bool:
    """Whether the value is no infinite number, and no NaN."""
    return not isinstance(value, float) or math.isfinite(value)


def trackers_of(cfg: DictConfig, folder: Path) -> Trackers:
    """Those that a config chooses, not yet opened.

    Args:
        cfg: of the whole run.
        folder: of the run, or of a part of it that has curves of its own.

    Raises:
        UserError: if one of them cannot work here: its package is not installed, for instance.
    """
    return Trackers({choice: build(node) for choice, node in cfg.logger.items()}, run_of(cfg, folder))


def run_of(cfg: DictConfig, folder: Path) -> Run:
    """What is known of a run when it begins; see `trackers_of`."""
    settings = settings_of(cfg)
    if not HydraConfig.initialized():
        return Run(folder, name=folder.name, settings=settings)
    hydra = HydraConfig.get()
    whole = Path(hydra.runtime.output_dir)
    words = (word.lstrip("+~").partition("=") for word in hydra.overrides.task)
    return Run(
        folder,
        name=folder.name if folder == whole else f"{whole.name}/{folder.name}",
        group=whole.parent.name if hydra.mode is RunMode.MULTIRUN else "",
        chosen={key: value for key, _, value in words if key.partition(".")[0] not in NO_SETTINGS},
        settings=settings,
    )


def settings_of(cfg: DictConfig) -> dict[str, Any]:
    """The resolved config as plain data; a plugin by its name, where Hydra has the path of a class."""
    names = {plugin.target: plugin.name for plugin in plugins()}

    def readable(value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        found = {str(key): readable(inner) for key, inner in value.items() if key != "_target_"}
        return {"plugin": names.get(value["_target_"], value["_target_"]), **found} if "_target_" in value else found

    settings: dict[str, Any] = readable(OmegaConf.to_container(cfg, resolve=True, enum_to_str=True))
    return settings
