"""Paint a tile next to the fixed strokes of its neighbours, and draw a tile from all strokes that reach into it."""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import lightning as L
import numpy as np
import torch
from omegaconf import DictConfig, OmegaConf
from torch import Tensor

from brushexp.contracts import take_built
from brushexp.contracts.families import Compositor, ExportJob, Order, Sampler, View, front_to_back
from brushexp.contracts.machine import device_of, peak_memory, use_threads
from brushexp.contracts.members import Fixed
from brushexp.contracts.painting import (
    StrokeOptimizer,
    bare_job,
    build_changes,
    build_components,
    build_stages,
    clip_of,
    compute_focus,
    faces_of,
)
from brushexp.contracts.pictures import Region, background_color
from brushexp.contracts.runs import conclude, fit, load_plugins, make_trainer
from brushexp.contracts.strokes import Catalogue, Strokes
from brushexp_canvases.grid import Tile
from brushexp_canvases.laying import lay, mark_overlapping
from brushexp_canvases.pyramid import grey_of, slices_of
from brushexp_canvases.store import HEIGHT, CanvasStore

THICK = 0.25  # height, in pitches, above which paint is white
SEAM = 4  # pixels on each side of a border between tiles that count as the seam
LIGHT_MARGIN = 2  # pixels around a part that affect its light
BORDER, WEIGHT = 8, 1.2  # width in pixels of the zone along each border, and its weight relative to other pixels


@dataclass(frozen=True)
class Canvas:
    """Path and settings of a canvas, as plain data that can be sent to workers."""

    path: str
    settings: dict[str, Any]
    plugins: str  # folder of the user's plugins

    def open(self) -> tuple[CanvasStore, DictConfig]:
        """Load the plugins, as every new process must, and open the arrays and the config."""
        logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)  # otherwise it logs the hardware for each tile
        load_plugins(Path(self.plugins), warns=False)
        use_threads(1)
        return CanvasStore(Path(self.path)), self.config

    @property
    def config(self) -> DictConfig:
        """Settings of the canvas as a config."""
        return OmegaConf.create(self.settings)


class MoveAllButFirst(Sampler):
    """Sampler of the whole window that moves all strokes except the first ``first`` strokes, which stay fixed."""

    cost, moves = "that of the whole window", "all but those of neighbours"

    def __init__(self, first: int) -> None:
        self.first = first

    def __call__(self, strokes: Strokes, size: tuple[int, int], step: int, generator: torch.Generator) -> View:
        numbers = torch.arange(len(strokes), device=strokes.position.device)
        return View(Region(0, 0, *size), numbers[self.first :], numbers[: self.first])


class RecordedOrder(Order):
    """Order that wraps another order and records its depths; the first strokes keep the depths given in ``first``.

    Together, the recorded depths of all tiles order the canvas's strokes as they were ordered during optimisation. The
    last ``passing`` strokes are below all others.
    """

    def __init__(self, order: Order, first: Tensor, passing: int) -> None:
        self.order, self.first, self.passing, self.last = order, first, passing, first

    def due(self, done: int, steps: int) -> bool:
        return self.order.due(done, steps)

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        self.last = self.order.depth(strokes, accuracy).clone()
        self.last[: len(self.first)] = self.first
        low, high = self.last.aminmax()
        self.last[len(strokes) - self.passing :] -= high - low + 1
        return self.last


def paint_tile(canvas: Canvas, tile: Tile, *before: object) -> float | None:
    """Paint a tile and store its strokes; ``before`` is only used to make Dask wait for the preceding tiles.

    Returns the peak memory of this process so far in MB, or None if the system does not report it.

    The strokes of painted neighbours stay fixed, like the ring of a partial update (thesis 2020, 6.3). Unpainted
    neighbours get temporary strokes, which are optimised and finally discarded, so that the tile is painted as if the
    painting continued there. Temporary strokes are below the tile's strokes, so that they do not help to cover the
    tile.
    """
    store, cfg = canvas.open()
    if store.is_painted(tile):
        return peak_memory()
    window = store.grid.window(tile)
    target = torch.from_numpy(store.read("target", window)).float() / 255
    cfg.seed += tile.row * store.grid.shape[1] + tile.column
    L.seed_everything(cfg.seed, verbose=False)
    weights, _ = compute_focus(cfg, target, faces_of(cfg, target))
    focus = border_weights(weights, store.grid.near_borders(tile, window, BORDER))
    laid = lay(store, tile, cfg, target, focus)
    parts = laid.ring, laid.own, laid.passing
    strokes = replace(Strokes.join(*parts), brush=torch.cat([part.brush for part in parts]))  # keep all brushes
    strokes = strokes.moved(shift=(-window.left, -window.top))
    painter, order = painter_of(cfg, target, strokes, focus, laid.depth, len(laid.passing))
    if painter.schedule.steps and len(laid.own):
        trainer = make_trainer(cfg, device_of(cfg.device), None, [], checkpoints=False, clips=False)
        conclude(painter, None, cfg, fit(trainer, painter), painter.schedule.step)
    painter.hand_over()
    strokes, _ = painter.finished_strokes()
    own = slice(len(laid.ring), len(laid.ring) + len(laid.own))
    done = strokes.map(Tensor.cpu)[own].moved(shift=(window.left, window.top))
    store.put_strokes(tile, done, order.last.cpu()[own])
    return peak_memory()


def border_weights(focus: Tensor | None, near: np.ndarray) -> Tensor | None:
    """Increase the weights of pixels near borders between tiles, so that more strokes are placed there.

    ``focus`` (h, w) contains the weights, or is None for equal weights; ``near`` (h, w) marks the pixels near borders.
    With equal weights, the error near borders was 1.07 times the error elsewhere, because each tile's strokes are
    placed without regard to the strokes of its neighbours.
    """
    if not near.any():
        return focus
    weight = torch.from_numpy(np.where(near, WEIGHT, 1.0)).float()
    weight = weight if focus is None else focus * weight
    return weight / weight.mean()


def painter_of(
    cfg: DictConfig, target: Tensor, strokes: Strokes, focus: Tensor | None, ring: Tensor, passing: int
) -> tuple[StrokeOptimizer, RecordedOrder]:
    """Make a painter that keeps the first R strokes fixed at the depths ``ring`` (R,); return it and its order.

    The last ``passing`` strokes are below all others.
    """
    parts, device = build_components(cfg), device_of(cfg.device)
    order = RecordedOrder(parts.order, ring.to(device), passing)
    parts = replace(parts, sampler=MoveAllButFirst(len(ring)), density=Fixed(), order=order)
    catalogue, background = Catalogue(strokes, parts.optimizer.units), background_color(cfg.background, target)
    about: dict[str, Any] = {"focus": focus, "clip": clip_of(cfg), "changes": build_changes(cfg)}
    painter = StrokeOptimizer(catalogue, parts, target, background, seed=cfg.seed, **about)
    return painter.to(device), order


def draw_tile(canvas: Canvas, tile: Tile, *before: object) -> None:
    """Draw a tile with lighting, after its neighbours have been painted, and store its pixels and errors."""
    store, cfg = canvas.open()
    if store.is_drawn(tile):
        return
    region = store.grid.region(tile)
    wide = region.widened(LIGHT_MARGIN, store.grid.size)
    job = job_of(store, cfg, wide)

    def put(name: str, picture: np.ndarray) -> np.ndarray:
        inner = Region(region.top - wide.top, region.left - wide.left, region.height, region.width)
        store.write(name, region, part := np.ascontiguousarray(picture[slices_of(inner)]))
        return part

    pixels = put("painting", job.picture().transpose(2, 0, 1))
    if HEIGHT in store.root:
        put(HEIGHT, grey_of(job.height() / (THICK * cfg.pixels_per_stroke**0.5)))
    near = store.grid.near_borders(tile, region, SEAM)
    store.put_squares(tile, errors_of(pixels, store.read("target", region), near))


def job_of(store: CanvasStore, cfg: DictConfig, region: Region) -> ExportJob:
    """Return a region as a painting of all strokes that reach into it, in pixels relative to the region's corner."""
    near = sorted({other for tile in store.grid.tiles_in(region) for other in (tile, *store.grid.around(tile))})
    strokes, depth = store.strokes_of(near)
    seen = mark_overlapping(strokes, region, LIGHT_MARGIN)
    renderer = build_stages(cfg)[-1].renderer
    compositor = Compositor(take_built(cfg.blend), take_built(cfg.color))
    job = bare_job(cfg, renderer, compositor, (region.height, region.width))
    background = background_color(cfg.background, torch.ones(3, 1, 1))
    strokes = strokes[seen].moved(shift=(-region.left, -region.top))
    return replace(job, saved=job.saved.with_strokes(strokes, front_to_back(depth[seen]), background))


def errors_of(pixels: np.ndarray, target: np.ndarray, near: np.ndarray) -> tuple[float, ...]:
    """Sum the squared errors between pictures (3, h, w), uint8, scaled to [0, 1]; return the sums listed in `SQUARES`.

    ``near`` (h, w), bool, marks the pixels near borders between tiles.
    """
    squares = np.square((pixels.astype(np.float64) - target) / 255).sum(0)
    return float(squares[near].sum()), 3 * int(near.sum()), float(squares.sum()), 3 * near.size
