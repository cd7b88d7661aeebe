"""Paint one tile of a canvas, among the strokes of its neighbours that stay; and draw one, of all that reach it."""

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
from brushexp_canvases.laying import lay, reaching
from brushexp_canvases.pyramid import grey_of, slices_of
from brushexp_canvases.store import HEIGHT, CanvasStore

THICK = 0.25  # pitches of height that are white; thicker paint is white as well
SEAM = 4  # pixels on each side of a border between tiles whose errors are those of the seam
LIGHT_MARGIN = 2  # pixels around a part that its light depends on
BORDER, WEIGHT = 8, 1.2  # pixels along borders between tiles, and how much more than others they count


@dataclass(frozen=True)
class Canvas:
    """What workers know of a canvas: where it is, and the settings of the painting as plain data."""

    path: str
    settings: dict[str, Any]
    plugins: str  # folder of the user's

    def open(self) -> tuple[CanvasStore, DictConfig]:
        """Load the plugins, as a new process has to, and open the arrays and the config."""
        logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)  # else it reports its hardware for each tile
        load_plugins(Path(self.plugins), warns=False)
        use_threads(1)
        return CanvasStore(Path(self.path)), self.config

    @property
    def config(self) -> DictConfig:
        """The settings as they are read elsewhere."""
        return OmegaConf.create(self.settings)


class AllButFirst(Sampler):
    """Looks at the whole window, and moves all strokes but the ``first`` ones, which are drawn as they are."""

    cost, moves = "that of the whole window", "all but those of neighbours"

    def __init__(self, first: int) -> None:
        self.first = first

    def __call__(self, strokes: Strokes, size: tuple[int, int], step: int, generator: torch.Generator) -> View:
        numbers = torch.arange(len(strokes), device=strokes.position.device)
        return View(Region(0, 0, *size), numbers[self.first :], numbers[: self.first])


class Remembered(Order):
    """Orders strokes as another order does, and remembers by which numbers; the ``first`` strokes keep those they have.

    Numbers of all tiles together order the strokes of the canvas as the optimiser saw them. The ``passing`` last
    strokes lie below all others.
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
    """Paint a tile, and store its strokes; what tiles ``before`` it gave is waited for only.

    Returns the largest memory of this process so far in MB, None where the system does not tell.

    The strokes of the neighbours that are painted stay as they are, as the ring of a partial update does (thesis 2020,
    6.3). Where a neighbour is not painted yet, strokes are laid and optimised all the same, so that those of the tile
    end as if the painting went on, and are then thrown away. They lie below those of the tile, which they must not
    help to cover.
    """
    store, cfg = canvas.open()
    if store.is_painted(tile):
        return peak_memory()
    window = store.grid.window(tile)
    target = torch.from_numpy(store.read("target", window)).float() / 255
    cfg.seed += tile.row * store.grid.shape[1] + tile.column
    L.seed_everything(cfg.seed, verbose=False)
    weights, _ = compute_focus(cfg, target, faces_of(cfg, target))
    focus = evened(weights, store.grid.near_borders(tile, window, BORDER))
    laid = lay(store, tile, cfg, target, focus)
    parts = laid.ring, laid.own, laid.passing
    strokes = replace(Strokes.join(*parts), brush=torch.cat([part.brush for part in parts]))  # each keeps its own
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


def evened(focus: Tensor | None, near: np.ndarray) -> Tensor | None:
    """Let pixels ``near`` (h, w) borders between tiles count more than ``focus`` (h, w) or None says.

    So more strokes come to lie there. With as many as elsewhere the error was 1.07 times as large, as strokes of
    neighbours are laid without them.
    """
    if not near.any():
        return focus
    weight = torch.from_numpy(np.where(near, WEIGHT, 1.0)).float()
    weight = weight if focus is None else focus * weight
    return weight / weight.mean()


def painter_of(
    cfg: DictConfig, target: Tensor, strokes: Strokes, focus: Tensor | None, ring: Tensor, passing: int
) -> tuple[StrokeOptimizer, Remembered]:
    """Make a painter of strokes of which the first stay, at the depths of the ``ring`` (R,); and its order.

    The last ones, ``passing`` in number, lie below the others.
    """
    parts, device = build_components(cfg), device_of(cfg.device)
    order = Remembered(parts.order, ring.to(device), passing)
    parts = replace(parts, sampler=AllButFirst(len(ring)), density=Fixed(), order=order)
    catalogue, background = Catalogue(strokes, parts.optimizer.units), background_color(cfg.background, target)
    about: dict[str, Any] = {"focus": focus, "clip": clip_of(cfg), "changes": build_changes(cfg)}
    painter = StrokeOptimizer(catalogue, parts, target, background, seed=cfg.seed, **about)
    return painter.to(device), order


def draw_tile(canvas: Canvas, tile: Tile, *before: object) -> None:
    """Draw a tile of a canvas whose tiles around it are painted, with its light, and store it with its errors."""
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
    """Make the painting of a part of a canvas, from all strokes that reach it, in pixels from its corner."""
    near = sorted({other for tile in store.grid.tiles_in(region) for other in (tile, *store.grid.around(tile))})
    strokes, depth = store.strokes_of(near)
    seen = reaching(strokes, region, LIGHT_MARGIN)
    renderer = build_stages(cfg)[-1].renderer
    compositor = Compositor(take_built(cfg.blend), take_built(cfg.color))
    job = bare_job(cfg, renderer, compositor, (region.height, region.width))
    background = background_color(cfg.background, torch.ones(3, 1, 1))
    strokes = strokes[seen].moved(shift=(-region.left, -region.top))
    return replace(job, saved=job.saved.with_strokes(strokes, front_to_back(depth[seen]), background))


def errors_of(pixels: np.ndarray, target: np.ndarray, near: np.ndarray) -> tuple[float, ...]:
    """Sum squared errors of pictures (3, h, w) uint8, in [0, 1], as `SQUARES` names them; ``near`` (h, w) a border."""
    squares = np.square((pixels.astype(np.float64) - target) / 255).sum(0)
    return float(squares[near].sum()), 3 * int(near.sum()), float(squares.sum()), 3 * near.size
