"""``brushexp.load``: load a painting from its run folder or from its catalogue."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from brushexp.api.painting import Painting
from brushexp.api.settings import Settings, load_choices, undisturbed
from brushexp.config.tasks import TASKS
from brushexp.painting.finished import Finished
from brushexp.painting.reopen import export_job, with_renderer
from brushexp.registry import plain_config
from brushexp.results.painting_files import read_painting
from brushexp.results.runs import words_of
from brushexp.strokes.saved import Saved, config_of
from brushexp.strokes.storage import CATALOGUE_NAME, load_catalogue
from brushexp.system.reading import json_of, read_text
from brushexp.system.run_files import METRICS_FILE


def load(source: str | PathLike[str]) -> Painting:
    """Load a finished painting as returned by `paint`: its strokes, pictures, metrics and settings.

    The strokes are not optimised again, and they are rendered only if ``painting.png`` is missing.

    Args:
        source: the folder of a run, a ``catalogue.h5``, ``strokes.json`` or ``strokes.bits``, or the name of a
            shipped catalogue. A painting loaded without the other files of its run has no ``target`` or ``metrics``.

    Raises:
        UserError: if a file is damaged or needs a plugin that is missing.

    >>> from tempfile import TemporaryDirectory
    >>> from brushexp.api.painting import paint
    >>> painting = paint("astronaut", look="plain", resolution=32, strokes=20, steps=3)
    >>> with TemporaryDirectory() as folder:
    ...     _ = painting.save(folder)
    ...     again = load(folder)
    >>> again.metrics["psnr"] == painting.metrics["psnr"], bool((again.image == painting.image).all())
    (True, True)
    """
    load_choices()
    path = Path(source).expanduser()
    folder = path if path.is_dir() else path.parent if path.name == CATALOGUE_NAME else None
    with undisturbed():
        saved = load_catalogue(path, "source")
        saved, renderer = with_renderer(saved, None, str(path))
        job = export_job(saved, renderer, source=str(config_of(saved).get("image", path)))
        finished = Finished(job, {}, dict) if folder is None else read_painting(folder, job)
        if "painting" not in finished.pictures:
            flat = {} if job.is_bare else {"flat": job.bare().picture()}
            finished = replace(finished, pictures={**finished.pictures, **flat, "painting": job.picture()})
    if folder is not None and (folder / METRICS_FILE).is_file():
        figures: dict[str, Any] = json_of(read_text(folder / METRICS_FILE, "load its catalogue.h5 alone"))
        finished = replace(finished, compute_metrics=lambda: figures)
    return Painting(finished, _settings_of(saved, path, folder))


def _settings_of(saved: Saved, path: Path, folder: Path | None) -> Settings:
    """Read the settings recorded in a painting's catalogue."""
    recorded = plain_config(config_of(saved))
    usual = {"task": "paint", "image": str(path), "threads": None}
    cfg: Any = OmegaConf.merge(usual, recorded)
    if cfg.task not in TASKS:  # the task belongs to a package that is not installed
        cfg.task = "paint"
    return Settings(cfg, [] if folder is None else words_of(folder), {}, None if folder is None else folder.resolve())
