"""Paint a picture of any size on a canvas on disk, tile by tile (``task=canvas``)."""

import logging
import math
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf

from brushexp.contracts import UserError
from brushexp.contracts.files import counting, todays_settings, with_progress, write_json, write_picture
from brushexp.contracts.machine import cores, peak_memory
from brushexp.contracts.pictures import Region, psnr_of
from brushexp.contracts.runs import Status
from brushexp_canvases.grid import Grid
from brushexp_canvases.jobs import paint_all, workers
from brushexp_canvases.page import write_viewer
from brushexp_canvases.pyramid import add_levels, write_iiif
from brushexp_canvases.source import Source, open_source
from brushexp_canvases.store import HEIGHT, PICTURES, CanvasStore
from brushexp_canvases.tile import Canvas, job_of

log = logging.getLogger(__name__)
LAYERS = ("painting", "target", "height")  # layers of the page; the first is drawn left of the curtain
RUN_KEYS = (  # keys that decide where and how tiles are painted, but not what they look like
    *("canvas", "workers", "cluster", "pyramid", "output", "overwrite", "threads", "trainer", "logger", "callbacks"),
    *("report", "frames", "frame_side", "timelapse", "timelapse_seconds", "checkpoint_every", "objective", "metric"),
)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Paint the missing tiles, write a pyramid with its page, and return the values of metrics.json."""
    path = Path(cfg.canvas)
    store = CanvasStore(path) if path.exists() else begin(path, cfg)
    check_same(store, cfg)
    settings = plain_settings(cfg) | {"background": store.record["background"]}
    canvas = Canvas(str(path.resolve()), settings, str(Path("plugins").resolve()))
    todo = [tile for tile in store.grid.tiles() if not (store.is_painted(tile) and store.is_drawn(tile))]
    total, before, memory = len(store.grid.tiles()), time.monotonic(), math.nan
    log.info("painting %d of %d tiles; %d are done", len(todo), total, total - len(todo))
    if todo:
        n = min(cfg.workers or cores(), len(todo))
        try:
            with workers(n, cfg.cluster) as client, counting("painting and drawing tiles", 2 * len(todo)) as show:
                memory = paint_all(client, canvas, store.grid, todo, show)
        except KeyboardInterrupt as interruption:
            words = f"interrupted; finished tiles are kept in {path}; to continue, type the same command"
            raise KeyboardInterrupt(words) from interruption
    seconds = time.monotonic() - before
    levels = {name: add_levels(store.root[name], name) for name in LAYERS if name in store.root}
    n_strokes, megapixels = int(store.counts.sum()), math.prod(store.grid.size) / 1e6
    if cfg.pyramid == "dzi":
        write_viewer(folder, levels, Path(cfg.image).name, n_strokes, partial(job_of, store, canvas.config))
    elif cfg.pyramid == "iiif":
        write_iiif(folder / "iiif", levels, Path(cfg.image).name)
    smallest = levels["painting"][-1]
    write_picture(folder / "painting.png", smallest.read(smallest.whole).transpose(1, 2, 0))
    errors = store.errors()
    metrics: dict[str, Any] = {
        "psnr": psnr_of(errors["mse"]),
        "seams": errors["seams"],
        "n_strokes": n_strokes,
        "n_tiles": total,
        "megapixels": megapixels,
        "seconds": seconds,
        "seconds_total": time.monotonic() - start,
        "peak_memory_mb": peak_memory(),
        "worker_memory_mb": memory,
        "status": Status.COMPLETED,
    }
    write_json(folder / "metrics.json", metrics)
    log.info("%s: %d strokes on %.1f megapixels", path, n_strokes, megapixels)
    return metrics


def begin(path: Path, cfg: DictConfig) -> CanvasStore:
    """Create a canvas for a picture, and copy the picture into it strip by strip."""
    source = open_source(Path(cfg.image), cfg.resolution)
    grid = Grid(source.size, min(cfg.tile, max(source.size)), min(cfg.margin, max(source.size) // 2))
    capacity = 1 + round(grid.side**2 / cfg.pixels_per_stroke)
    record = {"settings": relevant_settings(cfg), "size": list(source.size), "background": cfg.background}
    unfinished = path.with_name(f"{path.name}.part")
    pictures = (*PICTURES, HEIGHT) if cfg.light.depth else PICTURES
    store = CanvasStore.create(unfinished, grid, capacity, record, pictures)
    mean = copy_into(store, source)
    if cfg.background == "mean":
        store.root.attrs["record"] = {**record, "background": "#" + bytes(mean.round().astype(np.uint8)).hex()}
    unfinished.rename(path)
    return CanvasStore(path)


def copy_into(store: CanvasStore, source: Source) -> np.ndarray:
    """Copy a picture into the canvas, and return its mean colour (3,), 0 to 255."""
    (height, width), total = source.size, np.zeros(3)
    for top, rows in with_progress(source.strips(), height, "reading the picture", lambda item: item[1].shape[1]):
        store.write("target", Region(top, 0, rows.shape[1], width), rows)
        total += rows.sum(axis=(1, 2), dtype=np.float64)
    return total / (height * width)


def plain_settings(cfg: DictConfig) -> dict[str, Any]:
    """Convert the settings to plain data."""
    settings: Any = OmegaConf.to_container(cfg, resolve=True)
    return dict(settings)


def relevant_settings(cfg: DictConfig) -> dict[str, Any]:
    """Return the settings that affect the appearance of the canvas."""
    return {key: value for key, value in plain_settings(cfg).items() if key not in RUN_KEYS}


def check_same(store: CanvasStore, cfg: DictConfig) -> None:
    """Raise UserError if a canvas was started with different settings."""
    before, now = todays_settings(store.record["settings"]), relevant_settings(cfg)
    for key in sorted(before.keys() | now.keys()):
        if before.get(key) != now.get(key):
            raise UserError(
                f"canvas={store.path} was begun with {key}={before.get(key)}, but now {key}={now.get(key)}; "
                "type the old value again, or give another canvas="
            )
