"""A renderer as a plugin may have it: soft discs, with layers of their own kind and their own kernel."""

from dataclasses import dataclass

import torch
from torch import Tensor

from brushexp.compositing.layers import KernelInput, Layers, TileKernel
from brushexp.compositing.passes import PULL_ALPHA, PULL_BLUE, PULL_GREEN, PULL_RED
from brushexp.compositing.tile_lists import AREA, F
from brushexp.plugins.renderer.base import Renderer
from brushexp.strokes.bezier import half_width_of
from brushexp.strokes.catalogue import Strokes
from brushexp.system.compiled import inline

COVER = 1  # row of a stroke in a tile


@dataclass(frozen=True)
class Dabs(Layers):
    """Soft discs: alpha = opacity * k^2 with k = max(0, 1 - (d / radius)^2)."""

    per_stroke = ("position", "radius", "color", "opacity")

    position: Tensor
    radius: Tensor
    color: Tensor
    opacity: Tensor

    @property
    def curve(self) -> Tensor:
        return self.position[:, None].expand(-1, 3, -1)

    @property
    def reach(self) -> Tensor:
        return self.radius

    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        square = (points[:, None] - self.position[index][:, :, None]).square().sum(-1)
        k = (1 - square / self.radius[index][..., None].square()).clamp_min(0)
        return self.opacity[index][..., None] * k.square(), self.color[index][:, :, None]

    def compiled(self) -> KernelInput:
        columns = [self.position, self.radius[:, None], self.color, self.opacity[:, None]]
        return KernelInput(KERNEL, torch.cat(columns, dim=1))


@inline
def cover(p, i, data, ox, oy, own, temporary):
    per_square = F(1) / (p[i, 2] * p[i, 2])
    for q in range(AREA):
        x, y = ox + F(q & 7) + F(0.5) - p[i, 0], oy + F(q >> 3) + F(0.5) - p[i, 1]
        own[COVER * AREA + q] = max(F(1) - (x * x + y * y) * per_square, F(0))
    return True


@inline
def tint(p, i):
    return p[i, 3], p[i, 4], p[i, 5], p[i, 6]


@inline
def shade(look, own, q):
    red, green, blue, opacity = look
    alpha = opacity * own[COVER * AREA + q] * own[COVER * AREA + q]
    return alpha, alpha * red, alpha * green, alpha * blue


@inline
def pull(p, i, data, ox, oy, own, temporary, buf, out):
    r, red, green, blue, opacity = p[i, 2], p[i, 3], p[i, 4], p[i, 5], p[i, 6]
    out[:] = F(0)
    for q in range(AREA):
        x, y, k = ox + F(q & 7) + F(0.5) - p[i, 0], oy + F(q >> 3) + F(0.5) - p[i, 1], own[COVER * AREA + q]
        gr, gg, gb = buf[PULL_RED * AREA + q], buf[PULL_GREEN * AREA + q], buf[PULL_BLUE * AREA + q]
        of_alpha = buf[PULL_ALPHA * AREA + q] + red * gr + green * gg + blue * gb
        of_square = F(2) * opacity * k * of_alpha / (r * r)  # with respect to -(x^2 + y^2), and 0 outside
        out[0] += F(2) * x * of_square
        out[1] += F(2) * y * of_square
        out[2] += F(2) * (x * x + y * y) / r * of_square
        out[3] += opacity * k * k * gr
        out[4] += opacity * k * k * gg
        out[5] += opacity * k * k * gb
        out[6] += k * k * of_alpha


KERNEL = TileKernel(columns=7, rows=2, cover=cover, tint=tint, shade=shade, pull=pull, curved=False)


class DabRenderer(Renderer):
    """Soft discs as wide as strokes."""

    def forward(self, strokes: Strokes, number: Tensor | None = None) -> Dabs:
        return Dabs(strokes.position, half_width_of(strokes).clamp_min(0.5), strokes.color, strokes.opacity)
