"""``task=export``: a saved painting as pictures of any size, vectors, tables and more, without optimising."""

import logging
import time
from dataclasses import replace
from pathlib import Path

from omegaconf import DictConfig

from brushexp.plugins.export.job import export_job, with_renderer
from brushexp.registry import take_built
from brushexp.strokes.storage import load_catalogue
from brushexp.system.run_files import note_files

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write a catalogue in every form of ``cfg.to`` into the run's folder."""
    exporters = {name: take_built(node) for name, node in cfg.to.items()}
    saved, renderer = with_renderer(load_catalogue(Path(cfg.catalogue)), cfg.get("renderer"), cfg.catalogue)
    job = export_job(saved, renderer, take_built(cfg.blend), resolution=cfg.resolution, source=cfg.catalogue)
    lamp = {name: value for name, value in cfg.light.items() if value is not None}
    job = replace(job, light=replace(job.light, **lamp))
    present, before = set(folder.iterdir()), time.monotonic()
    for exporter in exporters.values():
        begin = time.monotonic()
        paths = exporter.write(job, folder)
        seconds = time.monotonic() - begin
        note_files(folder, set(paths) - present)  # a library in C may have written them
        for path in paths:
            log.info("%s: %.3g MB (%.1f s)", path, path.stat().st_size / 1e6, seconds)
    return {
        "n_strokes": len(job.strokes),
        "height": job.size[0],
        "width": job.size[1],
        "seconds": time.monotonic() - before,
    }
