"""``task=export``: a saved painting as pictures of any size, vectors, tables and more, without optimising."""

from __future__ import annotations

import logging
import time
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from brushexp.checks import Export, check_keys
from brushexp.errors import UserError
from brushexp.paint.outputs import renderer_of, work_of
from brushexp.registry import build, plugin_of, plugins
from brushexp.strokes.storage import load_catalogue

log = logging.getLogger(__name__)


def run(cfg: DictConfig, start: float) -> dict[str, object]:
    """Write a catalogue in every form of ``cfg.to`` into the run's folder."""
    check_keys(cfg, Export)
    if not cfg.to:
        choices = ", ".join(plugin.name for plugin in plugins("to"))
        raise UserError(f"to=[] writes nothing; choose one or more of {choices}")
    exporters = {name: build(node) for name, node in cfg.to.items()}
    saved = load_catalogue(Path(cfg.catalogue))
    chosen = cfg.get("renderer")
    renderer = renderer_of(saved) if chosen is None else build(chosen)
    name = saved.renderer if chosen is None else plugin_of(chosen).name
    if name == saved.renderer and renderer.weights_hash != saved.renderer_hash:
        log.warning(
            "%s was painted with other weights of renderer=%s, so the picture will differ; "
            "give those with renderer=%s renderer.checkpoint=...",
            cfg.catalogue, saved.renderer, saved.renderer,
        )  # fmt: skip
    work = work_of(saved, renderer, build(cfg.blend), name, cfg.resolution, cfg.catalogue)
    folder = Path(HydraConfig.get().runtime.output_dir)
    before = time.monotonic()
    for exporter in exporters.values():
        begin = time.monotonic()
        for path in exporter.write(work, folder):
            log.info("%s: %s (%.1f s)", path, in_bytes(path.stat().st_size), time.monotonic() - begin)
    return {
        "n_strokes": len(work.strokes),
        "height": work.size[0],
        "width": work.size[1],
        "seconds": time.monotonic() - before,
        "seconds_total": time.monotonic() - start,
        "status": "completed",
    }


def in_bytes(count: int) -> str:
    """A number of bytes as people read it."""
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{count / 1e3:.1f} kB" if count >= 1e3 else f"{count} bytes"
