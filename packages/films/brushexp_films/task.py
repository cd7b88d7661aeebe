"""``task=film``: paint a film frame by frame, write each frame once it is painted, and collect the film's metrics."""

import logging
import math
import time
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import chain
from pathlib import Path
from threading import Event

import lightning as L
import numpy as np
import torch
from omegaconf import DictConfig
from torch import Tensor

from brushexp.contracts import UserError, take_built
from brushexp.contracts.families import ExportJob
from brushexp.contracts.files import (
    CHECKPOINT,
    IN_LOG,
    as_shown,
    replacing,
    showing,
    to_bytes,
    write_json,
    write_picture,
)
from brushexp.contracts.machine import device_of, interruptible, peak_memory
from brushexp.contracts.painting import bare_job, build_components, build_painter, goals_of
from brushexp.contracts.pictures import filming, planes_of, psnr_of, size_at
from brushexp.contracts.runs import (
    RECORD_KEY,
    Status,
    conclude,
    fit,
    how_to_go_on,
    make_trainer,
    record_of,
    restore_run,
)
from brushexp.contracts.strokes import Saved, load_catalogue, save_catalogue
from brushexp_films.carrying import Carrier, Cel, Reel
from brushexp_films.changes import Flicker
from brushexp_films.clips import TimedPicture, open_clip, pictures_between
from brushexp_films.schema import FRAMES
from brushexp_films.sound import add_sound

log = logging.getLogger(__name__)
COMMON_FIELDS = (
    "size",
    "renderer",
    "renderer_hash",
    "seed",
)  # fields shared by the catalogues of all pictures
TICKS = Fraction(120_000)  # ticks per second; the common frame rates and milliseconds are whole numbers of ticks


class PaintedFilm:
    """A film being painted: its components, and its metrics so far."""

    def __init__(self, cfg: DictConfig, folder: Path, before: Path | None) -> None:
        self.cfg, self.folder, self.device = cfg, folder, device_of(cfg.device)
        self.before = before  # folder with pictures of this film that an earlier run painted
        self.clip = open_clip(Path(cfg.image))
        self.size = size_at(cfg.resolution, *self.clip.size)
        self.rate = Fraction(self.clip.rate / cfg.film.every).limit_denominator(1001)
        parts, self.palette = build_components(cfg), take_built(cfg.palette)
        renderer = parts.stages[-1].renderer.to(self.device).requires_grad_(False)
        for loss in parts.losses.values():
            loss.to(self.device)
        self.reel = Reel(self.begin, Carrier(parts, renderer, cfg.film.steps, cfg.seed), cfg.film.change)
        self.bare = bare_job(cfg, renderer, parts.blend, self.size)
        self.flicker, self.psnr, self.seconds = Flicker(), list[float](), list[float]()

    @property
    def planned(self) -> int:
        """Number of pictures to paint, at least 1, computed from the length stated in the file."""
        film, rate, end = self.cfg.film, self.clip.rate, self.clip.count
        if film.stop is not None:
            end = min(max(1, math.ceil(film.stop * rate)), end)
        return max(1, math.ceil((end - math.ceil(film.start * rate)) / film.every))

    def targets(self) -> Iterator[tuple[Tensor, TimedPicture]]:
        """Yield the targets (3, H, W) to paint, in order, with the decoded pictures and their times."""
        film = self.cfg.film
        for shown in pictures_between(self.clip, film.start, film.stop, film.every):
            yield self.palette(planes_of(shown.picture, self.cfg.resolution)).to(self.device), shown

    def begin(self, picture: Tensor) -> Cel:
        """Paint the first picture of a scene in the same way as a single picture."""
        cfg = self.cfg
        L.seed_everything(cfg.seed, verbose=False)
        painter = build_painter(cfg, picture).to(self.device)
        if painter.schedule.steps or cfg.seconds:
            goals = goals_of(early_stop=cfg.early_stop, psnr=cfg.psnr, seconds=cfg.seconds)
            trainer = make_trainer(cfg, self.device, self.folder, [], goals, checkpoints=False, clips=False)
            failure = fit(trainer, painter)
            conclude(painter, None, cfg, failure, painter.schedule.step)
        painter.hand_over()  # strokes are carried on, so changes that only act at the end are skipped
        return Cel(painter.strokes(), painter.front_to_back, painter.picture.background)

    def load_painted(self, number: int) -> Cel | None:
        """Load a picture's strokes if an earlier run painted it and all pictures before it; otherwise return None."""
        before, self.before = self.before, None  # after the first missing picture, all are repainted
        if before is None or not (path := frame_in(before, number)).exists():
            return None
        try:
            saved = load_catalogue(path)
            if any(getattr(saved, name) != getattr(self.bare.saved, name) for name in COMMON_FIELDS):
                raise UserError(f"{path} belongs to another film")
        except UserError as error:
            log.warning("%s; this picture and all later ones are painted again", error)
            return None
        self.before = before
        return cel_of(saved, self.device)

    def take(self, number: int, target: Tensor) -> np.ndarray:
        """Paint a picture, or reuse its strokes from an earlier run, and return the lit painting (H, W, 3)."""
        since, scenes, cel = time.monotonic(), self.reel.scenes, self.load_painted(number)
        if cel is None:
            self.reel.paint(target)
        else:
            self.reel.follow(target, cel)
        picture = self.finished_picture()
        if self.before is None or self.before.resolve() != self.folder.resolve():
            save_catalogue(frame_in(self.folder, number), self.job().saved)
        self.psnr.append(psnr_of(float((self.reel.image - target).square().mean())))
        self.flicker.add(torch.from_numpy(np.moveaxis(picture, 2, 0) / np.float32(255)), target.cpu())
        if cel is None and self.reel.scenes == scenes:
            self.seconds.append(time.monotonic() - since)
        return picture

    def finished_picture(self) -> np.ndarray:
        """Return the last painting (H, W, 3), with paper and lighting applied."""
        return to_bytes(self.reel.image) if self.bare.is_bare else self.job().picture(self.reel.image)

    def job(self) -> ExportJob:
        """Return an export job with the last picture's strokes, which can be drawn and saved."""
        cel = self.reel.cel
        return replace(self.bare, saved=self.bare.saved.with_strokes(cel.strokes, cel.front_to_back, cel.background))

    def metrics(self, start: float | None, status: Status) -> dict[str, object]:
        """Collect the values for metrics.json."""
        count, carried = len(self.psnr), len(self.seconds)
        finite = [psnr for psnr in self.psnr if math.isfinite(psnr)]  # black pictures have an infinite PSNR
        return {
            "psnr": float(np.mean(finite or [math.inf])),
            "psnr_lowest": min(self.psnr),
            "flicker": self.flicker.value,
            "n_frames": count,
            "n_scenes": self.reel.scenes,
            "n_strokes": len(self.reel.cel.strokes),
            "seconds_per_frame": sum(self.seconds) / carried if carried else None,
            "seconds_total": None if start is None else time.monotonic() - start,
            "peak_memory_mb": peak_memory(),
            "device": str(self.device),
            "status": status,
            "loss": "+".join(self.cfg.loss),
        }


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Paint the film ``cfg.image``, or continue an interrupted run; finished pictures are kept however the run ends."""
    cfg, checkpoint = restore_run(cfg)
    film, stop = PaintedFilm(cfg, folder, checkpoint and checkpoint.parent), Event()
    failure: BaseException | None = None
    targets = film.targets()
    if (first := next(targets, None)) is None:
        raise UserError(f"film.start={cfg.film.start:g} is after the end of {cfg.image}; give an earlier second")
    (folder / FRAMES).mkdir(exist_ok=True)
    (folder / "metrics.json").unlink(missing_ok=True)
    with replacing(folder / CHECKPOINT) as temporary:  # only the settings; pictures contain the rest of the state
        torch.save({RECORD_KEY: record_of(cfg, folder)}, temporary)
    reel = filming(folder / "film", "mp4", film.size, TICKS, usual=film.rate, begin=round(first[1].begin * TICKS))
    until_stopped = interruptible(stop.set, "stopping after this picture; the film so far will be written")
    with reel as video, showing("painting the film") as show, until_stopped:
        for number, (target, shown) in enumerate(chain([first], targets)):
            if number and stop.is_set():  # a next picture exists, regardless of the length that the film states
                failure = KeyboardInterrupt()
                break
            try:
                picture = film.take(number, target)
            except (Exception, KeyboardInterrupt, SystemExit) as error:
                if not number:
                    raise
                failure = error
                break
            video.show(picture, max(1, round(shown.end * TICKS) - round(shown.begin * TICKS)))
            show(min(1.0, (number + 1) / film.planned), f"picture {number + 1}, {film.psnr[-1]:.2f} dB")
    if video.path.suffix == ".mp4":
        add_sound(video.path, film.clip.path, cfg.film.start)
    return conclude_film(film, None if checkpoint else start, failure)


def conclude_film(film: PaintedFilm, start: float | None, failure: BaseException | None) -> dict[str, object]:
    """Write the preview and metrics of a film whose run has ended, and raise the ``failure`` that ended it, if any."""
    folder, count = film.folder, len(film.psnr)
    pictures = []
    for number in sorted({0, count // 2, count - 1}):
        film.reel.show(cel_of(load_catalogue(frame_in(folder, number)), film.device))
        pictures.append(film.finished_picture())
    ended = Status.INTERRUPTED if isinstance(failure, KeyboardInterrupt) else Status.FAILED
    status = Status.COMPLETED if failure is None else ended
    write_picture(folder / "preview.png", np.concatenate(pictures, axis=1))
    metrics = film.metrics(start, status)
    write_json(folder / "metrics.json", metrics)
    log.info(
        "%s: %d pictures in %d scenes, %.2f dB, flicker %s, %s s per picture",
        folder / "film.mp4", metrics["n_frames"], metrics["n_scenes"], metrics["psnr"],
        *("-" if metrics[key] is None else f"{metrics[key]:.2g}" for key in ("flicker", "seconds_per_frame")),
        extra=IN_LOG,
    )  # fmt: skip
    written = [path for path in (folder / "film.mp4", folder / "film.gif") if path.is_file()]
    took = "" if start is None else f" in {time.monotonic() - start:.0f} s"
    for path in written:
        log.info("%s  %s picture%s%s", as_shown(path), f"{count:,}", "" if count == 1 else "s", took)
    if failure is not None:
        words = f"{status} at picture {count}; {how_to_go_on(folder, 'paint')}"
        if status == Status.INTERRUPTED:
            raise KeyboardInterrupt(words) from failure
        log.warning(words)
        raise failure
    (folder / CHECKPOINT).unlink(missing_ok=True)
    return metrics


def frame_in(folder: Path, number: int) -> Path:
    """Return the path of a picture's catalogue in a run's folder."""
    return folder / FRAMES / f"{number:06d}.h5"


def cel_of(saved: Saved, device: torch.device) -> Cel:
    """Read a picture's strokes from its catalogue."""
    above = saved.depth.argsort(descending=True)
    return Cel(saved.strokes.map(lambda value: value.to(device)), above.to(device), saved.background.to(device))
