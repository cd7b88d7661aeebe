"""Strokes with textures that are defined in stroke coordinates, and the parts of their kernel.

The kernel fetches the four texels around a sampling position with one load: eight bits of opacity and eight bits of
tone each. The gradient reaches the curve through both coordinates; the textures are fixed.
"""
# mypy: allow-untyped-defs

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from brushexp.compat.compiled import first_of, inline
from brushexp.compositing.frame import LEAST_SQUARE, SHORTEST_SQUARED, SLOWEST, SLOWEST_PIXELS, stroke_frame
from brushexp.compositing.layers import SPREAD, Encode, KernelInput, Layers, TileKernel
from brushexp.compositing.passes import of_color
from brushexp.compositing.scratch import CHANNELS, PULL_ALPHA
from brushexp.compositing.texture_places import ONE, PLACES, X, Y, curve_size, place_in_texture, places_in_windows
from brushexp.compositing.textures import TEXEL_ASPECT, Sheets
from brushexp.compositing.tile_lists import AREA, CENTER_X, CENTER_Y, NEAREST, TILE, F
from brushexp.system.runtime import share

I = np.int32  # noqa: E741
COLOR = 9  # column of the first channel; control points, half width, opacity and texels per pixel come first
# Rows of a stroke in a tile: place in the texture's cell, alpha, shade, and the corners of the cell as words.
ALPHA, SHADE, OPACITIES, LIGHTS, ROWS = range(PLACES, PLACES + 5)


@dataclass(frozen=True)
class TexturedProfile(Layers):
    """Strokes whose opacity and tone are looked up in textures (`Sheets`) by stroke coordinates.

    The caps beyond the ends of a curve scale with its thickness. Along the curve, the beginning of the texture is
    followed by as many ``repeats`` of its loop as fit, and then by its end; over this whole length, the curve parameter
    t is linear in the texture column. A ``flip`` of -1 mirrors a texture. Lookups are bilinear.

    The tone changes the colour: a tone > 0 mixes it with white, a tone < 0 with black, in the proportion |tone|. The
    colour therefore stays in range without clamping.
    """

    per_stroke = ("curve", "half_width", "color", "opacity", "look", "repeats", "flip")

    curve: Tensor
    half_width: Tensor  # (N,) pixels, > 0
    color: Tensor
    opacity: Tensor  # (N,)
    look: Tensor  # (N,) int64, index of each stroke's texture
    repeats: Tensor  # (N,) int64, repeats of the loop, 0 or more
    flip: Tensor  # (N,) 1 or -1
    sheets: Sheets

    @property
    def reach(self) -> Tensor:  # type: ignore[override]
        return self.half_width * self.sheets.extent.to(self.half_width.dtype)[self.look]

    def frame(self) -> Tensor:
        """Compute the mapping (N, 8) of strokes to their textures, in texels of their sheets; texel j is centred at j.

        The columns are: the sheet's rows and columns, the texture column at the start of the curve, the number of
        texture columns along the curve, the column at which the loop begins, the length of the loop (1 if there is
        none), the number of repeats after the first, and the flip.
        """
        size, (begin, length) = self.sheets.size[self.look].double(), self.sheets.loop[self.look].double().unbind(1)
        cap, more = size[:, 0] / (2 * TEXEL_ASPECT), self.repeats - 1.0
        body = size[:, 1] - 2 * cap + length * more
        parts = (size[:, 0], size[:, 1], cap + 0.5, body, begin + 0.5, torch.where(length > 0, length, 1.0), more)
        return torch.stack([*parts, self.flip.double()], dim=1)

    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        half = self.half_width[index][..., None]  # (T, K, 1)
        t, along, across = stroke_frame(self.curve[index][:, :, None], points[:, None], half)  # (T, K, P)
        frame = self.frame()[index][:, :, None].to(t.dtype)
        rows, columns, origin, body, begin, length, more, flip = frame.unbind(-1)
        per_texel = 0.5 * rows / SPREAD / half
        x = origin + body * t + per_texel / TEXEL_ASPECT * along
        x = x - torch.where(x >= begin, length * torch.minimum(((x - begin) / length).detach().floor(), more), 0.0)
        y = 0.5 * rows + 0.5 + flip * per_texel * across
        opacity, tone = self._look_up(index[..., None], x, y, rows, columns).unbind(-1)
        color = self.color[index][:, :, None] * (1 - tone.abs())[..., None] + tone.clamp_min(0)[..., None]
        return self.opacity[index][..., None] * opacity, color

    def encoded(self, encode: Encode) -> Self:
        return replace(self, color=encode(self.color))

    def _look_up(self, index: Tensor, x: Tensor, y: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
        """Interpolate opacity and tone (..., 2) at columns x and rows y of the textures of the strokes ``index``."""
        texels, stride = self.sheets.texels[:, :2].to(x.dtype), columns.long() + 2
        x, y = torch.minimum(x.clamp_min(0), columns + 1), torch.minimum(y.clamp_min(0), rows + 1)
        left, top = torch.minimum(x.detach().floor(), columns), torch.minimum(y.detach().floor(), rows)
        first = self.sheets.first[self.look[index]] + top.long() * stride + left.long()
        right, down = (x - left)[..., None], (y - top)[..., None]
        above = torch.lerp(texels[first], texels[first + 1], right)
        below = torch.lerp(texels[first + stride], texels[first + stride + 1], right)
        return torch.lerp(above, below, down)

    def pictures(self, side: int) -> Tensor:
        """Draw each stroke by itself, with texture coordinates from compiled code where possible; used for training."""
        size, free = self.sheets.size[self.look], not (self.curve.requires_grad or self.half_width.requires_grad)
        if not free or side % TILE or self.curve.device.type != "cpu" or bool((size != size[:1]).any()):
            return super().pictures(side)
        frame = self.frame().float()
        scale = 0.5 * frame[:, 0] / SPREAD / self.half_width
        strokes = torch.zeros(len(frame), COLOR)
        strokes[:, :6], strokes[:, 6], strokes[:, 8] = self.curve.flatten(1), self.half_width, scale
        places = torch.empty(len(frame), side, side, 2)
        frame = with_reach(frame, torch.full_like(scale, torch.inf))
        share(places_in_windows, len(frame), strokes.detach().numpy(), frame.numpy(), places.numpy())
        height, width = (size[0] + 2).tolist() if len(size) else (2, 2)
        own = self.sheets.first[self.look][:, None] + torch.arange(height * width)
        texels = functional.embedding(own, self.sheets.texels[:, :2].float()).reshape(-1, height, width, 2)
        opacity, tone = functional.grid_sample(texels.movedim(-1, 1), places, align_corners=True).split(1, dim=1)
        color = self.color[:, :, None, None] * (1 - tone.abs()) + tone.clamp_min(0)
        return torch.cat([color, self.opacity[:, None, None, None] * opacity], dim=1)

    def compiled(self) -> KernelInput | None:
        if self.sheets.cells is None:
            return None
        frame = self.frame().float()
        texels = 0.5 * frame[:, 0] / SPREAD / self.half_width  # texels per pixel, across
        strokes = [self.curve.flatten(1), self.half_width.detach()[:, None], self.opacity[:, None]]
        strokes += [texels[:, None], self.color]
        data = (self.sheets.first[self.look], self.sheets.cells, with_reach(frame, self.reach))
        return KernelInput(KERNEL, torch.cat(strokes, dim=1), data)


def with_reach(frame: Tensor, reach: Tensor) -> Tensor:
    """Append the square of ``reach`` (N,), in pixels, to ``frame`` (N, 8); textures are not sampled beyond it."""
    return torch.cat([frame, reach.detach().float().square()[:, None]], dim=1)


@inline
def _fetch(cells, first, columns, rows, own, at, opacity, light):
    """Write the packed corners (AREA,) around the positions in rows X and Y; replace these by positions within a cell.

    ``cells`` holds the cells of all textures (`cells_of`). The current texture has ``rows`` x ``columns`` texels
    without its ring, and begins at ``first``. ``at`` is scratch memory (AREA,) int32.
    """
    for q in range(AREA):
        x, y = own[X * AREA + q], own[Y * AREA + q]
        column, row = min(I(x), I(columns)), min(I(y), I(rows))
        own[X * AREA + q] = x - F(column)
        own[Y * AREA + q] = y - F(row)
        at[q] = row * I(columns + 2) + column
    mine = cells[first : first + (rows + 2) * (columns + 2)]
    for q in range(AREA):  # separate from the arithmetic, which becomes SIMD code
        cell = mine[np.uint32(at[q])]
        opacity[q] = I(cell)
        light[q] = I(cell >> 32)


@inline
def _corner(word, k):
    return F((word >> I(8 * k)) & I(255))


@inline
def _mix(word, x, y):
    """Interpolate bilinearly between the four bytes of a word; also return the derivatives along x and y."""
    a, b, c, d = _corner(word, 0), _corner(word, 1), _corner(word, 2), _corner(word, 3)
    twist = a - b - c + d
    along_y = c - a + x * twist
    return a + x * (b - a) + y * along_y, b - a + y * twist, along_y


@inline
def _cover(p, i, data, ox, oy, own, temporary):
    begin, cells, frames = data
    frame = frames[i]
    words = own.view(I)
    opacity, light = words[OPACITIES * AREA : (OPACITIES + 1) * AREA], words[LIGHTS * AREA : (LIGHTS + 1) * AREA]
    place_in_texture(p, i, ox, oy, frame, own)
    _fetch(cells, begin[i], I(frame[1]), I(frame[0]), own, temporary.view(I), opacity, light)
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
    """Compute the gradients of colour, opacity and texture position; `_move` propagates the last of these to the curve.

    The gradient of the texture position overwrites the position in rows X and Y.
    """
    op, color = p[i, 7] * F(1 / 255), first_of(p[i, COLOR:], CHANNELS)
    words = own.view(I)
    opacity, light = words[OPACITIES * AREA : (OPACITIES + 1) * AREA], words[LIGHTS * AREA : (LIGHTS + 1) * AREA]
    for c in range(CHANNELS):
        total = F(0)
        for q in range(AREA):
            total += own[ALPHA * AREA + q] * (F(1) - abs(own[SHADE * AREA + q])) * of_color(own, buf, q, c)
        out[COLOR + c] = total
    of_opacity = F(0)
    for q in range(AREA):
        x, y, alpha, shade = own[X * AREA + q], own[Y * AREA + q], own[ALPHA * AREA + q], own[SHADE * AREA + q]
        cover, cover_x, cover_y = _mix(opacity[q], x, y)
        _, shade_x, shade_y = _mix(light[q], x, y)
        pure, white = F(1) - abs(shade), max(shade, F(0))
        plain, every = _of_colors(color, own, buf, q)
        gs = F(1 / 127) * alpha * (every - plain if shade > F(0) else plain)
        ga = buf[PULL_ALPHA * AREA + q] + pure * plain + white * every
        of_opacity += ga * cover
        own[X * AREA + q] = ga * op * cover_x + gs * shade_x
        own[Y * AREA + q] = ga * op * cover_y + gs * shade_y
    out[7] = of_opacity * F(1 / 255)
    _move(p, i, ox, oy, data[2][i, 3], data[2][i, 7], own, out)


@inline
def _of_colors(color, own, buf, q):
    """Compute the derivatives with respect to the proportions of stroke colour and of white at a pixel."""
    plain, every = F(0), F(0)
    for c in range(CHANNELS):
        slope = of_color(own, buf, q, c)
        plain += color[c] * slope
        every += slope
    return plain, every


@inline
def _move(p, i, ox, oy, body, flip, own, out):
    """Compute the gradients of the curve and its size from the gradient of the texture position in rows X and Y."""
    sx, sy, cx, cy, ex, ey = p[i, 0] - ox, p[i, 1] - oy, p[i, 2] - ox, p[i, 3] - oy, p[i, 4] - ox, p[i, 5] - oy
    bx, by, fx, fy = sx - F(2) * cx + ex, sy - F(2) * cy + ey, cx - sx, cy - sy
    half, scale = p[i, 6], p[i, 8]
    size = curve_size(bx, by, fx, fy)
    still = F(SLOWEST * SLOWEST) * size + F(SLOWEST_PIXELS * SLOWEST_PIXELS)
    least = F(1) / np.sqrt(F(LEAST_SQUARE) * size + F(1e-30))
    short = F(LEAST_SQUARE) * size + F(SHORTEST_SQUARED) * half * half
    outer = F(-1) if fx * by - fy * bx > F(0) else F(1)
    x0, x1, x2, y0, y1, y2, g8 = F(0), F(0), F(0), F(0), F(0), F(0), F(0)  # start, start to control, bend
    for q in range(AREA):
        t, gx, gy = own[NEAREST * AREA + q], own[X * AREA + q], flip * own[Y * AREA + q]
        wx, wy = CENTER_X[q] - sx - (fx + fx + bx * t) * t, CENTER_Y[q] - sy - (fy + fy + by * t) * t
        dx, dy = fx + t * bx, fy + t * by
        speed, one = dx * dx + dy * dy, own[ONE * AREA + q]
        moves, beside = speed > still, (t > F(0)) & (t < F(1))
        tx, ty = (dx * one, dy * one) if moves else (outer * wy * one, -outer * wx * one)
        along, across = F(0) if beside else tx * wx + ty * wy, tx * wy - ty * wx
        g8 += F(1 / TEXEL_ASPECT) * gx * along + gy * across
        gu, gv = F(0) if beside else F(1 / TEXEL_ASPECT) * gx * scale, gy * scale
        gt = body * gx / max(F(2) * speed - wx * bx - wy * by, short)
        gt = gt if beside else F(0)
        turn = (gu * across - gv * along) * min(one, least)
        turn = turn if moves else F(0)
        ax, ay = gv * ty - gu * tx - gt * dx, -gv * tx - gu * ty - gt * dy  # gradient of the point of the curve
        vx, vy = gt * wx - turn * ty, gt * wy + turn * tx  # gradient of the velocity there
        ux, uy = t * ax, t * ay
        x0 += ax
        x1 += F(2) * ux + vx
        x2 += t * (ux + vx)
        y0 += ay
        y1 += F(2) * uy + vy
        y2 += t * (uy + vy)
    out[0], out[2], out[4] = x0 - x1 + x2, x1 - F(2) * x2, x2
    out[1], out[3], out[5] = y0 - y1 + y2, y1 - F(2) * y2, y2
    out[6], out[8] = F(0), g8


KERNEL = TileKernel(rows=ROWS, cover=_cover, tint=_tint, shade=_shade, tone=_tone, pull=_pull)
