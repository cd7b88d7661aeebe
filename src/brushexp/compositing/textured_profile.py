"""Strokes with textures in coordinates of their own, and the parts of their kernel.

The kernel brings the four texels around a place by two loads: eight bits each of opacity and of light. Its gradient
goes to the curve through both coordinates; the textures are taken as given.
"""
# mypy: allow-untyped-defs

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import torch
from torch import Tensor

from brushexp.compositing.frame import LEAST_SQUARE, SHORTEST_SQUARED, SLOWEST, SLOWEST_PIXELS, stroke_frame
from brushexp.compositing.layers import SPREAD, Encode, KernelInput, Layers, TileKernel
from brushexp.compositing.passes import CHANNELS, PULL, PULL_ALPHA
from brushexp.compositing.tile_lists import AREA, NEAREST, F
from brushexp.system.compiled import first_of, inline

I = np.int32  # noqa: E741
COLOR = 9  # column of the first channel; before it are control points, half width, opacity and texels per pixel
# Rows of a stroke in a tile: its place in the texture's cell, alpha, shade, and the corners of the cell as words.
X, Y, ALPHA, SHADE, OPACITIES, LIGHTS, ROWS = 2, 3, 4, 5, 6, 7, 8


@dataclass(frozen=True)
class TexturedProfile(Layers):
    """Strokes whose opacity and shade are looked up in small textures, in coordinates of the stroke.

    The rows of a texture go across the stroke; its columns are, in this order, the cap before the start, the body with
    t from 0 to 1, and the cap beyond the end. Rows and the columns of caps are ``2 * SPREAD / rows`` half widths apart,
    so that what juts out scales with the thickness and not with the length. Lookups are bilinear. Around all this lies
    a ring of texels, transparent like those next to it, so that a lookup outside may be clamped to it, with no slope.

    The second channel moves the colour: light > 0 mixes it with white, light < 0 with black, by |light|. So a colour
    stays a colour without being clamped.

    ``cells`` (M, rows + 1, rows + columns + 1, 2) int32 are for the compiled kernel, see `textures.cells_of`; there are
    none while textures are being trained.
    """

    per_stroke = ("curve", "half_width", "color", "opacity", "look")

    curve: Tensor
    half_width: Tensor  # (N,) pixels, > 0
    color: Tensor
    opacity: Tensor  # (N,)
    textures: Tensor  # (M, 2, rows + 2, rows + columns + 2) opacity in [0, 1] and light in [-1, 1]; rows is even
    extent: Tensor  # (M,) half widths beyond which a texture is transparent, at least 0
    look: Tensor  # (N,) int64, each stroke's texture
    cells: Tensor | None = None

    @property
    def reach(self) -> Tensor:  # type: ignore[override]
        return self.half_width * self.extent[self.look]

    @property
    def rows(self) -> int:
        """Rows of a texture without the ring around it, and columns of both caps together."""
        return self.textures.shape[2] - 2

    @property
    def columns(self) -> int:
        """Columns of the body."""
        return self.textures.shape[3] - 2 - self.rows

    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        half = self.half_width[index][..., None]  # (T, K, 1)
        t, along, across = stroke_frame(self.curve[index][:, :, None], points[:, None], half)  # (T, K, P)
        per_texel = 0.5 * self.rows / SPREAD / half
        x = 0.5 * self.rows + 0.5 + self.columns * t + per_texel * along  # texel j has its centre at j
        y = 0.5 * self.rows + 0.5 + per_texel * across
        opacity, light = _look_up(self.textures, self.look[index][..., None], x, y).unbind(-1)
        color = self.color[index][:, :, None] * (1 - light.abs())[..., None] + light.clamp_min(0)[..., None]
        return self.opacity[index][..., None] * opacity, color

    def encoded(self, encode: Encode) -> Self:
        return replace(self, color=encode(self.color))

    def compiled(self) -> KernelInput | None:
        if self.cells is None:
            return None
        texels = 0.5 * self.rows / SPREAD / self.half_width  # per pixel
        strokes = [self.curve.flatten(1), self.half_width.detach()[:, None], self.opacity[:, None]]
        strokes += [texels[:, None], self.color]
        _, rows, columns, _ = self.cells.shape
        begin, cells = self.look * (rows * columns), self.cells.reshape(-1).view(torch.int64)
        return KernelInput(KERNEL, torch.cat(strokes, dim=1), (begin, cells, rows - 1, columns - 1))


def _look_up(textures: Tensor, look: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Bilinear values (..., C) of textures (M, C, rows, columns) number ``look`` at columns x and rows y, all (...)."""
    _, channels, rows, columns = textures.shape
    texels = textures.to(x.dtype).movedim(1, -1).reshape(-1, channels)
    x, y = x.clamp(0, columns - 1), y.clamp(0, rows - 1)
    left, top = x.detach().floor().clamp_max(columns - 2), y.detach().floor().clamp_max(rows - 2)
    first = (look * rows + top.long()) * columns + left.long()
    right, down = (x - left)[..., None], (y - top)[..., None]
    above = torch.lerp(texels[first], texels[first + 1], right)
    below = torch.lerp(texels[first + columns], texels[first + columns + 1], right)
    return torch.lerp(above, below, down)


@inline
def _size(bx, by, fx, fy):
    """Squared size of a curve: of its velocity at both ends, halved."""
    return fx * fx + fy * fy + (fx + bx) * (fx + bx) + (fy + by) * (fy + by)


@inline
def _place(p, i, ox, oy, rows, columns, own):
    """Write rows X and Y: where in its texture the pixels of a tile find stroke ``i``, in texels."""
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    bx, by, fx, fy = sx - F(2) * cx + ex, sy - F(2) * cy + ey, cx - sx, cy - sy
    still = F(SLOWEST * SLOWEST) * _size(bx, by, fx, fy) + F(SLOWEST_PIXELS * SLOWEST_PIXELS)
    outer = F(-1) if fx * by - fy * bx > F(0) else F(1)
    body, scale, origin = F(columns - rows), p[i, 8], F(0.5) * F(rows) + F(0.5)
    for q in range(AREA):
        t = own[NEAREST * AREA + q]
        v = F(1) - t
        b0, b1, b2 = v * v, F(2) * t * v, t * t
        wx = F(q & 7) + F(0.5) - b0 * sx - b1 * cx - b2 * ex
        wy = F(q >> 3) + F(0.5) - b0 * sy - b1 * cy - b2 * ey
        dx, dy = fx + t * bx, fy + t * by
        speed, square = dx * dx + dy * dy, wx * wx + wy * wy
        moves = speed > still
        length = speed if moves else max(square, F(1e-30))
        tx, ty = (dx, dy) if moves else (outer * wy, -outer * wx)
        one = F(1) / np.sqrt(length)
        along = (tx * wx + ty * wy) * one
        along = F(0) if (t > F(0)) & (t < F(1)) else along
        across = (tx * wy - ty * wx) * one
        own[X * AREA + q] = min(max(origin + body * t + scale * along, F(0)), F(columns + 1))
        own[Y * AREA + q] = min(max(origin + scale * across, F(0)), F(rows + 1))


@inline
def _fetch(cells, first, columns, rows, own, at, opacity, light):
    """Write the corners (AREA,) around the places in rows X and Y, and leave the places within the cell there.

    ``cells`` are all textures as one line, opacity in the lower word and light in the upper one; this texture of
    ``rows`` x ``columns`` texels, without the ring, begins at ``first``. ``at`` is scratch (AREA,) int32.
    """
    for q in range(AREA):
        x, y = own[X * AREA + q], own[Y * AREA + q]
        column, row = min(I(x), I(columns)), min(I(y), I(rows))
        own[X * AREA + q] = x - F(column)
        own[Y * AREA + q] = y - F(row)
        at[q] = row * I(columns + 1) + column
    mine = cells[first : first + (rows + 1) * (columns + 1)]
    for q in range(AREA):  # apart from the arithmetic, which becomes SIMD code
        cell = mine[np.uint32(at[q])]
        opacity[q] = I(cell)
        light[q] = I(cell >> 32)


@inline
def _corner(word, k):
    return F((word >> I(8 * k)) & I(255))


@inline
def _mix(word, x, y):
    """Bilinear value between the four bytes of a word, and its slopes along x and y."""
    a, b, c, d = _corner(word, 0), _corner(word, 1), _corner(word, 2), _corner(word, 3)
    twist = a - b - c + d
    along_y = c - a + x * twist
    return a + x * (b - a) + y * along_y, b - a + y * twist, along_y


@inline
def _cover(p, i, data, ox, oy, own, temporary):
    begin, cells, rows, columns = data
    words = own.view(I)
    opacity, light = words[OPACITIES * AREA : (OPACITIES + 1) * AREA], words[LIGHTS * AREA : (LIGHTS + 1) * AREA]
    _place(p, i, ox, oy, rows, columns, own)
    _fetch(cells, begin[i], columns, rows, own, temporary.view(I), opacity, light)
    op, total = F(1 / 255) * p[i, 7], F(0)
    for q in range(AREA):
        x, y = own[X * AREA + q], own[Y * AREA + q]
        cover, _, _ = _mix(opacity[q], x, y)
        shade, _, _ = _mix(light[q], x, y)
        own[ALPHA * AREA + q] = op * cover
        own[SHADE * AREA + q] = F(1 / 127) * shade - F(128 / 127)
        total += cover
    return total > F(0)


@inline
def _tint(p, i):
    return first_of(p[i, COLOR:], CHANNELS)


@inline
def _shade(look, own, q):
    alpha, shade = own[ALPHA * AREA + q], own[SHADE * AREA + q]
    return alpha, alpha * (F(1) - abs(shade)), alpha * max(shade, F(0))


@inline
def _tone(look, seen, own, q, c):
    return seen[1] * look[c] + seen[2]


@inline
def _pull(p, i, data, ox, oy, own, temporary, buf, out):
    """Gradient of colour and opacity; that of the place in the texture replaces the place, for `_move`."""
    op, color = p[i, 7] * F(1 / 255), first_of(p[i, COLOR:], CHANNELS)
    words = own.view(I)
    opacity, light = words[OPACITIES * AREA : (OPACITIES + 1) * AREA], words[LIGHTS * AREA : (LIGHTS + 1) * AREA]
    for c in range(CHANNELS):
        total = F(0)
        for q in range(AREA):
            total += own[ALPHA * AREA + q] * (F(1) - abs(own[SHADE * AREA + q])) * buf[(PULL + c) * AREA + q]
        out[COLOR + c] = total
    of_opacity = F(0)
    for q in range(AREA):
        x, y, alpha, shade = own[X * AREA + q], own[Y * AREA + q], own[ALPHA * AREA + q], own[SHADE * AREA + q]
        cover, cover_x, cover_y = _mix(opacity[q], x, y)
        _, shade_x, shade_y = _mix(light[q], x, y)
        pure, white = F(1) - abs(shade), max(shade, F(0))
        plain, every = F(0), F(0)
        for c in range(CHANNELS):
            slope = buf[(PULL + c) * AREA + q]
            plain += color[c] * slope
            every += slope
        gs = F(1 / 127) * alpha * (every - plain if shade > F(0) else plain)
        ga = buf[PULL_ALPHA * AREA + q] + pure * plain + white * every
        of_opacity += ga * cover
        own[X * AREA + q] = ga * op * cover_x + gs * shade_x
        own[Y * AREA + q] = ga * op * cover_y + gs * shade_y
    out[7] = of_opacity * F(1 / 255)
    _move(p, i, ox, oy, F(data[3] - data[2]), own, out)


@inline
def _move(p, i, ox, oy, body, own, out):
    """Gradient of curve and size from that of the place in the texture, in rows X and Y."""
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    bx, by, fx, fy = sx - F(2) * cx + ex, sy - F(2) * cy + ey, cx - sx, cy - sy
    half, scale = p[i, 6], p[i, 8]
    size = _size(bx, by, fx, fy)
    still = F(SLOWEST * SLOWEST) * size + F(SLOWEST_PIXELS * SLOWEST_PIXELS)
    least = F(1) / np.sqrt(F(LEAST_SQUARE) * size + F(1e-30))
    short = F(LEAST_SQUARE) * size + F(SHORTEST_SQUARED) * half * half
    outer = F(-1) if fx * by - fy * bx > F(0) else F(1)
    g0, g1, g2, g3, g4, g5, g8 = F(0), F(0), F(0), F(0), F(0), F(0), F(0)
    for q in range(AREA):
        t, gx, gy = own[NEAREST * AREA + q], own[X * AREA + q], own[Y * AREA + q]
        v = F(1) - t
        b0, b1, b2 = v * v, F(2) * t * v, t * t
        wx = F(q & 7) + F(0.5) - b0 * sx - b1 * cx - b2 * ex
        wy = F(q >> 3) + F(0.5) - b0 * sy - b1 * cy - b2 * ey
        dx, dy = fx + t * bx, fy + t * by
        speed, square = dx * dx + dy * dy, wx * wx + wy * wy
        moves, beside = speed > still, (t > F(0)) & (t < F(1))
        one = F(1) / np.sqrt(speed if moves else max(square, F(1e-30)))
        tx, ty = (dx * one, dy * one) if moves else (outer * wy * one, -outer * wx * one)
        along, across = F(0) if beside else tx * wx + ty * wy, tx * wy - ty * wx
        g8 += gx * along + gy * across
        gu, gv = F(0) if beside else gx * scale, gy * scale
        gt = body * gx / max(F(2) * speed - wx * bx - wy * by, short)
        gt = gt if beside else F(0)
        turn = (gu * across - gv * along) * min(one, least)
        turn = turn if moves else F(0)
        ax, ay = gv * ty - gu * tx - gt * dx, -gv * tx - gu * ty - gt * dy  # to the point of the curve
        vx, vy = gt * wx - turn * ty, gt * wy + turn * tx  # to the velocity there
        g0 += b0 * ax - v * vx
        g1 += b0 * ay - v * vy
        g2 += b1 * ax + (v - t) * vx
        g3 += b1 * ay + (v - t) * vy
        g4 += b2 * ax + t * vx
        g5 += b2 * ay + t * vy
    out[0], out[1], out[2], out[3], out[4], out[5] = g0, g1, g2, g3, g4, g5
    out[6], out[8] = F(0), g8


KERNEL = TileKernel(rows=ROWS, cover=_cover, tint=_tint, shade=_shade, tone=_tone, pull=_pull)
