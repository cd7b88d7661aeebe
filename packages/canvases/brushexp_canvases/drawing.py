"""Draw parts of a canvas from its strokes, and measure their errors."""

from dataclasses import replace

import numpy as np
import torch
from omegaconf import DictConfig

from brushexp.painting.components import build_stages
from brushexp.painting.finished import bare_job
from brushexp.pictures.load import background_color
from brushexp.pictures.region import Region
from brushexp.plugins.blend.base import Compositor
from brushexp.plugins.export.job import ExportJob
from brushexp.plugins.order.base import front_to_back
from brushexp.registry import take_built
from brushexp_canvases.grid import Tile
from brushexp_canvases.laying import reaching
from brushexp_canvases.pyramid import grey_of, slices_of
from brushexp_canvases.store import HEIGHT, CanvasStore
from brushexp_canvases.tile import Canvas

THICK = 0.25  # pitches of height that are white; thicker paint is white as well
SEAM = 4  # pixels on each side of a border between tiles whose errors are those of the seam
EDGE = 2  # pixels around a part that its light depends on


def draw_tile(canvas: Canvas, tile: Tile, *before: object) -> None:
    """Draw a tile of a canvas whose tiles around it are painted, with its light, and store it with its errors."""
    store, cfg = canvas.open()
    if store.is_drawn(tile):
        return
    region = store.grid.region(tile)
    wide = region.widened(EDGE, store.grid.size)
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
    seen = reaching(strokes, region, EDGE)
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
