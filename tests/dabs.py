"""An example of a plugin renderer, which draws soft discs with its own layers and its own kernel."""

from dataclasses import dataclass

import torch
from torch import Tensor

from brushexp.compat.compiled import first_of, inline
from brushexp.compositing.layers import KernelInput, Layers, TileKernel
from brushexp.compositing.passes import of_color
from brushexp.compositing.scratch import CHANNELS, PULL_ALPHA
from brushexp.compositing.tile_lists import AREA, F
from brushexp.plugins.renderer.base import Renderer
from brushexp.strokes.bezier import half_width_of
from brushexp.strokes.catalogue import Strokes

COVER = 1  # row of the coverage of a stroke in a tile


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
        columns = [self.position, self.radius[:, None], self.opacity[:, None], self.color]
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
    return p[i, 3], first_of(p[i, 4:], CHANNELS)


@inline
def shade(look, own, q):
    return (look[0] * own[COVER * AREA + q] * own[COVER * AREA + q],)


@inline
def tone(look, seen, own, q, c):
    return seen[0] * look[1][c]


@inline
def pull(p, i, data, ox, oy, own, temporary, buf, out):
    r, opacity, color = p[i, 2], p[i, 3], first_of(p[i, 4:], CHANNELS)
    out[:] = F(0)
    for q in range(AREA):
        x, y, k = ox + F(q & 7) + F(0.5) - p[i, 0], oy + F(q >> 3) + F(0.5) - p[i, 1], own[COVER * AREA + q]
        of_alpha = buf[PULL_ALPHA * AREA + q]
        for c in range(CHANNELS):
            of_alpha += color[c] * of_color(own, buf, q, c)
            out[4 + c] += opacity * k * k * of_color(own, buf, q, c)
        of_square = F(2) * opacity * k * of_alpha / (r * r)  # with respect to -(x^2 + y^2); 0 outside the disc
        out[0] += F(2) * x * of_square
        out[1] += F(2) * y * of_square
        out[2] += F(2) * (x * x + y * y) / r * of_square
        out[3] += k * k * of_alpha


KERNEL = TileKernel(rows=2, cover=cover, tint=tint, shade=shade, tone=tone, pull=pull, curved=False)


class DabRenderer(Renderer):
    """Draws each stroke as a soft disc as wide as the stroke, at least 1 px in diameter."""

    def forward(self, strokes: Strokes) -> Dabs:
        return Dabs(strokes.position, half_width_of(strokes).clamp_min(0.5), strokes.color, strokes.opacity)
