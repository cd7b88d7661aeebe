"""``task=export``: write a saved painting as pictures of any size, vector files and tables, without optimising."""

import logging
import time
from dataclasses import replace
from pathlib import Path

from omegaconf import DictConfig

from brushexp.config.output_folders import run_beside
from brushexp.painting.reopen import export_job, with_renderer
from brushexp.registry import take_built
from brushexp.results.exports import FOLDER, move_beside
from brushexp.strokes.storage import load_catalogue
from brushexp.system.heartbeat import heartbeat
from brushexp.system.run_files import note_files
from brushexp.system.terminal import as_shown

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write a catalogue in every format of ``cfg.to``, either next to its painting or into the export's own folder."""
    exporters = {name: take_built(node) for name, node in cfg.to.items()}
    saved, renderer = with_renderer(load_catalogue(Path(cfg.catalogue)), cfg.get("renderer"), cfg.catalogue)
    job = export_job(saved, renderer, take_built(cfg.blend), resolution=cfg.resolution, source=cfg.catalogue)
    job = replace(
        job, light=replace(job.light, **{key: value for key, value in cfg.light.items() if value is not None})
    )
    earlier_files, before = set(folder.iterdir()), time.monotonic()
    run = run_beside(cfg)
    beside: dict[str, list[str]] = {}  # names of the files next to the painting, by format
    for name, exporter in exporters.items():
        begin = time.monotonic()
        heartbeat.say(f"writing {exporter.key}")
        paths = exporter.write(job, folder)
        seconds = time.monotonic() - begin
        note_files(folder, set(paths) - earlier_files)  # C libraries may have written them
        if run is not None and folder.parent == (run / FOLDER).resolve():
            paths = move_beside(paths, run)
            beside[str(name)] = [path.name for path in paths if path.parent == run]
        for path in paths:
            log.info("%s: %.3g MB (%.1f s)", as_shown(path), path.stat().st_size / 1e6, seconds)
    height, width = job.size
    spent = time.monotonic() - before
    return {"n_strokes": len(job.strokes), "height": height, "width": width, "seconds": spent, "files": beside}
