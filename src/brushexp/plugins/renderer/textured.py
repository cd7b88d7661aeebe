"""Strokes with the look of a bristle brush: small textures along and across the stroke, drawn by compiled kernels."""

import math
from collections.abc import Callable
from typing import Annotated

import torch
from torch import Tensor, nn
from torch.nn import functional

from brushexp.bounds import Bounds, between
from brushexp.compositing.layers import SPREAD
from brushexp.compositing.textured_profile import TexturedProfile
from brushexp.compositing.textures import cells_of, coordinates_of, extent_of, smoothed, texel_distances
from brushexp.plugins.renderer.base import RENDERERS, Renderer
from brushexp.registry import register
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.prior import INSET, WIDTH

FINE = 3  # in painting, steps of thickness between two widths of the textures
BLURS = 4  # for texels down to an eighth of a pixel
THIN = 0.5  # pixels: strokes do not get thinner than about twice this, but fainter
LEAST_OPACITY = 5 / 255  # in painting, texels less opaque than this are left out: a stroke's reach is what it costs
DARKEST = 0.35  # share of black in the darkest texel: shade between bristles, not black where paint is too thin to tell
FADED, LIT = 0.003, 0.95  # opacities and light this near to their limits are kept off them, so that they can be trained
SAMPLES = 4  # of a texel in each direction, when it is read off a picture
BYTE = 255  # steps of opacity in painting; light has (BYTE - 1) / 2 to either side of 0


@register("renderer", "textured")
class Textured(Renderer):
    """Bezier stroke with the texture of a bristle brush, looked up along and across the curve.

    There are several textures: a stroke's number decides which variant it has, always the same one, and its thickness
    against its window between which two ``widths`` it lies. A texture that would be finer than the pixels is smoothed
    first, so that small strokes neither flicker nor have wild gradients. A stroke thinner than a pixel fades.

    In painting (frozen weights) textures are kept in 8 bits, and the thickness is rounded to one of a few: what is lost
    is less than can be seen, and the derivative of the texture with respect to the thickness.

    Args:
        variants: how many different brushes.
        widths: textures of a brush from the thinnest to the thickest stroke, evenly on a logarithmic scale.
        rows: texels across; even. They reach to ``SPREAD`` half widths on either side.
        columns: texels from the start of the curve to its end; the caps beyond have the size of the others across.
        checkpoint: trained weights: a .safetensors file, or the name of one that comes with the program; null for
            bristles drawn at random.
    """

    def __init__(
        self,
        *,
        variants: Annotated[int, between(1, 256)] = 8,
        widths: Annotated[int, between(1, 256)] = 4,
        rows: Annotated[int, Bounds(4, 256, step=2)] = 24,
        columns: Annotated[int, between(1, 256)] = 32,
        checkpoint: str | None = RENDERERS.shipped_name("textured"),
    ) -> None:
        super().__init__()
        self.variants, self.widths = variants, widths
        self.textures = nn.Parameter(bristles(variants, widths, rows, columns))
        room = texel_distances(rows, columns) < SPREAD - 2 * SPREAD / rows
        self.register_buffer("room", room.float(), persistent=False)
        self._ready: tuple[object, tuple[Tensor, Tensor, Tensor]] | None = None

    room: Tensor

    def forward(self, strokes: Strokes, number: Tensor | None = None) -> TexturedProfile:
        number = torch.arange(len(strokes), device=strokes.position.device) if number is None else number
        half = half_width_of(strokes)
        softened = (half.square() + THIN**2).sqrt()
        place = (strokes.width.clamp(*WIDTH) / WIDTH[0]).log() * ((self.widths - 1) / math.log(WIDTH[1] / WIDTH[0]))
        texel = 2 * SPREAD / (self.room.shape[0] - 2) * softened.detach()  # pixels
        blur = texel.clamp_min(1e-9).log2().neg().round().clamp(0, BLURS - 1).long()
        trained = self.training or (self.textures.requires_grad and torch.is_grad_enabled())
        choose = self._between if trained else self._nearest
        textures, extent, look, cells = choose(number % self.variants, place, blur)
        opacity = strokes.opacity * half / softened
        return TexturedProfile(curve_of(strokes), softened, strokes.color, opacity, textures, extent, look, cells)

    @torch.no_grad()
    def distil(self, simulate: Callable[[Tensor, int], Tensor]) -> None:
        """Read the textures off straight strokes: of each brush one as thick as each of the ``widths``."""
        place = torch.linspace(0, 1, self.widths) if self.widths > 1 else torch.full((1,), 0.5)
        thickness = WIDTH[0] * (WIDTH[1] / WIDTH[0]) ** place
        parameters = torch.zeros(self.widths, 10)
        parameters[:, 0], parameters[:, 4] = -INSET, INSET
        parameters[:, 6] = (2 * thickness - sum(WIDTH)) / (WIDTH[1] - WIDTH[0])
        for variant in range(self.variants):
            for k in range(self.widths):  # one by one, for the number decides the brush
                picture = simulate(parameters[k : k + 1], variant)[0]
                self.textures[variant, k] = unrolled(picture, float(thickness[k]), *self.textures.shape[3:])

    def _between(self, variant: Tensor, place: Tensor, blur: Tensor) -> tuple[Tensor, Tensor, Tensor, None]:
        """A texture for each stroke, differentiable in its thickness and in what is trained."""
        looks = self._looks()
        low = place.detach().floor().clamp(0, max(self.widths - 2, 0)).long()
        part = (place - low)[:, None, None, None].to(looks)
        high = (low + 1).clamp_max(self.widths - 1)
        textures = torch.lerp(looks[variant, low, blur], looks[variant, high, blur], part)
        count = torch.arange(len(variant), device=variant.device)
        return textures, extent_of(self.room[None]).to(place.dtype).expand(len(count)), count, None

    def _nearest(self, variant: Tensor, place: Tensor, blur: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """The textures for painting, and which of them each stroke has."""
        key = (self.textures._version, self.textures.data_ptr(), self.textures.device)
        if self._ready is None or self._ready[0] != key:
            with torch.inference_mode(False), torch.no_grad():
                self._ready = (key, self._prepare())
        textures, extent, cells = self._ready[1]
        level = (place.detach() * FINE).round().long()
        look = (variant * ((self.widths - 1) * FINE + 1) + level) * BLURS + blur
        return textures, extent.to(place.dtype), look, cells

    def _looks(self) -> Tensor:
        """(variants, widths, BLURS, 2, rows + 2, rows + columns + 2) as `TexturedProfile` has it."""
        raw = functional.pad(self.textures.flatten(0, 1), (1, 1, 1, 1), mode="replicate")
        opacity, light = raw.unflatten(0, (self.variants, self.widths)).unbind(2)
        opacity, light = opacity.sigmoid() * self.room, light.tanh() * torch.where(light > 0, 1.0, DARKEST)
        return torch.stack([smoothed(opacity, light, self.room, level) for level in range(BLURS)], dim=2)

    def _prepare(self) -> tuple[Tensor, Tensor, Tensor]:
        looks = self._looks()
        place = torch.arange((self.widths - 1) * FINE + 1, device=looks.device, dtype=looks.dtype) / FINE
        low = place.floor().clamp(0, max(self.widths - 2, 0)).long()
        part = (place - low)[:, None, None, None, None]
        looks = torch.lerp(looks[:, low], looks[:, (low + 1).clamp_max(self.widths - 1)], part).flatten(0, 2)
        opacity, light = looks.unbind(1)
        half = (BYTE - 1) // 2
        bytes_ = torch.stack([(opacity * (opacity >= LEAST_OPACITY) * BYTE).round(), (light * half).round()], dim=1)
        textures = bytes_ / torch.tensor([BYTE, half], device=looks.device)[:, None, None]
        return textures, extent_of(textures[:, 0]), cells_of(bytes_)


def unrolled(picture: Tensor, width: float, rows: int, length: int) -> Tensor:
    """The texture (2, rows, length), before sigmoid and tanh, of a straight grey stroke; caps are part of its length.

    ``picture`` (4, S, S) shows it from (-INSET, 0) to (INSET, 0) half-windows, ``width`` windows thick, in middle grey.
    """
    across, t, before, beyond = (part[1:-1] for part in coordinates_of(rows, length - rows))
    x = INSET * (2 * t - 1) + width * (before + beyond)  # half-windows; half a width is `width` of them
    within = (torch.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    step_x = torch.gradient(x)[0]
    x = (x[:, None] + within * step_x[:, None]).flatten()
    y = (width * (across[:, None] + within * (2 * SPREAD / rows))).flatten()
    places = torch.stack(torch.meshgrid(x, y, indexing="xy"), dim=-1)[None]
    seen = torch.cat([picture[:3].mean(0, keepdim=True) * picture[3:], picture[3:]])  # premultiplied grey, alpha
    fine = functional.grid_sample(seen[None], places, align_corners=False)
    grey, alpha = functional.avg_pool2d(fine, SAMPLES)[0]
    light = 2 * grey / alpha.clamp_min(1e-3) - 1
    light = torch.where(light > 0, light, light / DARKEST) * (alpha > LEAST_OPACITY)
    return torch.stack([alpha.clamp(FADED, 1 - FADED).logit(), light.clamp(-LIT, LIT).atanh()])


def bristles(variants: int, widths: int, rows: int, columns: int) -> Tensor:
    """Textures (variants, widths, 2, rows, rows + columns) of brushes drawn at random, the same ones every time.

    Before sigmoid (opacity) and tanh (light). The thicker the stroke, the more the bristles show.
    """
    generator = torch.Generator().manual_seed(0)
    load, begin, finish, ridge = torch.randn(4, variants, 1, rows, 1, generator=generator)
    waver = functional.interpolate(  # what changes along a bristle
        torch.randn(variants, rows, 8, generator=generator), rows + columns, mode="linear", align_corners=True
    )[:, None]
    v, t, before, beyond = (part[1:-1] for part in coordinates_of(rows, columns))
    thick = torch.linspace(0.3, 1, widths)[:, None, None]
    side = 14 * (0.95 + 0.1 * thick * load - v.abs()[:, None])
    start = 9 * (before + 0.1 + 0.3 * thick * begin) + 6 * t
    end = 14 * (0.1 + 0.2 * thick * finish - beyond) + 12 * (1 - t)
    full = 2.5 + thick * (load + 0.7 * waver)
    opacity = torch.minimum(torch.minimum(side, start), torch.minimum(end, full)).clamp(-6, 6)
    light = 0.15 * thick * (load + waver) + 0.5 * (thick * (ridge + 0.5 * waver) - 1.5).clamp_min(0)
    return torch.stack([opacity, light], dim=2)
