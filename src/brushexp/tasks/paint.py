"""``task=paint``: optimise a catalogue of strokes until it looks like the picture."""

import logging
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import lightning as L
from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.painting.build import build_painter
from brushexp.painting.components import tell_of_slow_steps
from brushexp.painting.finished import Finished, finish, summary_line
from brushexp.painting.goals import goals_of
from brushexp.painting.metrics import metrics_of
from brushexp.painting.painting_module import PaintingModule
from brushexp.painting.timelapse import Timelapse
from brushexp.runs.closing import is_job, say_where
from brushexp.runs.resume import restore_run
from brushexp.runs.tracking import Trackers, make_trackers
from brushexp.runs.trainer import conclude, fit, make_trainer
from brushexp.system.device import device_of
from brushexp.system.files import write_picture
from brushexp.system.runtime import held_back
from brushexp.system.terminal import IN_LOG

log = logging.getLogger(__name__)
TRACKED_FRAMES = 8  # frames of the timelapse that loggers get


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Paint a picture, write everything into the run's folder, and return the figures of metrics.json."""
    cfg, checkpoint = restore_run(cfg)
    return paint_picture(cfg, folder, None if checkpoint else start, checkpoint).metrics


def paint_picture(
    cfg: DictConfig, folder: Path | None = None, start: float | None = None,
    checkpoint: Path | None = None, callbacks: Sequence[L.Callback] = (),
    build: Callable[[DictConfig], PaintingModule] = build_painter,
) -> Finished:  # fmt: skip
    """Paint from a checked config, in memory or into a run's ``folder``, which then also holds a fit that failed.

    ``start`` is `time.monotonic` at the start of the program, or None for a run that goes on from its ``checkpoint``.
    """
    trackers, device, metrics = make_trackers(cfg, folder), device_of(cfg.device), metrics_of(cfg)
    L.seed_everything(cfg.seed, verbose=False)
    painter = build(cfg).to(device)
    timelapse = Timelapse(cfg.frames, cfg.frame_side, seconds=cfg.timelapse_seconds, kind=cfg.timelapse)
    plan = painter.resumable
    goals = goals_of(early_stop=cfg.early_stop, psnr=cfg.psnr, seconds=cfg.seconds, has_plan=plan)
    trainer = make_trainer(
        cfg, device, folder, [trackers], [timelapse, *goals, *callbacks], checkpoints=plan, clips=False
    )
    if folder is not None:
        if device.type == "cpu" and cfg.seconds is None and not is_job():
            tell_of_slow_steps(painter.components.stages, len(painter.strokes()))
        for name, picture in painter.pictures.items():  # before the steps: a disk may be full
            write_picture(folder / f"{name}.png", picture)
    with trackers:
        failure = fit(trainer, painter, checkpoint=checkpoint) if painter.schedule.steps or cfg.seconds else None
        if folder is None:
            conclude(painter, None, cfg, failure, painter.schedule.step)
            return finish(painter, cfg, timelapse, metrics, start=start)
        if not is_job():
            log.info("writing the page" if cfg.report else "writing the files")
        with held_back("stopping when painting and catalogue are written"):
            finished = finish(painter, cfg, timelapse, metrics, start=start)
            finished.write(folder)
        report_painting(trackers, folder, finished, timelapse)
    with ThreadPoolExecutor(1) as beside:  # to encode a film leaves Python to the page
        film = beside.submit(timelapse.write, folder)
        if cfg.report:
            try_to_write_page(folder, finished, film)
    film.result()
    finished.conclude(folder)  # until then the run counts as one at work
    log.info(summary_line(folder, finished.metrics), extra=IN_LOG)
    conclude(painter, folder, cfg, failure, painter.schedule.step)
    say_where(folder, len(finished.job.strokes), start)
    return finished


def report_painting(trackers: Trackers, folder: Path, finished: Finished, timelapse: Timelapse) -> None:
    """Pass the figures, pictures, frames and files of a painting to the trackers."""
    frames = timelapse.frames
    steps = sorted(frames)[:-1]  # without the last, which is the painting
    trackers.report(
        finished.metrics,
        pictures={name: folder / f"{name}.png" for name in ("target", "painting")},
        frames={step: frames[step] for step in steps[:: max(1, -(-len(steps) // TRACKED_FRAMES))]},
        files={"catalogue": folder / "catalogue.h5"},
    )


def try_to_write_page(folder: Path, finished: Finished, film: Future[Any] | None = None) -> None:
    """Write the page of a run, with its ``film``; an error is logged, and the run goes on."""
    from brushexp.pages.run_page import write_run_page  # noqa: PLC0415  (runs without a page start sooner)

    try:
        write_run_page(folder, finished, film)
    except Exception as error:
        log.error("no report.html of this run: %s", error, exc_info=not isinstance(error, UserError))
