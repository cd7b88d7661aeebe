"""``brushexp.paint`` and its result, a `Painting`."""

from __future__ import annotations

import html
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from torch import Tensor

from brushexp.api.settings import Settings, settings_of, undisturbed, write_pictures
from brushexp.errors import UserError
from brushexp.pages.run_page import run_page
from brushexp.painting.finished import Finished
from brushexp.plugins.export.base import LARGEST_SIDE_PIXELS, ExportJob
from brushexp.registry import build_named
from brushexp.runs.run_folder import check_inputs, clear, note_words, release_folder, take_folder
from brushexp.runs.runner import explaining_to_users
from brushexp.shading.light import UNLIT
from brushexp.strokes.catalogue import Strokes
from brushexp.system.run_files import recorded
from brushexp.system.spellings import find_path
from brushexp.system.status import Status
from brushexp.tasks.paint import paint_into, paint_picture, try_to_write_page

if TYPE_CHECKING:
    from collections.abc import Sequence

    import lightning as L
    from PIL import Image

    Picture = str | PathLike[str] | Image.Image | np.ndarray | Tensor | bytes | IO[bytes]

FRAME_HEIGHT = 760  # pixels of a painting in a notebook


@dataclass(frozen=True, eq=False, repr=False)
class Painting:
    """A finished painting with its strokes, pictures and metrics, held in memory until it is saved.

    It can be pickled and thus passed between processes.
    """

    finished: Finished
    settings: Settings

    def __getstate__(self) -> dict[str, Any]:
        finished = replace(self.finished, compute_metrics=partial(dict, self.metrics))  # the function may not pickle
        return {"finished": finished, "settings": self.settings}

    @property
    def strokes(self) -> Strokes:
        """The N strokes, in canvas pixels; their stacking order is given by ``depth``."""
        return self.finished.job.strokes

    @property
    def depth(self) -> Tensor:
        """(N,) int32 depth rank of each stroke; the bottom stroke has rank 0."""
        return self.finished.job.saved.depth

    @property
    def background(self) -> Tensor:
        """(3,) RGB colour of the bare canvas, in [0, 1]."""
        return self.finished.job.saved.background

    @property
    def image(self) -> np.ndarray:
        """(H, W, 3) uint8 picture of the painting, lit by its lamp if it has one."""
        return self.finished.image

    @property
    def target(self) -> np.ndarray:
        """(H, W, 3) uint8 target picture, at the resolution used for optimisation.

        Raises a UserError if the painting was loaded without its target.
        """
        if "target" not in self.finished.pictures:
            raise UserError("this painting was loaded without the target.png of its run; load the run's whole folder")
        return self.finished.pictures["target"]

    @property
    def metrics(self) -> Mapping[str, Any]:
        """The entries of metrics.json, computed on first use: ``psnr`` (dB), ``ssim``, ``seconds``, ``status``, ..."""
        with self.settings.as_asked():
            return self.finished.metrics

    def render(self, size: int | None = None, *, light: bool = True) -> np.ndarray:
        """Render the painting as (H, W, 3) uint8, sharp at any ``size`` (longer side); ``light`` turns on its lamp."""
        job = _resize(self.finished.job, size)
        with undisturbed():
            return (job if light else replace(job, light=UNLIT)).picture()

    def export(
        self, form: str, folder: str | PathLike[str] = ".", *, size: int | None = None, **options: Any
    ) -> list[Path]:
        """Export the painting to a format for other programs, as task=export does: svg, json, csv, gcode, png, ...

        Args:
            form: name of the exporter.
            folder: folder for the files; it is created if necessary.
            size: longer side in pixels; None keeps the size of the painting.
            options: exporter options, such as ``digits=2`` for svg.

        Returns:
            The paths of the files, main file first.
        """
        exporter = build_named("to", form, options)
        job = _resize(self.finished.job, size)
        exporter.check(len(job.strokes), job.size)
        into = find_path(folder)
        into.mkdir(parents=True, exist_ok=True)
        with undisturbed():
            return list[Path](exporter.write(job, into))

    def save(self, folder: str | PathLike[str]) -> Path:
        """Write a run's files (painting.png, catalogue.h5, report.html, ...), replacing those of an earlier painting.

        A timelapse is written only if ``frames`` was set; curves are never written. Returns the path of the HTML page.
        """
        into = find_path(folder)
        (into / ".hydra").mkdir(parents=True, exist_ok=True)
        check_inputs(into, self.settings.cfg)
        if into.resolve() != self.settings.folder:
            clear(into, self.settings.cfg)
        job = self.finished.job
        with recorded(into), undisturbed():
            settings = write_pictures(self.settings, into)
            note_words(into, settings.cfg, settings.words)
            job = replace(job, saved=replace(job.saved, config=settings.yaml))
            figures = {"status": Status.COMPLETED, **self.metrics}  # a catalogue without its run has no metrics
            finished = replace(self.finished, job=job, compute_metrics=lambda: figures)
            finished.write(into, finished.pictures)
            if finished.timelapse is not None:
                finished.timelapse.write(into)
            try_to_write_page(into, finished)
            finished.conclude(into)
        return into / "report.html"

    def _repr_html_(self) -> str:
        """Return the painting's HTML page, including its replay, for display in a notebook."""
        name = Path(str(self.settings.cfg.image)).name
        shown = {"painting": self.finished.pictures["painting"]}
        finished = replace(self.finished, pictures=shown, compute_metrics=lambda: self.metrics)
        page = run_page(finished, name=name)
        style = f"width: 100%; height: {FRAME_HEIGHT}px; border: 0"
        return f'<iframe title="{html.escape(name)}" style="{style}" srcdoc="{html.escape(page)}"></iframe>'

    def __repr__(self) -> str:
        height, width = self.finished.job.size
        psnr = self.metrics.get("psnr")
        quality = "" if psnr is None else f", {psnr:.2f} dB"
        return f"Painting({len(self.strokes)} strokes on {width} x {height} pixels{quality})"


def _resize(job: ExportJob, size: int | None) -> ExportJob:
    """Scale a painting to ``size`` pixels on the longer side; None keeps its size."""
    if size is None:
        return job
    if not isinstance(size, Real) or not 1 <= size <= LARGEST_SIDE_PIXELS:  # false for NaN
        raise UserError(f"size={size} is not 1 to {LARGEST_SIDE_PIXELS}; try size={max(job.size)}")
    return job.scaled(size / max(job.size))


def paint(
    image: Picture,
    *,
    look: str | None = None,
    strokes: int | None = None,
    seconds: float | None = None,
    output: str | PathLike[str] | None = None,
    **overrides: Any,
) -> Painting:
    """Paint a picture out of brush strokes by gradient descent, as ``task=paint`` does.

    Args:
        image: a path, the name of a scikit-image sample, a PIL image, the bytes of a file, an open file, an array
            (H, W, 3), (H, W) or, with alpha composited over white, (H, W, 4), or a tensor (3, H, W); uint8, bool or
            floats in [0, 1].
        look: the medium and style: oil (the default), watercolour, ...
        strokes: number of strokes; None for the number that the look chooses for the size of the picture.
        seconds: seconds of optimisation; None for the number of steps that the look sets.
        output: folder for the files of the run; with None, no files are written.
        overrides: further command-line keys: ``loss=["mse", "kl"]``, ``light={"azimuth": 90}``,
            ``**{"init.length": 3}``. ``style`` and ``focus`` may also be pictures in memory.

    Raises:
        UserError: if an argument is wrong, with the same message as on the command line.

    >>> painting = paint("astronaut", look="plain", resolution=32, strokes=20, steps=3)
    >>> painting.image.shape, len(painting.strokes), painting.metrics["steps"]
    ((32, 32, 3), 20, 3)
    """
    plan = plan_of(image, output, {"look": look, "strokes": strokes, "seconds": seconds}, overrides)
    return painting_of(plan)


def plan_of(
    image: Picture, output: str | PathLike[str] | None, main: Mapping[str, Any], overrides: Mapping[str, Any]
) -> Settings:
    """Check the settings of a painting, ignoring entries of ``main`` that are None."""
    typed = {key: value for key, value in main.items() if value is not None}
    frames = {"frames": 0} if output is None else {}  # no timelapse
    settings = settings_of("paint", {"image": image, **typed, **frames, **overrides}, output)
    loggers = [name for name in settings.cfg.logger if name != "csv"]
    for key, names in (("callbacks", list(settings.cfg.callbacks)), ("logger", loggers)):
        if output is None and names:
            raise UserError(f"{key}={','.join(names)} may write files; say where with output=")
    return settings


def painting_of(settings: Settings, callbacks: Sequence[L.Callback] = ()) -> Painting:
    """Paint with checked settings, and write the results to the output folder if the settings name one."""
    start, folder, cfg = time.monotonic(), settings.folder, settings.cfg
    with explaining_to_users(cfg), settings.as_asked():
        if folder is None:
            return Painting(paint_picture(cfg, callbacks), settings)
        try:
            take_folder(folder, cfg)
            settings = write_pictures(settings, folder)
            note_words(folder, settings.cfg, settings.words)
            return Painting(paint_into(folder, settings.cfg, start, callbacks=callbacks), settings)
        finally:
            release_folder(folder)
