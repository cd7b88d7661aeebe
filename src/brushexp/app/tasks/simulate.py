"""``task=simulate``: make a set of simulated strokes to train renderers on."""

from __future__ import annotations

import logging
import shlex
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event

import numpy as np
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from brushexp.app.checks import Simulate, check_keys
from brushexp.errors import UserError
from brushexp.plugins.engine.base import Engine
from brushexp.registry import build
from brushexp.strokes.prior import parameters_of, sample_prior
from brushexp.system.files import write_picture
from brushexp.system.process import interruptible
from brushexp.training.dataset import StrokeFile, origin_of
from brushexp.training.recording import Recording

NOTICES = 10  # lines in the log of a run, where there is no terminal for a bar
SHOWN, COLUMNS = 60, 10  # strokes on the contact sheet, and in a row of it
SHOWN_SIDE = 128  # pixels of a stroke on the sheet, if it is not larger
GAP, PAPER, RULE = 4, 255, 224  # pixels between strokes; grey levels of what lies below and between them

log = logging.getLogger(__name__)


def run(cfg: DictConfig, start: float) -> dict[str, object]:
    """Write ``n`` strokes to ``path`` and ``strokes.png`` into the run's folder; continue what is there already."""
    check_keys(cfg, Simulate)
    if cfg.seed >= 2**64:
        raise UserError(f"seed={cfg.seed} is too large; set seed to a whole number below 2**64")
    folder = Path(HydraConfig.get().runtime.output_dir)
    path = folder / "strokes.h5" if cfg.path is None else Path(cfg.path)
    engine: Engine = build(cfg.engine)
    before = time.monotonic()
    with Recording(path, origin_of(cfg.engine, engine), cfg.seed, cfg.n) as recording:
        if recording.complete:
            log.info("%s has these %d strokes already", path, cfg.n)
        elif recording.done:
            log.info("%d of %d strokes are there already; going on", recording.done, cfg.n)
        todo = cfg.n - recording.done
        try:
            record(recording, engine)
        except (UserError, KeyboardInterrupt):
            log.warning("%d of %d strokes are kept; continue with: %s", recording.done, cfg.n, command(path))
            raise
    seconds = time.monotonic() - before
    write_picture(folder / "strokes.png", contact_sheet(StrokeFile(path)))
    size = path.stat().st_size
    log.info("%s: %d strokes, %.1f MB, in %.1f s; %s", path, cfg.n, size / 1e6, seconds, folder / "strokes.png")
    return {
        "n": cfg.n,
        "seconds": seconds,
        "seconds_total": time.monotonic() - start,
        "strokes_per_second": todo / seconds if todo else None,
        "bytes": size,
        "status": "completed",
    }


def record(recording: Recording, engine: Engine) -> None:
    """Simulate what the recording lacks, and finish it.

    Raises:
        KeyboardInterrupt: after the present batch, when Ctrl-C was pressed.
    """
    pressed = Event()
    with interruptible(pressed.set, "stopping after this batch"), progress(recording.n, recording.done) as show:
        for first, size in recording.batches():
            parameters = parameters_of(sample_prior(size, recording.seed, first))
            recording.add(parameters, engine(parameters, seed=recording.seed, first=first))
            show(recording.done)
            if pressed.is_set():
                raise KeyboardInterrupt
    recording.finish()


def command(path: Path) -> str:
    """What to type to continue."""
    kept = [text for text in HydraConfig.get().overrides.task if text.partition("=")[0] not in ("path", "output")]
    return shlex.join(["python", "run.py", *kept, f"path={path}"])


def contact_sheet(strokes: StrokeFile) -> np.ndarray:
    """The first strokes over white in rows, magnified if they are small: (H, W, 3) uint8."""
    n, side = min(SHOWN, len(strokes)), strokes.window
    rgba = strokes.pictures(np.arange(n)).astype(np.float32)
    alpha = rgba[..., 3:] / 255
    pictures = (alpha * rgba[..., :3] + (1 - alpha) * PAPER + 0.5).astype(np.uint8)
    zoom = max(1, SHOWN_SIDE // side)
    pitch = side * zoom + GAP
    rows, columns = -(-n // COLUMNS), min(n, COLUMNS)
    sheet = np.full((rows * pitch + GAP, columns * pitch + GAP, 3), RULE, np.uint8)
    for k, picture in enumerate(pictures):
        top, left = GAP + k // COLUMNS * pitch, GAP + k % COLUMNS * pitch
        large = picture.repeat(zoom, axis=0).repeat(zoom, axis=1)
        sheet[top : top + len(large), left : left + len(large)] = large
    return sheet


class Rate:
    """Shows how far a run is: a bar with strokes/s and time left, or a few lines where there is no terminal."""

    def __init__(self, n: int, done: int) -> None:
        console = Console(stderr=True)
        self.bar = Progress(
            TextColumn("simulating"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[state]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console,
            disable=not console.is_terminal,
            transient=True,
        )
        self.n, self.first, self.start = n, done, time.monotonic()
        self.noticed = done * NOTICES // n
        self.task = self.bar.add_task("simulating", total=n, completed=done, state="")

    def __call__(self, done: int) -> None:
        rate = (done - self.first) / max(time.monotonic() - self.start, 1e-9)
        self.bar.update(self.task, completed=done, state=f"{rate:.0f} strokes/s")
        if self.bar.disable and done * NOTICES // self.n > self.noticed:
            self.noticed = done * NOTICES // self.n
            left = (self.n - done) / rate
            log.info("stroke %d of %d: %.0f strokes/s, %.0f s left", done, self.n, rate, left)


@contextmanager
def progress(n: int, done: int) -> Iterator[Rate]:
    """A `Rate` on the screen."""
    rate = Rate(n, done)
    with rate.bar:
        yield rate
