"""``task=film``: paint a film picture by picture, and write it on the way."""

import logging
from pathlib import Path
from threading import Event

import numpy as np
import torch
from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.pictures.video import filming
from brushexp.runs.resume import RECORD, record_of, restore_run
from brushexp.strokes.storage import load_catalogue
from brushexp.system.callbacks import FAILED, INTERRUPTED
from brushexp.system.files import replacing, write_json, write_picture
from brushexp.system.progress import showing
from brushexp.system.run_files import CHECKPOINT
from brushexp.system.runtime import interruptible
from brushexp_films.films import PaintedFilm, cel_of, frame_in
from brushexp_films.schema import FRAMES
from brushexp_films.sound import add_sound

log = logging.getLogger(__name__)
COMPLETED = "completed"


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Paint the film that ``image`` names and write it, and the catalogues of its pictures, into the run's folder.

    With ``resume`` it goes on behind the pictures of that run. Whatever ends it, the film has all pictures that were
    done, and what ended it is raised then.
    """
    cfg, checkpoint = restore_run(cfg)
    film, stop = PaintedFilm(cfg, folder, checkpoint and checkpoint.parent), Event()
    failure: BaseException | None = None
    (folder / FRAMES).mkdir(exist_ok=True)
    (folder / "metrics.json").unlink(missing_ok=True)
    with replacing(folder / CHECKPOINT) as temporary:  # its settings; what else there is to know are its pictures
        torch.save({RECORD: record_of(cfg, folder)}, temporary)
    with filming(folder / "film", "mp4", film.size, film.rate) as video, showing("painting the film") as show:
        with interruptible(stop.set, "stopping after this picture; the film so far will be written"):
            for number, target in enumerate(film.targets()):
                if number and stop.is_set():  # there is a next picture, whatever the film says of its length
                    failure = KeyboardInterrupt()
                    break
                try:
                    picture = film.take(number, target)
                except (Exception, KeyboardInterrupt, SystemExit) as error:
                    if not number:
                        raise
                    failure = error
                    break
                video.show(picture, 1)
                show(min(1.0, (number + 1) / film.planned), f"picture {number + 1}, {film.psnr[-1]:.2f} dB")
        if not film.psnr:
            (folder / CHECKPOINT).unlink()
            raise UserError(f"film.start={cfg.film.start:g} is behind the end of {cfg.image}; give an earlier second")
    for path in (path for path in video.paths if path.suffix == ".mp4"):
        add_sound(path, film.clip.path, cfg.film.start)
    return conclude_film(film, None if checkpoint else start, failure)


def conclude_film(film: PaintedFilm, start: float | None, failure: BaseException | None) -> dict[str, object]:
    """Write what is left to write of a film that has come to an end, and raise the ``failure`` that it was, if any."""
    folder, count = film.folder, len(film.psnr)
    pictures = []
    for number in sorted({0, count // 2, count - 1}):
        film.reel.show(cel_of(load_catalogue(frame_in(folder, number)), film.device))
        pictures.append(film.lit())
    ended = INTERRUPTED if isinstance(failure, KeyboardInterrupt) else FAILED
    status = COMPLETED if failure is None else ended
    write_picture(folder / "preview.png", np.concatenate(pictures, axis=1))
    metrics = film.metrics(start, status)
    write_json(folder / "metrics.json", metrics)
    log.info(
        "%s: %d pictures in %d scenes, %.2f dB, flicker %s, %s s a picture",
        folder / "film.mp4", metrics["n_frames"], metrics["n_scenes"], metrics["psnr"],
        *("-" if metrics[key] is None else f"{metrics[key]:.2g}" for key in ("flicker", "seconds_per_frame")),
    )  # fmt: skip
    if failure is not None:
        log.warning("%s at picture %d; continue with: brushexp resume=%s", status, count, folder)
        raise failure
    (folder / CHECKPOINT).unlink(missing_ok=True)
    return metrics
