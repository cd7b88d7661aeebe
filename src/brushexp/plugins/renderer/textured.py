"""Render bristle strokes with compiled kernels that look up textures along and across each stroke."""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Annotated, Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from brushexp.bounds import Bounds, between
from brushexp.compositing.layers import SPREAD
from brushexp.compositing.textured_profile import TexturedProfile
from brushexp.compositing.textures import TEXEL_ASPECT, Loop, Sheets, cap_of, coordinates_of, sheets_of, texel_distances
from brushexp.errors import UserError
from brushexp.plugins.engine.base import Simulated
from brushexp.plugins.renderer.base import RENDERERS, Renderer
from brushexp.registry import register
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.prior import width_parameter

LEVELS = 7  # number of sizes of a texture, for texels down to a 64th of a pixel; the first is the doubled texture
THIN = 0.5  # pixels; strokes thinner than about twice this become fainter instead
FADED, LIT = 0.003, 0.95  # margin of opacities, and largest tone, at which both can still be trained
SAMPLES = 4  # samples per texel in each direction when a texture is read from a picture
STRETCH = 0.9  # distance, in half-windows, from the middle to the ends of strokes that are read as textures
FULL = 0.98  # share of the painted texels that are no higher than a full film
LEVEL = 0.7  # height, in films, of paint without furrows, at a tone of 0
TONE = 0.2  # share of white in the palest bristle, of black in the darkest
HAIR_REACH = (1.15, 1.35)  # range of the ends of stray hairs, in half widths; a larger reach makes strokes slower
AROUND = 0.35  # half widths over which paint is compared with the surrounding paint
FINEST_STRENGTH = 1.2  # strength of a texture's finest detail when it is repeated at half its size
DETAIL_WINDOW = 9  # texels over which the strength of detail is measured
NODES = ((0.112702, 5 / 18), (0.5, 4 / 9), (0.887298, 5 / 18))  # nodes and weights of Gauss-Legendre quadrature


@register("renderer", "textured")
class Textured(Renderer):
    """Bezier stroke with the texture of a bristle brush, looked up along and across the curve.

    A stroke's brush determines which of several textures it has, and whether the texture is flipped. Textures do not
    stretch with the stroke: the lengths of the start and the end are proportional to the stroke's thickness, and longer
    strokes repeat the middle more often. A texture finer than the pixels is looked up at a smaller size, so that small
    strokes neither flicker nor have erratic gradients. A stroke thinner than a pixel is drawn fainter.

    The colour varies between bristles but includes no shading. Lighting is computed from the height of the finished
    paint, which is also stored in the textures (`shading`). During painting (with frozen weights), textures are
    rounded to 8 bits.

    Args:
        variants: number of different textures.
        rows: number of texels across the stroke, which extend ``SPREAD`` half-widths to either side of the curve.
        columns: number of texels along the stroke, including those beyond its ends; a texel is twice as long as it is
            wide.
        tone: contrast between paler and darker bristles, and depth of the furrows between them, relative to the
            textures.
        fullness: amount of paint on the brush, as the number of equal strokes that would have to lie on top of each
            other to cover as much; more paint closes the gaps between bristles.
        checkpoint: trained weights: a .safetensors file, or the name of a bundled one; null for
            random bristles.
    """

    def __init__(
        self,
        *,
        variants: Annotated[int, between(1, 256)] = 8,
        rows: Annotated[int, Bounds(16, 256, step=16)] = 96,
        columns: Annotated[int, Bounds(32, 1024, step=32)] = 256,
        tone: Annotated[float, between(0, 1)] = 1.0,
        fullness: Annotated[float, between(1, 16)] = 1.0,
        checkpoint: str | None = RENDERERS.shipped_name("textured"),
    ) -> None:
        super().__init__()
        if 2 * columns <= rows:
            cure = f"set renderer.columns={32 * (rows // 64 + 1)} or more"
            raise UserError(f"renderer.columns={columns} is too small for renderer.rows={rows}; {cure}")
        self.variants, self.tone, self.fullness = variants, tone, fullness
        self.loop = Loop(3 * columns // 8, 3 * columns // 8)
        self.textures = nn.Parameter(random_bristles(variants, rows, columns))
        self._ready: tuple[object, Sheets] | None = None
        self.restore(checkpoint, variants=variants, rows=rows, columns=columns)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_ready": None}  # ten times as large as the textures from which it is made

    def forward(self, strokes: Strokes) -> TexturedProfile:
        curve, half = curve_of(strokes), half_width_of(strokes)
        softened = (half.square() + THIN**2).sqrt()
        per_half = self.textures.shape[2] / SPREAD  # texels per half width at the finest size
        finer = (per_half / softened.detach()).clamp(1e-3, 1e9).log2().floor()
        variant, flip = strokes.brush % self.variants, 1 - 2 * (strokes.brush // self.variants % 2)
        look = variant * self.levels + finer.clamp(0, self.levels - 1).long()
        places = {"look": look, "repeats": self._repeats(curve.detach(), softened.detach()), "flip": flip}
        opacity = strokes.opacity * half / softened
        return TexturedProfile(curve, softened, strokes.color, opacity, sheets=self._sheets(), **places)

    @property
    def levels(self) -> int:
        """Return the number of texture sizes at which every piece of a texture has a whole number of columns."""
        return min(LEVELS, 1 + (self.loop.begin & -self.loop.begin).bit_length(), self.textures.shape[2].bit_length())

    def _repeats(self, curve: Tensor, half: Tensor) -> Tensor:
        """Compute how often (N,) to repeat the loop so that each stroke stretches its texels as little as possible."""
        start, control, end = curve.unbind(1)
        velocity = (2 * ((1 - t) * (control - start) + t * (end - control)) for t, _ in NODES)
        length = sum((w * v.norm(dim=1) for v, (_, w) in zip(velocity, NODES, strict=True)), torch.zeros_like(half))
        rows, columns = self.textures.shape[2:]
        along = length / half * (rows / (2 * SPREAD * TEXEL_ASPECT))  # columns that fit along the curve
        once = columns - 2 * cap_of(rows)
        return ((along - once) / self.loop.length + 1).round().clamp_min(0).long()

    @torch.no_grad()
    def distil(self, simulate: Callable[[Tensor, int], Simulated]) -> None:
        """Extract the textures from straight strokes, each painted with a different brush."""
        rows, columns = self.textures.shape[2:]
        long = columns + columns // 2
        width = STRETCH * rows / (2 * SPREAD * TEXEL_ASPECT) / (0.5 * long - cap_of(rows))  # in sides of the window
        parameters = torch.zeros(1, 10)
        parameters[:, 0], parameters[:, 4] = -STRETCH, STRETCH
        parameters[:, 6] = width_parameter(width)
        for variant in range(self.variants):
            stroke = simulate(parameters, variant)
            pictures = torch.stack([stroke.images[0, 3], stroke.heights[0]])
            texels = unroll_stroke(pictures, width, rows, long)
            self.textures[variant] = weights_of_texels(drop_middle(texels, columns, self.loop))

    def _sheets(self) -> Sheets:
        if self.training or (self.textures.requires_grad and torch.is_grad_enabled()):
            return _sheets_of(self.textures, self.tone, self.fullness, self.loop, self.levels, rounded=False)
        key = (self.textures._version, self.textures.data_ptr(), self.textures.device)
        if self._ready is None or self._ready[0] != key:
            kind = self.textures.shape, self.textures.dtype, self.textures.device
            values = self.textures.detach().cpu().contiguous().view(torch.uint8).numpy().tobytes()
            self._ready = (key, _round_sheets(values, *kind, self.tone, self.fullness, self.loop, self.levels))
        return self._ready[1]


@lru_cache(maxsize=2)  # painting, bitmaps and page each build a new renderer
def _round_sheets(
    values: bytes, shape: torch.Size, dtype: torch.dtype, device: torch.device, tone: float, fullness: float,
    loop: Loop, levels: int,
) -> Sheets:  # fmt: skip
    """Round frozen textures to 8 bits; the result is cached because this takes as long as a step."""
    with torch.inference_mode(False), torch.no_grad():
        textures = torch.frombuffer(bytearray(values), dtype=dtype).view(shape).to(device)
        return _sheets_of(textures, tone, fullness, loop, levels, rounded=True)


def _sheets_of(textures: Tensor, tone: float, fullness: float, loop: Loop, levels: int, *, rounded: bool) -> Sheets:
    """Create textures from their weights (V, 3, rows, columns) in all sizes, from double size downwards."""
    opacity, tones, height = textures.unbind(1)
    covering = opacity.sigmoid() if fullness == 1 else 1 - opacity.neg().sigmoid() ** fullness
    level = torch.full_like(height, LEVEL)
    values = torch.stack([covering, tone * tones.tanh(), level.lerp(height.sigmoid(), tone)], dim=1)
    finest = Loop(2 * loop.begin, 2 * loop.length)
    return sheets_of(double_textures(values, loop), levels, finest, rounded=rounded)


def unroll_stroke(pictures: Tensor, width: float, rows: int, columns: int) -> Tensor:
    """Sample texels (C, rows, columns) from pictures (C, S, S) of a straight stroke, ``width`` windows thick.

    The stroke extends from (-STRETCH, 0) to (STRETCH, 0), in half-windows.
    """
    across, t, before, beyond = (part[1:-1] for part in coordinates_of(rows, columns))
    x = STRETCH * (2 * t - 1) + width * (before + beyond)  # half-windows; half a stroke width is `width` half-windows
    within = (torch.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    x = (x[:, None] + within * torch.gradient(x)[0][:, None]).flatten()
    y = (width * (across[:, None] + within * (2 * SPREAD / rows))).flatten()
    places = torch.stack(torch.meshgrid(x, y, indexing="xy"), dim=-1)[None]
    return functional.avg_pool2d(functional.grid_sample(pictures[None], places, align_corners=False), SAMPLES)[0]


def drop_middle(texels: Tensor, columns: int, loop: Loop) -> Tensor:
    """Join a long stroke's beginning (C, rows, .) to its steady end, which contains the ``loop``."""
    result = close_loop(texels[..., -columns:], loop)
    part = torch.cat([torch.zeros(loop.begin // 2), torch.linspace(0, 1, loop.begin - loop.begin // 2)])
    result[..., : loop.begin] = torch.lerp(texels[..., : loop.begin], result[..., : loop.begin], part)
    return result


def close_loop(texels: Tensor, loop: Loop) -> Tensor:
    """Blend texels (..., columns) so that the ``loop`` repeats, and the end can follow the beginning, without a seam.

    The second half of the loop fades into the texels before the loop, and the texels after the loop begin like the
    loop. The beginning must be at least as long as half of the loop, and the end at least as long as the other half.
    """
    result, half = texels.clone(), loop.length // 2
    after = loop.begin + loop.length
    part = torch.linspace(0, 1, half + 1)[1:]
    result[..., after - half : after] = torch.lerp(
        texels[..., after - half : after], texels[..., loop.begin - half : loop.begin], part
    )
    ahead = min(half, (texels.shape[-1] - after) // 2)
    part = torch.linspace(0, 1, ahead + 1)[:-1]
    result[..., after : after + ahead] = torch.lerp(
        texels[..., loop.begin : loop.begin + ahead], texels[..., after : after + ahead], part
    )
    return result


def weights_of_texels(texels: Tensor) -> Tensor:
    """Convert coverage and height (2, rows, columns) to weights (3, rows, columns) of opacity, tone and height.

    The weights are the values before the renderer applies sigmoid, tanh and sigmoid to them, in this order.

    Bristles with more paint than their surroundings contain more pigment and are paler; other bristles are darker.
    """
    astray = texel_distances(*texels.shape[1:])[1:-1, 1:-1]
    coverage, height = texels.clamp_min(0) * ((HAIR_REACH[1] - astray) / (HAIR_REACH[1] - HAIR_REACH[0])).clamp(0, 1)
    films = (height / height[coverage > 0.5].quantile(FULL).clamp_min(1e-6)).clamp(0, 1)
    rows = height.shape[0]
    spread = 2 * round(0.5 * AROUND * rows / (2 * SPREAD)) + 1
    around, covered = (
        functional.avg_pool2d(part[None], (spread, spread), 1, spread // 2)[0] for part in (coverage * films, coverage)
    )
    tone = TONE * torch.tanh(4 * (films - around / covered.clamp_min(1e-3))) * (coverage > FADED)
    parts = (coverage.clamp(FADED, 1 - FADED).logit(), tone.clamp(-LIT, LIT).atanh())
    return torch.stack([*parts, films.clamp(FADED, 1 - FADED).logit()])


def double_textures(textures: Tensor, loop: Loop) -> Tensor:
    """Double the size of textures (V, 3, rows, columns) of opacity, tone and height, and add finer detail.

    A closer view of a brush shows finer hairs, which were not simulated. To imitate them, the finest detail in the
    middle of the loop is repeated at half its size and with the local strength. The average of the four texels that
    replace an old one is about the old value. Heights stay smooth, so that the slopes in a painting do not depend on
    the painting's size.
    """
    rows, columns = textures.shape[2:]
    larger = partial(functional.interpolate, scale_factor=2, mode="bilinear")
    with torch.no_grad():
        fine = textures - larger(functional.avg_pool2d(textures, 2))
        strength = functional.avg_pool2d(fine.square(), DETAIL_WINDOW, 1, DETAIL_WINDOW // 2).sqrt()
        own = fine / strength.clamp_min(1e-3)
        middle = own[:, :, rows // 4 : rows - rows // 4, loop.begin : loop.begin + loop.length]
        times = [-(-2 * side // piece) for side, piece in zip((rows, columns), middle.shape[2:], strict=True)]
        again = middle.tile(1, 1, *times)[:, :, : 2 * rows, : 2 * columns]
        detail = textures.new_tensor([FINEST_STRENGTH, FINEST_STRENGTH, 0.0]).view(3, 1, 1) * again * larger(strength)
    finer, low = larger(textures) + detail, textures.new_tensor([0.0, -1.0, 0.0]).view(3, 1, 1)
    finer = finer + larger(textures - functional.avg_pool2d(finer, 2))
    return finer.clamp(low, torch.ones_like(low))


def random_bristles(variants: int, rows: int, columns: int) -> Tensor:
    """Sample weights (variants, 3, rows, columns) of opacity, tone and height from a fixed seed.

    The weights are the values before sigmoid, tanh and sigmoid, in this order.
    """
    generator = torch.Generator().manual_seed(0)
    load, begin, finish = torch.randn(3, variants, rows, 1, generator=generator)
    waver = torch.randn(variants, rows, 8, generator=generator)  # variation along a bristle
    waver = functional.interpolate(waver, columns, mode="linear", align_corners=True)
    v, _, before, beyond = (part[1:-1] for part in coordinates_of(rows, columns))
    side = 14 * (1 + 0.05 * load - v.abs()[:, None])
    start = 9 * (before + 0.3 + 0.2 * begin)
    end = 14 * (0.2 + 0.1 * finish - beyond)
    full = 2.5 + 0.6 * (load + 0.7 * waver)
    opacity = torch.minimum(torch.minimum(side, start), torch.minimum(end, full)).clamp(-6, 6)
    textures = torch.stack([opacity, 0.1 * (load + waver), load + waver], dim=1)
    return close_loop(textures, Loop(3 * columns // 8, 3 * columns // 8))
