"""One canvas of windows (`Patches`) as the compiled kernels see it: numpy in, numpy out."""

from dataclasses import dataclass, field

import numpy as np
import torch

from brushexp.compositing import window_kernels
from brushexp.compositing.nearest import AREA
from brushexp.compositing.profile_scene import NO_TARGET, F, sums_by_stroke
from brushexp.compositing.tile_lists import Array, TileLists, build_lists
from brushexp.plugins.renderer.base import Patches


@dataclass
class PatchScene:
    """Settings and lists of one pass; `paint` leaves behind what `gradient` needs.

    Attributes:
        lists: tile lists of the strokes in ``order``.
        size: (H, W).
        background: (3,).
        opaque: fraction of light below which a tile is finished.
        order: (N,) indices of the strokes, the uppermost first.
        used: (tiles,) how much of each list was looked at; set by `paint`.
        errors: (N, 2) sums of alpha |color - target|^2 and of alpha; set by `paint` if it is given a target.
    """

    lists: TileLists
    size: tuple[int, int]
    background: Array
    opaque: float
    order: Array
    used: Array = field(init=False)
    errors: Array = field(init=False)

    def paint(self, places: Array, images: Array, target: Array | None, *, keep: bool) -> Array:
        """Picture (3, H, W) of images (N, 4, S, S) at places (N, 4): centre x and y, side, opacity."""
        lists = self.lists
        self.used = np.zeros(len(lists.first) - 1, np.int64)
        image = np.empty((3, *self.size), F)
        pairs = np.zeros((0 if target is None else len(lists.stroke), 2), F)
        window_kernels.forward(
            places, images, self.order, lists.first, lists.stroke, lists.slot, lists.shape[1], self.background,
            F(self.opaque), NO_TARGET if target is None else target, image, self.used, pairs,
        )  # fmt: skip
        if target is not None:
            self.errors = sums_by_stroke(lists, self.order, pairs)
        return image

    def gradient(self, places: Array, images: Array, grad_image: Array) -> tuple[Array, Array]:
        """Gradients of places and images from the gradient (3, H, W) of the picture."""
        lists = self.lists
        begin = np.cumsum(self.used) - self.used
        left = np.empty((int(self.used.sum()), window_kernels.LEFT, AREA), F)
        tile, at = np.empty(len(lists.stroke), np.int32), np.empty(len(lists.stroke), np.int64)
        window_kernels.over_tiles(
            places, images, self.order, lists.first, lists.stroke, lists.slot, lists.shape[1], self.background,
            self.used, begin, grad_image, left, tile, at,
        )  # fmt: skip
        grad_places, grad_images = np.zeros_like(places), np.zeros_like(images)
        window_kernels.over_strokes(
            places, images, self.order, lists.row, lists.shape[1], tile, at, left, grad_image, grad_places, grad_images
        )
        return grad_places, grad_images


def scene_of(layers: Patches, size: tuple[int, int], background: Array, opaque: float, order: Array) -> PatchScene:
    """The scene of these layers, with lists of the boxes around what they show."""
    curve, reach = _boxes_of(layers)
    return PatchScene(build_lists(curve[order], reach[order], size, boxes_only=True), size, background, opaque, order)


@torch.no_grad()
def _boxes_of(layers: Patches) -> tuple[Array, Array]:
    """The box around what each window shows, as a line (N, 6) and a half thickness (N,), as `build_lists` wants it.

    Where a picture is exactly transparent its alpha has no gradient: whatever made it so has none either.
    """
    side = layers.images.shape[-1]
    shows = layers.images[:, 3] > 0
    low, high = [], []
    for axis in (1, 2):  # over the rows for x, over the columns for y
        line = shows.any(axis).to(torch.uint8)
        low.append(line.argmax(1) - 1)  # texels; each is felt as far as the next one
        high.append(side - line.flip(1).argmax(1))
    ends = torch.stack([torch.stack(low, 1), torch.stack(high, 1)])  # (2, N, 2)
    ends = layers.position + ((ends + 0.5) / side - 0.5) * layers.scale[:, None]
    centre, half = ends.mean(0), 0.5 * (ends[1] - ends[0])
    reach = half.amin(1)
    line = half - reach[:, None]
    curve = torch.stack([centre - line, centre, centre + line], dim=1).reshape(-1, 6)
    return curve.numpy(), torch.where(shows.flatten(1).any(1), reach, 0.0).numpy()
