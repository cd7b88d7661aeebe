"""``task=paint``: optimise strokes until they look like the picture."""

import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import lightning as L
from lightning.pytorch.loggers import Logger
from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.painting.build import build_painter
from brushexp.painting.changes import changed_settings
from brushexp.painting.components import warn_of_slow_steps
from brushexp.painting.finished import Finished, finish, summary_line
from brushexp.painting.goals import goals_of
from brushexp.painting.idle_parts import log_idle_parts
from brushexp.painting.metrics import metrics_of
from brushexp.painting.painting_module import PaintingModule
from brushexp.painting.timelapse import Timelapse
from brushexp.painting.working_size import log_sizes
from brushexp.plugins.metric.base import Metric
from brushexp.runs.closing import is_job, log_result
from brushexp.runs.provenance import Provenance, provenance_of
from brushexp.runs.resume import restore_run
from brushexp.runs.tracking import Trackers, make_trackers
from brushexp.runs.trainer import conclude, fit, make_trainer
from brushexp.system.device import device_of
from brushexp.system.files import write_picture
from brushexp.system.heartbeat import heartbeat
from brushexp.system.runtime import delayed_interrupt
from brushexp.system.terminal import IN_LOG

log = logging.getLogger(__name__)
TRACKED_FRAMES = 8  # number of timelapse frames for loggers


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Paint a picture, write all results into the run's folder, and return the metrics."""
    cfg, checkpoint = restore_run(cfg)
    return paint_into(folder, cfg, None if checkpoint else start, checkpoint).metrics


def paint_picture(cfg: DictConfig, callbacks: Sequence[L.Callback] = ()) -> Finished:
    """Paint from a checked config without writing any files."""
    cfg = changed_settings(cfg)
    metrics, provenance = metrics_of(cfg), provenance_of(cfg)
    fitted = optimise(cfg, callbacks=callbacks)
    conclude(fitted.painter, None, cfg, fitted.failure, fitted.painter.schedule.step)
    return finish(fitted.painter, cfg, fitted.timelapse, metrics, provenance=provenance)


def paint_into(
    folder: Path,
    cfg: DictConfig,
    start: float | None,
    checkpoint: Path | None = None,
    callbacks: Sequence[L.Callback] = (),
) -> Finished:
    """Paint from a checked config into a run's folder, and write the results even if the fit fails.

    ``start`` is the value of `time.monotonic` when the program started, or None for a run resumed from its
    ``checkpoint``.
    """
    cfg = changed_settings(cfg)
    if not is_job():
        log_sizes(cfg)
    trackers = make_trackers(cfg, folder)
    metrics, provenance = metrics_of(cfg), provenance_of(cfg)
    opening = Opening(cfg, folder)
    with trackers:
        fitted = optimise(cfg, folder, [trackers], [opening, *callbacks], checkpoint)
        opening.write(fitted.painter)  # in case no step was taken
        finished = write(fitted, cfg, folder, metrics, provenance, start)
        report_painting(trackers, folder, finished)
    write_page_and_film(folder, finished, page=cfg.report)
    finished.conclude(folder)  # until now, the run counts as running
    log.info(summary_line(folder, finished.metrics), extra=IN_LOG)
    if verdict := finished.metrics.get("verdict"):
        log.info("%s", verdict)
    conclude(fitted.painter, folder, cfg, fitted.failure, fitted.painter.schedule.step)
    log_result(folder, len(finished.job.strokes), start)
    return finished


@dataclass(frozen=True)
class Fitted:
    """The result of a fit: the painter, its timelapse, and the error that ended the fit, if any."""

    painter: PaintingModule
    timelapse: Timelapse
    failure: BaseException | None


def optimise(
    cfg: DictConfig,
    folder: Path | None = None,
    loggers: Sequence[Logger] = (),
    callbacks: Sequence[L.Callback] = (),
    checkpoint: Path | None = None,
) -> Fitted:
    """Build the painter, callbacks and Trainer of a painting, and run the fit.

    Checkpoints go to ``folder`` if it is given. The fit resumes from ``checkpoint`` if that is given.
    """
    heartbeat.say("looking at the picture")
    device = device_of(cfg.device)
    L.seed_everything(cfg.seed, verbose=False)
    painter = build_painter(cfg).to(device)
    has_plan = painter.resumable
    timelapse = Timelapse(cfg.frames, cfg.frame_side, seconds=cfg.timelapse_seconds, kind=cfg.timelapse)
    stops_at = None if has_plan and painter.components.density.chooses_number else cfg.psnr
    goals = goals_of(early_stop=cfg.early_stop, psnr=stops_at, seconds=cfg.seconds, has_plan=has_plan)
    both = [timelapse, *goals, *callbacks]
    trainer = make_trainer(cfg, device, folder, loggers, both, checkpoints=has_plan, clips=False)
    heartbeat.say("preparing the first step")
    has_steps = painter.schedule.steps or cfg.seconds
    return Fitted(painter, timelapse, fit(trainer, painter, checkpoint=checkpoint) if has_steps else None)


class Opening(L.Callback):
    """Writes the input pictures before the first step, so that a full disk is noticed early; warns about slow steps."""

    def __init__(self, cfg: DictConfig, folder: Path) -> None:
        self.cfg, self.folder = cfg, folder
        self.is_written = False

    def setup(self, trainer: L.Trainer, pl_module: Any, stage: str) -> None:
        may_be_slow = pl_module.resumable and pl_module.device.type == "cpu"  # other painters have no gradient steps
        if may_be_slow and self.cfg.seconds is None and not is_job():
            warn_of_slow_steps(pl_module.components.stages, pl_module.budget)
        if self.cfg.seconds is None and not is_job():
            height, width = pl_module.pictures["target"].shape[1:]
            log_idle_parts(pl_module.components, pl_module.strokes(), (height, width))
        self.write(pl_module)

    def write(self, painter: PaintingModule) -> None:
        """Write the input pictures unless they have been written already."""
        if not self.is_written:
            for name, picture in painter.pictures.items():
                write_picture(self.folder / f"{name}.png", picture)
        self.is_written = True


def write(
    fitted: Fitted,
    cfg: DictConfig,
    folder: Path,
    metrics: Mapping[str, Metric],
    provenance: Provenance,
    start: float | None,
) -> Finished:
    """Finish a painting and write its files; interruptions are delayed until the files have been written."""
    if not is_job():
        log.info("writing the page" if cfg.report else "writing the files")
    heartbeat.say("writing")
    with delayed_interrupt("stopping once painting and catalogue are written"):
        finished = finish(fitted.painter, cfg, fitted.timelapse, metrics, provenance=provenance, start=start)
        finished.write(folder)
    return finished


def write_page_and_film(folder: Path, finished: Finished, *, page: bool) -> None:
    """Write the timelapse and the page in parallel, which works because video encoding releases the GIL."""
    assert finished.timelapse is not None
    with ThreadPoolExecutor(1) as beside:
        film = beside.submit(finished.timelapse.write, folder)
        if page:
            try_to_write_page(folder, finished, film)
    film.result()


def report_painting(trackers: Trackers, folder: Path, finished: Finished) -> None:
    """Pass the metrics, pictures, frames and files of a painting to the trackers."""
    frames = {} if finished.timelapse is None else finished.timelapse.frames
    steps = sorted(frames)[:-1]  # without the last frame, which is the painting
    trackers.report(
        finished.metrics,
        pictures={name: folder / f"{name}.png" for name in ("target", "painting")},
        frames={step: frames[step] for step in steps[:: max(1, -(-len(steps) // TRACKED_FRAMES))]},
        files={"catalogue": folder / "catalogue.h5"},
    )


def try_to_write_page(folder: Path, finished: Finished, film: Future[Any] | None = None) -> None:
    """Write a run's page with its ``film``; a failure is logged and does not end the run."""
    from brushexp.pages.run_page import write_run_page  # noqa: PLC0415  (runs without a page start sooner)

    try:
        write_run_page(folder, finished, film)
    except Exception as error:
        log.error("report.html could not be written: %s", error, exc_info=not isinstance(error, UserError))
