"""What every renderer receives and returns.

A renderer says what each stroke covers (`Layers`); a blend decides which pixels to ask and puts the answers together.
Two kinds: a profile renderer describes a stroke by its look in its own coordinates and is evaluated only where the
stroke is (`Profile`); a patch renderer draws the window of each stroke and samples it bilinearly.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import ClassVar, Self

import torch
from torch import Tensor, nn
from torch.utils.checkpoint import checkpoint

from brushexp.plugins.engine.base import Engine
from brushexp.plugins.renderer._frame import stroke_frame
from brushexp.strokes.bezier import closest_parameter, point_at
from brushexp.strokes.catalogue import Strokes, drawable
from brushexp.strokes.prior import clamp_to_prior, parameters_of, rewindow, strokes_of

FAINT = 2 / 255  # in painting, what a network draws is nothing where its alpha is below this
ALMOST_NOTHING = 1e-6  # alpha below which the colour of a texel no longer counts
SPREAD = 1.5  # half widths that a texture reaches to either side of the curve, and beyond its ends
EDGE = 2.0  # pixels that a soft edge may add to a stroke
TEXELS = 2**26  # of windows that are held at once when no gradient is needed: 1 GB
CHUNK = 128  # strokes that a network draws at once: enough to keep the cores busy


class Precision(Enum):
    """In what numbers a network computes in painting: 32 bits, or 16 where that is known to be harmless (autocast).

    The weights and the pictures that come out have 32 bits either way.
    """

    float32 = "float32"
    bfloat16 = "bfloat16"


class Layers(ABC):
    """N strokes that know what they cover.

    Attributes:
        curve: (N, 3, 2) control points in pixels; all of a stroke lies within ``reach`` of its curve.
        reach: (N,) pixels beyond which its alpha is exactly 0; 0 or less for a stroke that is nowhere.
        color: (N, 3) mean colour.
        per_stroke: names of the fields that have a row for each stroke.
    """

    curve: Tensor
    reach: Tensor
    color: Tensor
    per_stroke: ClassVar[tuple[str, ...]]

    def joined(self, other: Self) -> Self:
        """These strokes, and then those of ``other``, which the same renderer drew."""
        rows = {name: torch.cat([getattr(self, name), getattr(other, name)]) for name in self.per_stroke}
        return replace(self, **rows)  # type: ignore[type-var]

    @abstractmethod
    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        """Ask strokes ``index`` (T, K) at ``points`` (T, P, 2), differentiable in the stroke parameters.

        Returns:
            alpha (T, K, P) in [0, 1] and color (T, K, P, 3), or (T, K, 1, 3) where it is constant.
        """


class Renderer(nn.Module, ABC):
    """Turns stroke parameters into layers.

    Attributes:
        warm_up: name of the renderer that had better take most of the steps of a painting, because this one is slow;
            None if it is not.
        weights_hash: of the trained weights, see `renderer.checkpoint`; "" without any.
        at_once: strokes whose layers should be held at once at most; None if they are small.
    """

    warm_up: str | None = None
    weights_hash: str = ""
    at_once: int | None = None

    def __call__(self, strokes: Strokes, number: Tensor | None = None) -> Layers:
        """As `forward`; strokes of 16 bits are drawn in float32, see `drawable`."""
        layers: Layers = super().__call__(drawable(strokes), number)
        return layers

    @abstractmethod
    def forward(self, strokes: Strokes, number: Tensor | None = None) -> Layers:
        """Layers on the canvas that ``strokes`` are measured on; differentiable in every field.

        Args:
            strokes: N strokes.
            number: (N,) int64, which stroke each one is; None means 0 to N - 1. A renderer with several looks chooses
                by it, so that a stroke keeps its look wherever it stands in a batch.
        """

    def clamp(self, strokes: Strokes) -> Strokes:
        """The nearest strokes that this renderer can draw; the painter applies it after every step."""
        return strokes

    def distil(self, simulator: Callable[[], Engine], seed: int) -> None:
        """Take over what can be read directly off strokes of a simulator; called once, before training.

        Args:
            simulator: makes it, with windows large enough to see details.
            seed: that of the strokes which the renderer is then trained on.
        """

    def convert(self, strokes: Strokes) -> Strokes:
        """Strokes that another renderer painted with, as this one draws them best; applied once, before the steps."""
        return self.clamp(strokes)

    def rows(self, strokes: Strokes) -> Tensor | None:
        """Rows (N, 2), first and last, in pixels, that each stroke may touch; None if that is not worth knowing.

        A picture that is too large for one piece is drawn in bands of rows, each with these strokes only.
        """
        return None


class PatchRenderer(Renderer):
    """Draws the window of every stroke with a network: (n, 10) -> (n, 4, S, S).

    What a subclass has to say is `draw`; placing the windows, memory and the valid range are dealt with here.

    Attributes:
        window: S, pixels on the side of the pictures that `draw` makes.
        precision: of `draw` in painting.
    """

    warm_up = "textured"
    window: int
    precision: Precision = Precision.float32

    @abstractmethod
    def draw(self, parameters: Tensor) -> Tensor:
        """Pictures (n, 4, S, S) of strokes (n, 10) as `strokes.prior.parameters_of` writes them.

        Returns:
            RGBA in [0, 1], straight alpha, opaque where there is paint: the opacity of a stroke is applied later.
        """

    def forward(self, strokes: Strokes, number: Tensor | None = None) -> "Patches":
        """Layers of the windows; parameters outside the range of training are brought to its edge first."""
        parameters = parameters_of(clamp_to_prior(strokes))
        weight = next(self.parameters(), parameters)
        parts = parameters.to(weight.dtype).split(CHUNK)
        if not len(strokes):
            images = parameters.new_zeros(0, 4, self.window, self.window)
        elif self.training:
            images = torch.cat([self.draw(part) for part in parts])
        elif not torch.is_grad_enabled():
            images = torch.cat([self._clean(part) for part in parts])
        else:  # the pictures are kept, the activations of the network are computed again in the backward pass
            images = torch.cat([checkpoint(self._clean, part, use_reentrant=False) for part in parts])
        images = images.to(parameters.dtype)
        return Patches(images, strokes.position, strokes.scale, strokes.opacity, strokes.color)

    def _clean(self, parameters: Tensor) -> Tensor:
        """What `draw` makes without its faintest traces: a network leaves some everywhere, and each costs time."""
        with torch.autocast(parameters.device.type, torch.bfloat16, enabled=self.precision is Precision.bfloat16):
            pictures = self.draw(parameters)
        color, alpha = pictures.to(parameters.dtype).split([3, 1], dim=1)
        return torch.cat([color, torch.where(alpha < FAINT, 0.0, alpha)], dim=1)

    @property
    def at_once(self) -> int:  # type: ignore[override]
        return TEXELS // self.window**2

    def clamp(self, strokes: Strokes) -> Strokes:
        return clamp_to_prior(strokes)

    def convert(self, strokes: Strokes) -> Strokes:
        return self.clamp(rewindow(strokes))

    def rows(self, strokes: Strokes) -> Tensor:
        reach = strokes.scale * (0.5 + 0.5 / self.window)
        return torch.stack([strokes.position[:, 1] - reach, strokes.position[:, 1] + reach], dim=1)


@dataclass(frozen=True)
class Profile(Layers):
    """Strokes of one colour each, with round ends and a soft edge; what the compiled kernels draw.

    alpha = opacity * C(d), where d is the distance to the curve, h = half_width * (1 - taper * (2t - 1)^2) the half
    thickness at the nearest parameter t, and C(d) = S(h + d) + S(h - d) - 1 with the smooth step S of width ``soft``:
    the box of half width h smoothed by S, so that a line thinner than the edge fades instead of disappearing.

    Attributes:
        half_width: (N,) pixels.
        opacity: (N,).
        soft: width of the edge, pixels, > 0.
        taper: how much thinner the ends are, 0 (not) to 1 (pointed).
    """

    per_stroke = ("curve", "half_width", "color", "opacity")

    curve: Tensor
    half_width: Tensor
    color: Tensor
    opacity: Tensor
    soft: float
    taper: float

    @property
    def reach(self) -> Tensor:  # type: ignore[override]
        return self.half_width + 0.5 * self.soft

    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        curve = self.curve[index][:, :, None]  # (T, K, 1, 3, 2)
        points = points[:, None]  # (T, 1, P, 2)
        t = closest_parameter(curve, points)  # (T, K, P)
        if not self.taper:
            t = t.detach()  # t is where the distance is least: to first order it does not matter
        offset = (point_at(curve, t) - points).square().sum(-1)
        distance = (offset + 1e-12 * (offset == 0)).sqrt()  # the slope at 0 is 0, not 0/0
        half = self.half_width[index][..., None] * (1 - self.taper * (2 * t - 1) ** 2)
        coverage = smooth_rise((half + distance) / self.soft) + smooth_rise((half - distance) / self.soft)
        coverage = coverage.clamp_min(0)  # rounding may leave less
        return self.opacity[index][..., None] * coverage, self.color[index][:, :, None]


@dataclass(frozen=True)
class TexturedProfile(Layers):
    """Strokes whose opacity and shade are looked up in small textures, in coordinates of the stroke.

    The rows of a texture go across the stroke; its columns are, in this order, the cap before the start, the body with
    t from 0 to 1, and the cap beyond the end. Rows and the columns of caps are ``2 * SPREAD / rows`` half widths apart,
    so that what juts out scales with the thickness and not with the length. Lookups are bilinear. Around all this lies
    a ring of texels, transparent like those next to it, so that a lookup outside may be clamped to it, with no slope.

    The second channel moves the colour: light > 0 mixes it with white, light < 0 with black, by |light|. So a colour
    stays a colour without being clamped.

    Attributes:
        half_width: (N,) pixels, > 0.
        opacity: (N,).
        textures: (M, 2, rows + 2, rows + columns + 2) opacity in [0, 1] and light in [-1, 1]; rows is even.
        extent: (M,) half widths beyond which a texture is transparent, at least 0.
        look: (N,) int64, each stroke's texture.
        cells: (M, rows + 1, rows + columns + 1, 2) int32 for the compiled kernel, see ``cells_of``; None if there are
            none because the textures are being trained.
    """

    per_stroke = ("curve", "half_width", "color", "opacity", "look")

    curve: Tensor
    half_width: Tensor
    color: Tensor
    opacity: Tensor
    textures: Tensor
    extent: Tensor
    look: Tensor
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


@dataclass(frozen=True)
class Patches(Layers):
    """Strokes that were drawn in square windows, each placed anywhere on the canvas and sampled bilinearly.

    Texel (row, column) of a window of side ``scale`` lies at ``position`` + scale * ((column + 0.5) / S - 0.5, ...);
    beyond the outermost texel centres the picture fades to nothing within one texel.

    Attributes:
        images: (N, 4, S, S) RGBA in [0, 1], straight alpha.
        position: (N, 2) centres of the windows, pixels.
        scale: (N,) their sides, pixels, > 0.
        opacity: (N,).
        color: (N, 3) mean colour.
    """

    per_stroke = ("images", "position", "scale", "opacity", "color")

    images: Tensor
    position: Tensor
    scale: Tensor
    opacity: Tensor
    color: Tensor

    @property
    def curve(self) -> Tensor:  # type: ignore[override]
        """(N, 3, 2) the horizontal middle line of each window."""
        half = torch.stack([0.5 * self.scale, torch.zeros_like(self.scale)], dim=-1)
        return torch.stack([self.position - half, self.position, self.position + half], dim=1)

    @property
    def reach(self) -> Tensor:  # type: ignore[override]
        """(N,) all of a window, and the texel around it, lies this near to its middle line."""
        return self.scale * (0.5 + 0.5 / self.images.shape[-1])

    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        side = self.images.shape[-1]
        place = (points[:, None] - self.position[index][:, :, None]) / self.scale[index][
            :, :, None, None
        ]  # (T, K, P, 2)
        texel = (place + 0.5) * side - 0.5  # texel 0 has its centre at 0
        low = texel.detach().floor()
        fraction = texel - low
        alpha, painted = points.new_zeros(texel.shape[:-1]), points.new_zeros(*texel.shape[:-1], 3)
        for dy in (0, 1):
            for dx in (0, 1):
                x, y = low[..., 0].long() + dx, low[..., 1].long() + dy
                inside = (x >= 0) & (x < side) & (y >= 0) & (y < side)
                weight = (fraction[..., 0] if dx else 1 - fraction[..., 0]) * (
                    fraction[..., 1] if dy else 1 - fraction[..., 1]
                )
                rgba = self.images[index[..., None], :, y.clamp(0, side - 1), x.clamp(0, side - 1)]  # (T, K, P, 4)
                covered = weight * inside * rgba[..., 3]
                alpha = alpha + covered
                painted = painted + covered[..., None] * rgba[..., :3]  # premultiplied: an empty texel has no colour
        color = painted / alpha.clamp_min(ALMOST_NOTHING)[..., None]
        return self.opacity[index][..., None] * alpha, color


def window_pictures(renderer: Renderer, parameters: Tensor, side: int, number: Tensor | None = None) -> Tensor:
    """What any renderer makes of strokes alone in their windows: (n, 10) -> (n, 4, side, side), RGBA, straight alpha.

    This is what renderers are trained on and compared by. Parameters are as `strokes.prior.parameters_of` writes them.
    """
    strokes = strokes_of(parameters)
    strokes = replace(strokes, position=strokes.position + 0.5 * side, scale=torch.full_like(strokes.scale, side))
    layers = renderer(strokes, number)
    if isinstance(layers, Patches) and layers.images.shape[-1] == side:
        return layers.images
    pixel = torch.arange(side).to(parameters) + 0.5
    points = torch.stack(torch.meshgrid(pixel, pixel, indexing="xy"), dim=-1).reshape(1, -1, 2)
    index = torch.arange(len(parameters), device=parameters.device)[:, None]
    alpha, color = layers.sample(index, points.expand(len(parameters), -1, -1))  # (n, 1, P), (n, 1, P or 1, 3)
    rgba = torch.cat([color.expand(*alpha.shape, 3), alpha[..., None]], dim=-1)
    return rgba.reshape(len(parameters), side, side, 4).movedim(-1, 1)


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


def smooth_rise(x: Tensor) -> Tensor:
    """Cubic step from -1/2 (x <= -1/2) to 1/2 (x >= 1/2); odd to the bit, so that its sum at x and -x is exactly 0."""
    z = x.clamp(-0.5, 0.5)
    return z * (1.5 - 2 * z * z)
