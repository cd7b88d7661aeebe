"""Strokes drawn in square windows, and the parts of their kernel.

The sides of a window are parallel to the pixel grid, so the texels and weights of a bilinear lookup are computed once
for each of the eight columns and eight rows of a tile. In the backward pass, a stroke stores two numbers for every
pixel of a tile: the light that reaches it and the derivative with respect to its alpha. These numbers are then gathered
from the stroke's tiles into the gradient of its image.
"""
# mypy: allow-untyped-defs

from dataclasses import dataclass, replace
from functools import cache
from typing import Self

import numpy as np
import torch
from torch import Tensor

from brushexp.compat.compiled import Compiled, function, inline
from brushexp.compositing.layers import Encode, KernelInput, Layers, TileKernel
from brushexp.compositing.scratch import CHANNELS, PULL_ALPHA
from brushexp.compositing.tile_lists import ABOVE, AREA, TILE, Array, F
from brushexp.system.runtime import share

ALMOST_NOTHING = 1e-6  # alpha below which a texel has no colour
ALPHA, PAINTED = 1, 2  # rows of a stroke in a tile: alpha and the channels times alpha, before opacity
AXES = 2 * 2 * TILE  # numbers of a lookup: for each pixel, the texels before and after it along x and y
TILE_PLACE, COLUMNS = 2 * AREA, 2 * AREA + 2  # numbers stored for a stroke; the place of the tile comes last


@dataclass(frozen=True)
class Windows(Layers):
    """Strokes drawn in square windows, which may be anywhere on the canvas and are sampled bilinearly.

    The centre of texel (row, column) in a window of side ``scale`` is at ``position`` + scale * ((column + 0.5) / S -
    0.5, ...). Beyond the outermost texel centres, the image fades to transparent within one texel.
    """

    per_stroke = ("images", "position", "scale", "opacity", "color")

    images: Tensor  # (N, C + 1, S, S) channels and alpha in [0, 1], straight alpha
    position: Tensor  # (N, 2) centres of the windows, pixels
    scale: Tensor  # (N,) sides of the windows, pixels, > 0
    opacity: Tensor  # (N,)
    color: Tensor  # (N, C) mean colour

    @property
    def curve(self) -> Tensor:  # type: ignore[override]
        """Return the horizontal centre line of each window."""
        half = torch.stack([0.5 * self.scale, torch.zeros_like(self.scale)], dim=-1)
        return torch.stack([self.position - half, self.position, self.position + half], dim=1)

    @property
    def reach(self) -> Tensor:  # type: ignore[override]
        """Return the distance from the centre line to the upper and lower edges of the window, plus half a texel."""
        return self.scale * (0.5 + 0.5 / self.images.shape[-1])

    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        side = self.images.shape[-1]
        place = (points[:, None] - self.position[index][:, :, None]) / self.scale[index][:, :, None, None]
        texel = (place + 0.5) * side - 0.5  # (T, K, P, 2); texel 0 has its centre at 0
        low = texel.detach().floor()
        fraction = texel - low
        alpha, painted = points.new_zeros(texel.shape[:-1]), points.new_zeros(*texel.shape[:-1], self.color.shape[1])
        for step in low.new_tensor([[0, 0], [1, 0], [0, 1], [1, 1]]):
            weight, at = torch.where(step > 0, fraction, 1 - fraction), low + step
            inside = ((at >= 0) & (at < side)).all(-1)
            x, y = at.clamp(0, side - 1).long().unbind(-1)
            texels = self.images[index[..., None], :, y, x]  # (T, K, P, C + 1)
            covered = weight[..., 0] * weight[..., 1] * inside * texels[..., -1]
            alpha = alpha + covered
            painted = painted + covered[..., None] * texels[..., :-1]  # premultiplied: empty texels have no colour
        color = painted / alpha.clamp_min(ALMOST_NOTHING)[..., None]
        return self.opacity[index][..., None] * alpha, color

    def pictures(self, side: int) -> Tensor:
        """Return the windows' own images if they have the given size; otherwise draw each stroke by itself."""
        return self.images if side == self.images.shape[-1] else super().pictures(side)

    def encoded(self, encode: Encode) -> Self:
        """Encode the colours of each texel."""
        color = encode(self.images[:, :3].movedim(1, -1)).movedim(-1, 1)
        return replace(self, images=torch.cat([color, self.images[:, 3:]], dim=1), color=encode(self.color))

    def compiled(self) -> KernelInput:
        places = torch.cat([self.position, self.scale[:, None], self.opacity[:, None]], dim=1)
        return KernelInput(KERNEL, places, (self.images.contiguous(),), learnt=1, boxes=self._boxes())

    @torch.no_grad()
    def _boxes(self) -> tuple[Tensor, Tensor]:
        """Compute the bounding box of the visible part of each window, as a line (N, 3, 2) and a half thickness (N,).

        As a consequence, no gradient reaches the fully transparent margin of an image or the network that drew it.
        """
        side = self.images.shape[-1]
        shows = self.images[:, -1] > 0
        lines = torch.stack([shows.any(1), shows.any(2)], dim=1).to(torch.uint8)  # (N, 2, S), along x and y
        low, high = lines.argmax(-1) - 1, side - lines.flip(-1).argmax(-1)  # a texel extends to its neighbours
        ends = torch.stack([low, high])
        ends = self.position + ((ends + 0.5) / side - 0.5) * self.scale[:, None]
        centre, half = ends.mean(0), 0.5 * (ends[1] - ends[0])
        reach = half.amin(1)
        line = half - reach[:, None]
        curve = torch.stack([centre - line, centre, centre + line], dim=1)
        return curve, torch.where(shows.flatten(1).any(1), reach, 0.0)


@inline
def _axis(centre, scale, side, origin, index, weight, inside):
    """Find the two texels between which each of eight pixels lies along one axis; the first pixel is at ``origin``.

    Writes arrays (16,): each texel's ``index`` and ``weight``, and ``inside``, which is 1 if the texel exists and 0 if
    not. The lower texels of the eight pixels come first, then the upper ones.
    """
    per_pixel = F(side) / scale
    for q in range(TILE):
        t = (F(q) + F(0.5) + origin - centre) * per_pixel + F(0.5) * F(side) - F(0.5)
        t = min(max(t, F(-2)), F(side))
        low = int(np.floor(t))
        f = t - F(low)
        inside[q] = F(1) if 0 <= low < side else F(0)
        inside[TILE + q] = F(1) if 0 <= low + 1 < side else F(0)
        weight[q], weight[TILE + q] = inside[q] * (F(1) - f), inside[TILE + q] * f
        index[q], index[TILE + q] = min(max(low, 0), side - 1), min(max(low + 1, 0), side - 1)


@inline
def _axes(p, i, side, ox, oy, index, weight, inside):
    """Find the texels along x and y as `_axis` does; write arrays (AXES,), in which x comes before y."""
    half = 2 * TILE
    _axis(p[i, 0], p[i, 2], side, ox, index[:half], weight[:half], inside[:half])
    _axis(p[i, 1], p[i, 2], side, oy, index[half:], weight[half:], inside[half:])


@inline
def _cover(p, i, data, ox, oy, own, temporary):
    (images,) = data
    index, weight, inside = temporary[2 * AXES :].view(np.int32), temporary[:AXES], temporary[AXES : 2 * AXES]
    _axes(p, i, images.shape[-1], ox, oy, index, weight, inside)
    image, total = images[i], F(0)
    for y in range(TILE):
        for x in range(TILE):
            q, alpha = y * TILE + x, F(0)
            for c in range(CHANNELS):
                own[(PAINTED + c) * AREA + q] = F(0)
            for k in range(4):
                at_x, at_y = (k & 1) * TILE + x, (2 + (k >> 1)) * TILE + y
                row, column = index[at_y], index[at_x]
                covered = weight[at_y] * weight[at_x] * image[CHANNELS, row, column]
                alpha += covered
                for c in range(CHANNELS):
                    own[(PAINTED + c) * AREA + q] += covered * image[c, row, column]
            own[ALPHA * AREA + q] = alpha
            total += alpha
    return total > F(0)


@inline
def _tint(p, i):
    return p[i, 3]


@inline
def _shade(opacity, own, q):
    return (opacity * own[ALPHA * AREA + q],)


@inline
def _tone(opacity, seen, own, q, c):
    return opacity * own[(PAINTED + c) * AREA + q]


@inline
def _pull(p, i, data, ox, oy, own, temporary, buf, out):
    for q in range(AREA):
        out[q] = own[ABOVE * AREA + q]
        out[AREA + q] = buf[PULL_ALPHA * AREA + q]
    out[TILE_PLACE], out[TILE_PLACE + 1] = ox, oy


def _gather(
    left: Array, there: Array, row: Array, order: Array, grad_image: Array, places: Array, data: tuple[Array, ...]
) -> tuple[Array, Array]:
    """Compute the gradients of ``places`` (N, 4) and of the images (N, C + 1, S, S)."""
    gradients = np.zeros_like(places), np.zeros_like(data[0])
    share(_gather_kernel(len(grad_image)), len(order), places, *data, order, row, there, left, grad_image, *gradients)
    return gradients


@cache
def _gather_kernel(channels: int) -> Compiled:
    return _over_strokes.with_parts(CHANNELS=channels)


@function
def _over_strokes(begin, end, places, images, order, row, there, left, grad_image, grad_places, grad_images):
    """Using the values that `_pull` stored in ``left``, sum the gradients of a range of strokes in a fixed order.

    ``places`` (N, 4) holds the centre (x, y), side and opacity for each of the ``images`` (N, C + 1, S, S). Writes
    ``grad_places`` and ``grad_images``, which have the same shapes and are initially 0.
    """
    side = images.shape[-1]
    for s in range(begin, end):
        i = order[s]
        index, weight, inside = np.empty(AXES, np.int32), np.empty(AXES, F), np.empty(AXES, F)
        per_pixel, total = F(side) / places[i, 2], np.zeros(4, np.float64)
        for j in range(row[s], row[s + 1]):
            if not there[j]:
                continue
            given = left[j]
            x0, y0 = int(given[TILE_PLACE]), int(given[TILE_PLACE + 1])
            _axes(places, i, side, F(x0), F(y0), index, weight, inside)
            for y in range(min(TILE, grad_image.shape[1] - y0)):
                for x in range(min(TILE, grad_image.shape[2] - x0)):
                    along_x, along_y, of_opacity = _scatter(
                        images[i], places[i, 3], given, grad_image, y0, x0, y, x, index, weight, inside, grad_images[i]
                    )
                    total[0] -= along_x
                    total[1] -= along_y
                    total[2] -= along_x * (F(x + x0) + F(0.5) - places[i, 0])
                    total[2] -= along_y * (F(y + y0) + F(0.5) - places[i, 1])
                    total[3] += of_opacity
        grad_places[i, 0] = total[0] * per_pixel
        grad_places[i, 1] = total[1] * per_pixel
        grad_places[i, 2] = total[2] * per_pixel / places[i, 2]
        grad_places[i, 3] = total[3]


@inline
def _scatter(image, opacity, given, grad_image, top, left, y, x, index, weight, inside, out):
    """Add a pixel's gradient to the four texels of ``out`` (C + 1, S, S) that it samples.

    Returns the derivatives with respect to the pixel's position, in texels along x and y, and to the opacity.
    """
    light, of_alpha = given[y * TILE + x], given[AREA + y * TILE + x]
    along_x, along_y, of_opacity = F(0), F(0), F(0)
    for k in range(4):
        at_x, at_y = (k & 1) * TILE + x, (2 + (k >> 1)) * TILE + y
        row, column = index[at_y], index[at_x]
        wy, wx = weight[at_y], weight[at_x]
        alpha, slope, total = image[CHANNELS, row, column], of_alpha, wy * wx * opacity
        for c in range(CHANNELS):
            of_color = light * grad_image[c, top + y, left + x]
            slope += of_color * image[c, row, column]
            out[c, row, column] += total * alpha * of_color
        out[CHANNELS, row, column] += total * slope
        value = alpha * slope
        of_opacity += wy * wx * value
        along_x += (value if k & 1 else -value) * inside[at_x] * wy
        along_y += (value if k >> 1 else -value) * inside[at_y] * wx
    return opacity * along_x, opacity * along_y, of_opacity


KERNEL = TileKernel(
    rows=PAINTED, rows_per_channel=1, cover=_cover, tint=_tint, shade=_shade, tone=_tone, pull=_pull,
    temporary=2, curved=False, columns=COLUMNS, gather=_gather,
)  # fmt: skip
