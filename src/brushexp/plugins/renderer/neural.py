"""The thesis's neural renderer: ten numbers in, the picture of a stroke out."""

from collections.abc import Callable
from enum import Enum
from typing import Annotated

import torch
from torch import Tensor, nn
from torch.nn import functional

from brushexp.bounds import between, one_of
from brushexp.errors import UserError
from brushexp.plugins.renderer._fields import PLANES, stroke_planes
from brushexp.plugins.renderer.base import PatchRenderer, Precision
from brushexp.plugins.renderer.weights_file import RENDERERS
from brushexp.registry import register

COARSEST = 4  # pixels on the side of the picture that the dense layers make
CONVOLUTIONS = 3  # at each size
GROUPS = 8  # of group normalisation
LAST_GAIN = 0.1  # of the last convolution at first, so that tanh is not saturated from the start
EMPTY = -1.5  # where alpha starts: most of a window is empty, and a start at 1/2 overshoots into a tanh without slope
NOISE_SEED = 2020  # of the noise that is the same for every stroke in painting


class Coordinates(Enum):
    """What convolutions know about where they are: nothing, x and y in the window, or the place on the stroke."""

    none = "none"
    window = "window"
    stroke = "stroke"


class Activation(Enum):
    """What follows every layer but the last."""

    relu = "relu"
    leaky_relu = "leaky_relu"
    elu = "elu"
    gelu = "gelu"
    silu = "silu"


class Normalisation(Enum):
    """What precedes the activation of a convolution: nothing, or over the batch, groups of channels, each channel."""

    none = "none"
    batch = "batch"
    group = "group"
    instance = "instance"


class Upsampling(Enum):
    """How a picture becomes twice as large."""

    nearest = "nearest"
    bilinear = "bilinear"
    pixel_shuffle = "pixel_shuffle"


ACTIVATIONS: dict[Activation, Callable[[Tensor], Tensor]] = {
    Activation.relu: functional.relu,
    Activation.leaky_relu: lambda x: functional.leaky_relu(x, 0.2),
    Activation.elu: functional.elu,
    Activation.gelu: functional.gelu,
    Activation.silu: functional.silu,
}
NORMALISATIONS: dict[Normalisation, Callable[[int], nn.Module]] = {
    Normalisation.none: lambda channels: nn.Identity(),
    Normalisation.batch: nn.BatchNorm2d,
    Normalisation.group: lambda channels: nn.GroupNorm(min(GROUPS, channels), channels),
    Normalisation.instance: lambda channels: nn.GroupNorm(channels, channels),
}


@register("renderer", "neural")
class Neural(PatchRenderer):
    """Inverse VGG: dense layers, then upsampling and three convolutions at each size; trained on simulated strokes.

    Source: thesis 2020, 6.2; its own size is the preset `neural_thesis`. Differs from the source in the default size:
    the last convolution draws squares of ``subpixel`` pixels (Shi et al., 2016, arXiv:1609.05158), because on a
    processor most of the time would otherwise go to a few channels at full size; in being told where the stroke is
    (``coordconv``); and in not drawing its colour (``tint``).

    Args:
        window: side of the picture in pixels: 64, 128 or 256.
        width: channels at the finest size; twice as many at each coarser one.
        widest: most channels of a size.
        dense: widths of the dense layers before the one that makes the coarsest picture.
        subpixel: side of the squares that the last convolution draws at once: 1 (the source), 2 or 4.
        coordconv: coordinates that are told to the network. window: x and y, as two more channels of every convolution
            (Liu et al., 2018, arXiv:1807.03247); stroke: along and across the stroke, at the first convolution of each
            size (see `_fields`), so that the network only has to learn what paint looks like, not where a curve goes.
        tint: add the stroke's colour to what the network draws, which then only has to learn the light on it.
        noise: add noise to every convolution, of a strength learned per channel (Karras et al., 2019,
            arXiv:1812.04948); fresh in training, in painting the same for every stroke.
        activation: after every layer but the last.
        normalisation: in every convolution but the last.
        upsampling: between the sizes; pixel_shuffle learns it.
        channels: widths of all layers but the last, as task=prune leaves them: of the dense ones, of the coarsest
            picture, and of every convolution. null: those of the checkpoint, else as width, widest and dense say.
        precision: of the network in painting. bfloat16 is faster on processors that have it (AVX-512 BF16, AMX) and
            on GPUs; training has its own.
        checkpoint: trained weights: a .safetensors file, or the name of one that comes with the program; null for
            random weights, to be trained.
    """

    def __init__(
        self,
        *,
        window: Annotated[int, one_of(64, 128, 256)] = 64,
        width: Annotated[int, between(1, 4096)] = 32,
        widest: Annotated[int, between(1, 4096)] = 96,
        dense: Annotated[list[int], between(1, 65536)] = [256, 256],  # noqa: B006
        subpixel: Annotated[int, one_of(1, 2, 4)] = 2,
        coordconv: Coordinates = Coordinates.stroke,
        tint: bool = True,
        noise: bool = False,
        activation: Activation = Activation.relu,
        normalisation: Normalisation = Normalisation.none,
        upsampling: Upsampling = Upsampling.nearest,
        channels: list[int] | None = None,
        precision: Precision = Precision.float32,
        checkpoint: str | None = RENDERERS.shipped_name("neural"),
    ) -> None:
        super().__init__()
        if channels is None and checkpoint is not None:
            channels = RENDERERS.read_recipe(RENDERERS.path_of(checkpoint))["options"].get("channels")
        if not dense:
            raise UserError("renderer.dense=[] has no width; try 'renderer.dense=[256,256]'")
        self.window = window
        self.precision = precision
        self.subpixel = subpixel
        self.activate = ACTIVATIONS[activation]
        self.coordconv, self.tint = coordconv, tint
        sides = [COARSEST * 2**k for k in range((window // subpixel // COARSEST).bit_length())]
        by_size = [min(width * sides[-1] // side, widest) for side in sides]
        widths = [*dense, by_size[0], *(after for after in by_size[1:] for _ in range(CONVOLUTIONS))]
        if channels is not None:
            widths = _checked(channels, len(widths))
        known, seen = widths[: len(dense)], widths[len(dense) :]
        self.dense = nn.ModuleList(nn.Linear(a, b) for a, b in zip([10, *known], known, strict=False))
        self.first = Coarsest(known[-1], seen[0])
        self.growing = nn.ModuleList(_Enlarge(before, upsampling) for before in seen[:-1:CONVOLUTIONS])
        self.convolving = nn.ModuleList()
        for i, side in enumerate(sides[1:]):
            finest = side == sides[-1]
            planes = {Coordinates.none: 0, Coordinates.window: 2, Coordinates.stroke: PLANES}[coordconv]
            if coordconv is Coordinates.stroke and finest:
                planes *= subpixel**2
            for k in range(CONVOLUTIONS):
                told = planes if k == 0 or coordconv is Coordinates.window else 0
                before, after = seen[i * CONVOLUTIONS + k : i * CONVOLUTIONS + k + 2]
                self.convolving.append(_Layer(before, after, side, told, noise, normalisation))
        self.last = nn.Conv2d(seen[-1], 4 * subpixel**2, 3, padding=1)
        self.apply(_initialise)
        with torch.no_grad():
            self.last.weight.mul_(LAST_GAIN)
            assert self.last.bias is not None
            self.last.bias[3 * subpixel**2 :] = EMPTY  # pixel_shuffle takes a channel's squares one after another
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # a fifth faster on a processor

    def draw(self, parameters: Tensor) -> Tensor:
        seen = parameters
        for layer in self.dense:
            seen = self.activate(layer(seen))
        x = self.activate(self.first(seen))
        for k, layer in enumerate(self.convolving):
            if k % CONVOLUTIONS == 0:
                x = self.growing[k // CONVOLUTIONS](x)
                planes = self._planes(parameters, x.shape[-1])
            x = self.activate(layer(x, planes))
        x = functional.pixel_shuffle(self.last(x), self.subpixel).to(parameters.dtype)  # 16-bit steps would be visible
        drawn = 0.5 * (x.tanh() + 1)
        if not self.tint:
            return drawn
        color = 0.5 * (parameters[:, 7:, None, None] + 1) + (2 * drawn[:, :3] - 1)
        return torch.cat([color.clamp(0, 1), drawn[:, 3:]], dim=1)

    @property
    def widths(self) -> list[int]:
        """Of all layers but the last, as the option ``channels`` takes them."""
        dense = [len(layer.weight) for layer in self.dense]  # type: ignore[arg-type]
        return [*dense, self.first.channels, *(len(layer.convolution.weight) for layer in self.convolving)]  # type: ignore[arg-type, union-attr]

    def _planes(self, parameters: Tensor, side: int) -> Tensor | None:
        """Coordinates of the pixels (n or 1, ., side, side); the finest are those of the picture, folded."""
        if self.coordconv is Coordinates.stroke:
            zoom = self.subpixel if side * self.subpixel == self.window else 1
            return functional.pixel_unshuffle(stroke_planes(parameters, side * zoom), zoom)
        if self.coordconv is Coordinates.window:
            line = (torch.arange(side, device=parameters.device, dtype=parameters.dtype) + 0.5) * (2 / side) - 1
            return torch.stack([line.expand(side, side), line[:, None].expand(side, side)])[None]
        return None


class Coarsest(nn.Linear):
    """(n, F) -> (n, C, 4, 4), channels last in memory."""

    def __init__(self, before: int, channels: int) -> None:
        super().__init__(before, channels * COARSEST**2)
        self.channels = channels

    def forward(self, x: Tensor) -> Tensor:
        return super().forward(x).reshape(len(x), COARSEST, COARSEST, -1).permute(0, 3, 1, 2)


class _Enlarge(nn.Module):
    """(n, C, h, w) -> (n, C, 2h, 2w)."""

    def __init__(self, channels: int, upsampling: Upsampling) -> None:
        super().__init__()
        self.mode = upsampling.name
        self.spread = nn.Conv2d(channels, 4 * channels, 1) if upsampling is Upsampling.pixel_shuffle else None

    def forward(self, x: Tensor) -> Tensor:
        if self.spread is not None:
            return functional.pixel_shuffle(self.spread(x), 2)
        return functional.interpolate(x, scale_factor=2, mode=self.mode)


class _Layer(nn.Module):
    """A convolution and what is added to it, without the activation."""

    grain: Tensor

    def __init__(
        self,
        before: int,
        after: int,
        side: int,
        planes: int,
        noise: bool,
        normalisation: Normalisation,
    ) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(before, after, 3, padding=1)
        self.coordinates = nn.Conv2d(planes, after, 1, bias=False) if planes else None
        self.strength = nn.Parameter(torch.zeros(after)) if noise else None
        self.normalise = NORMALISATIONS[normalisation](after)
        grain = torch.randn(1, 1, side, side, generator=torch.Generator().manual_seed(NOISE_SEED + side))
        self.register_buffer("grain", grain, persistent=False)

    def forward(self, x: Tensor, planes: Tensor | None) -> Tensor:
        x = self.convolution(x)
        if self.coordinates is not None and planes is not None:  # the same sum as that of a convolution of both
            x = x + self.coordinates(planes)
        if self.strength is not None:
            grain = torch.randn_like(x[:, :1]) if self.training else self.grain
            x = x + self.strength[:, None, None] * grain
        return self.normalise(x)


def _initialise(module: nn.Module) -> None:
    """He et al. (2015), so that what distinguishes strokes reaches the last layer: PyTorch's own would lose it."""
    if isinstance(module, nn.Conv2d | nn.Linear):
        nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
        if module.bias is not None:
            nn.init.zeros_(module.bias)


def _checked(channels: list[int], count: int) -> list[int]:
    if len(channels) != count or not all(isinstance(value, int) and 1 <= value <= 65536 for value in channels):
        raise UserError(
            f"renderer.channels={channels} are not {count} widths, one of each layer but the last; "
            "leave it at null, or give those of task=prune"
        )
    return channels
