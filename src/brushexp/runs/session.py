"""One painting from its config to its end, in memory or with a run's folder: what the command line and Python share."""

import logging
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import lightning as L
from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.features.distance import open_distance
from brushexp.painting.finished import Finished, finish
from brushexp.painting.goals import goals_of
from brushexp.painting.outputs import summary_line
from brushexp.painting.preparation import prepared
from brushexp.painting.timelapse import Timelapse
from brushexp.runs.fitting import conclude, fit, trainer_of
from brushexp.runs.tracking import Trackers, trackers_of
from brushexp.system.device import device_of
from brushexp.system.files import write_picture

log = logging.getLogger(__name__)
ON_THE_WAY = 8  # frames of the timelapse that trackers get


class Session:
    """A painter made from a checked config of ``task=paint``, its fit, and what it leaves; nothing is on disk yet.

    Callbacks come after those of the timelapse and the goals. A fit without a ``folder`` has no checkpoints.
    """

    def __init__(self, cfg: DictConfig, folder: Path | None = None, callbacks: Sequence[L.Callback] = ()) -> None:
        self.cfg, self.folder = cfg, folder
        self.device = device_of(cfg.device)
        weights = cfg.lpips_weights
        self.lpips = None if weights is None else open_distance(cfg.lpips_backbone, weights, "lpips_weights")
        L.seed_everything(cfg.seed, verbose=False)
        start = prepared(cfg)
        self.pictures, self.painter = start.pictures, start.painter.to(self.device)
        self.timelapse = Timelapse(cfg.frames, cfg.frame_side, seconds=cfg.timelapse_seconds, kind=cfg.timelapse)
        by_steps = self.painter.resumable
        goals = goals_of(early_stop=cfg.early_stop, psnr=cfg.psnr, seconds=cfg.seconds, has_plan=by_steps)
        self.callbacks = [self.timelapse, *goals, *callbacks]
        self.failure: BaseException | None = None  # that has ended the fit

    def fit(self, trackers: Trackers | None = None, checkpoint: Path | None = None) -> None:
        """Take the steps, from a checkpoint if there is one."""
        if self.painter.schedule.steps or self.cfg.seconds:
            loggers = [trackers] if trackers else []
            around = (loggers, self.callbacks)
            trainer = trainer_of(self.cfg, self.device, self.folder, *around, checkpoints=self.painter.resumable)
            self.failure = fit(trainer, self.painter, checkpoint=checkpoint)

    def finish(self) -> Finished:
        """What the painter has come to."""
        return finish(self.painter, self.cfg, self.timelapse, self.lpips)

    def conclude(self) -> None:
        """Raise what has kept the fit from its end, if anything has; else its checkpoint is removed."""
        conclude(self.painter, self.folder, self.cfg, self.failure, self.painter.schedule.step)


def painted(cfg: DictConfig, callbacks: Sequence[L.Callback] = ()) -> Finished:
    """Paint in memory; nothing is written."""
    session = Session(cfg, None, callbacks)
    session.fit()
    session.conclude()
    return session.finish()


def painted_into(
    folder: Path, cfg: DictConfig, start: float | None,
    checkpoint: Path | None = None, callbacks: Sequence[L.Callback] = (),
) -> Finished:  # fmt: skip
    """Paint, and write everything into the run's folder, also of a fit that has not come to its end.

    ``start`` is `time.monotonic` when the program began; None for a run that goes on from its ``checkpoint``.
    """
    trackers = trackers_of(cfg, folder)  # says now what they lack
    session = Session(cfg, folder, callbacks)
    for name, picture in session.pictures.items():
        write_picture(folder / f"{name}.png", picture)
    with trackers:
        session.fit(trackers, checkpoint)
        finished = session.finish()
        finished.write(folder, start)
        trackers.report(
            finished.metrics,
            pictures={name: folder / f"{name}.png" for name in ("target", "painting")},
            frames=some_of(finished.timelapse.frames),
            files={"catalogue": folder / "catalogue.h5"},
        )
    with ThreadPoolExecutor(1) as beside:  # to encode a film leaves Python to others
        film = beside.submit(finished.timelapse.write, folder)
        if cfg.report:
            report(folder, film)
    film.result()
    finished.conclude(folder)
    log.info(summary_line(folder, finished.metrics))
    session.conclude()
    return finished


def some_of(frames: dict[int, bytes]) -> dict[int, bytes]:
    """A few frames, step -> JPEG, without the last, which is the painting."""
    steps = sorted(frames)[:-1]
    return {step: frames[step] for step in steps[:: max(1, -(-len(steps) // ON_THE_WAY))]}


def report(folder: Path, film: Future[Any] | None = None) -> None:
    """Write the page of the run, with its ``film``; whatever goes wrong with it, the run is not lost."""
    from brushexp.pages.run_page import write_run_page  # noqa: PLC0415  (runs without a page start sooner)

    try:
        write_run_page(folder, film)
    except Exception as error:
        log.error("no report.html of this run: %s", error, exc_info=not isinstance(error, UserError))
