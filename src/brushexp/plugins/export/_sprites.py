"""Render a bitmap of every stroke and find its position on the canvas."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch

from brushexp.compositing.profile import Profile
from brushexp.plugins.export.base import ExportJob
from brushexp.registry import build_named
from brushexp.strokes.catalogue import Strokes

SHEET_WIDTH = 4096  # width of the sheet, pixels
GAP = 1  # pixels between bitmaps
MOST_PIXELS = 6e6  # number of pixels of the largest sheet, about 5 MB in an SVG
Array = np.ndarray


@dataclass(frozen=True)
class Sprites:
    """Bitmaps of a painting's visible strokes, side by side on a sheet, bottom stroke first."""

    sheet: Array  # (h, SHEET_WIDTH, 4) uint8: RGBA, straight alpha
    number: Array  # (N,) index of each stroke in the catalogue
    boxes: Array  # (N, 4) left, top, width and height in the sheet, in pixels
    places: Array  # (N, 2) left and top on the canvas, in pixels of the sheet
    zoom: float  # pixels of the sheet per pixel of the canvas

    def bitmaps(self, number: Array | None = None) -> Iterator[tuple[int, tuple[int, int], Array]]:
        """Yield the index, position and pixels (h, w, 4) of each visible stroke, or only those in ``number`` (n,)."""
        row = {stroke: k for k, stroke in enumerate(self.number.tolist())}
        for stroke in row if number is None else number.tolist():
            if stroke in row:
                left, top, width, height = self.boxes[row[stroke]].tolist()
                x, y = self.places[row[stroke]].tolist()
                yield stroke, (x, y), self.sheet[top : top + height, left : left + width]


def has_sprites(job: ExportJob) -> bool:
    """Check whether the strokes have textures and a fast renderer."""
    return job.renderer.warm_up is None and not isinstance(job.renderer(job.strokes[:0]), Profile)


@torch.no_grad()
def draw_sprites(job: ExportJob) -> Sprites:
    """Render every stroke once, side by side on a sheet, so that a single pass of a blend suffices.

    On black, the blend shows a stroke's contribution; on white, it also shows the light that the stroke transmits.
    Strokes are rendered at a smaller size if the sheet would exceed ``MOST_PIXELS``.
    """
    strokes = job.strokes
    boxes = _boxes(job, strokes)
    area, longest = float((boxes[:, 2:] + GAP).prod(1).sum()), float(boxes[:, 2:].max(initial=1))
    zoom = min(1.0, math.sqrt(0.8 * MOST_PIXELS / max(area, 1.0)), (SHEET_WIDTH - GAP) / longest)
    if zoom < 1:
        strokes = strokes.moved(zoom=zoom)
        boxes = _boxes(job, strokes)
        boxes[:, 2:] = np.minimum(boxes[:, 2:], SHEET_WIDTH - GAP)  # soft edges do not shrink
    corners, height = _lay_on_shelves(boxes[:, 2:] + GAP)
    shift = torch.from_numpy(corners - boxes[:, :2]).to(strokes.position)
    apart = replace(strokes, position=strokes.position + shift)
    spread = replace(job.saved, strokes=apart, size=(height, SHEET_WIDTH))
    blend, rgb = build_named("blend", "tiled", {}), build_named("color", "rgb", {})
    sheet = np.zeros((height, SHEET_WIDTH, 4), np.uint8)
    dark, bright = (
        ExportJob(replace(spread, background=torch.full_like(spread.background, shade)), job.renderer, blend, rgb)
        for shade in (0.0, 1.0)
    )
    for (top, black), (_, white) in zip(dark.bands(), bright.bands(), strict=True):
        alpha = 1 - (white - black).mean(0, keepdim=True)
        pixels = torch.cat([black / alpha.clamp_min(1e-6), alpha]).clamp_(0, 1).mul_(255).add_(0.5).to(torch.uint8)
        pixels *= pixels[3:] > 0
        sheet[top : top + black.shape[1]] = pixels.permute(1, 2, 0).cpu().numpy()
    places = np.concatenate([corners, boxes[:, 2:]], axis=1)
    paint = sheet[..., 3] > 0
    visible = np.array([paint[y : y + h, x : x + w].any() for x, y, w, h in places.tolist()], dtype=bool)
    number = job.bottom_up.cpu().numpy()
    number = number[visible[number]]
    return Sprites(sheet, number, places[number], boxes[number, :2], zoom)


def _boxes(job: ExportJob, strokes: Strokes) -> Array:
    """Compute each stroke's bounding box (N, 4: left, top, width, height), int64, empty for strokes off the canvas."""
    layers = job.renderer(strokes)
    curve, reach = layers.curve.cpu().numpy(), layers.reach.cpu().numpy()[:, None]
    low, high = np.floor(curve.min(1) - reach), np.ceil(curve.max(1) + reach)
    size = high - low
    far = np.array(job.size[::-1]) * (strokes.scale / job.strokes.scale.clamp_min(1e-9)).mean().item()
    outside = ((high <= 0) | (low >= far)).any(1) | (reach[:, 0] <= 0)
    size[outside] = 0
    return np.concatenate([low, size], axis=1).astype(np.int64)


def _lay_on_shelves(sizes: Array) -> tuple[Array, int]:
    """Pack boxes (N, 2: width, height) in rows, tallest first; return their corners (N, 2) and the total height."""
    corners, (left, top, row) = np.zeros_like(sizes), (0, 0, 0)
    for k in np.argsort(-sizes[:, 1], kind="stable"):
        width, height = sizes[k]
        if left + width > SHEET_WIDTH:
            left, top, row = 0, top + row, 0
        corners[k] = left, top
        left, row = left + width, max(row, height)
    return corners, max(1, int(top + row))
