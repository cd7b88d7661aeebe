"""Draw strokes with a network that turns ten parameters and a brush into a texture, which is bent along the stroke."""

import math
from collections.abc import Sequence
from contextlib import nullcontext
from itertools import pairwise
from typing import Annotated

import torch
from torch import Tensor, nn
from torch.nn import functional

from brushexp.contracts import between, one_of, register
from brushexp.contracts.families import PRECISIONS, TEXELS, Renderer
from brushexp.contracts.layers import PAINT_REACH, SOFT_EDGE, SPREAD, Loop, TexturedProfile, sheets_of
from brushexp.contracts.strokes import (
    Strokes,
    clamp_to_prior,
    control_offset,
    curve_of,
    half_width_of,
    parameters_of,
    rewindow,
    width_of,
)

THIN = 0.25  # pixels; strokes become fainter instead of thinner than about twice this
COARSEST = (4, 8)  # rows and columns of the output of the dense layers; each doubling has one stage of convolutions
TEXTURE_SIZES = 3  # sizes of a texture: for windows as large as in training, half and a quarter as large
EMPTY = -1.5  # initial opacity before the sigmoid
LAST_GAIN = 0.1  # initial gain of the last convolution
NUMBERS = 12  # numbers that describe a stroke; see `shape_numbers`
SHORTEST_CHORD = 0.01  # lower bound of chords used as divisors, half-windows; valid strokes have 0.084
CHUNK = 256  # number of strokes processed by the network at once


@register("renderer", "neural")
class Neural(Renderer):
    """A texture for each stroke, drawn by a network trained on simulated strokes and bent along the stroke's curve.

    Streaks follow a stroke, and the brush turns with it. The network therefore does not draw a picture of the window,
    as in the thesis (`inverse_vgg`), but a texture in the stroke's coordinates. The texture is a smooth function of the
    stroke's length, bend, thickness, direction and colour (for the light); it also depends on the brush in the data
    set, which is represented by a learned code and by learned maps at every size of the texture. Kernels sample the
    texture at the canvas pixels, so that a stroke is as sharp as its texture at any picture size. The colour of a texel
    is the stroke's colour, mixed with white or black. During painting, the texture is redrawn as the stroke changes,
    but gradients treat it as constant and flow through the texture coordinates, which matter far more.

    Args:
        window: side in pixels of the training pictures; textures are averaged for strokes with smaller windows.
        brushes: number of brushes in the data set (``engine.brushes``); a stroke's number determines its brush.
        code: size of the learned code of a brush.
        dense: width of the two dense layers.
        width: number of channels of the convolutions at a texture's second-largest size; smaller sizes have twice as
            many.
        stages: number of doublings of the texture before the last; with 2, a texture has 32 texels across a stroke and
            64 along it.
        project: whether a stroke outside the training range is replaced by the nearest one inside it; false shows what
            the network draws outside the range.
        precision: precision of the network when painting: float32, bfloat16, or auto, which is bfloat16 on CPUs that
            support it (AVX-512 BF16, AMX) and are twice as fast with it; textures always have 8 bits. Training has a
            separate precision.
        checkpoint: trained weights: a .safetensors file, or the name of shipped weights; null = random weights, for
            training.
    """

    weights = "trained (task=train)"
    warm_up = "textured"

    def __init__(
        self,
        *,
        window: Annotated[int, between(8, 1024)] = 64,
        brushes: Annotated[int, between(1, 1000)] = 8,
        code: Annotated[int, between(1, 1024)] = 16,
        dense: Annotated[int, between(1, 65536)] = 256,
        width: Annotated[int, between(1, 4096)] = 32,
        stages: Annotated[int, between(1, 4)] = 2,
        project: bool = True,
        precision: Annotated[str, one_of("auto", *PRECISIONS)] = "auto",
        checkpoint: str | None = "neural",
    ) -> None:
        super().__init__()
        self.window, self.brushes, self.project, self.precision = window, brushes, project, precision
        self.codes = nn.Parameter(0.5 * torch.randn(brushes, code))
        self.dense = nn.ModuleList([nn.Linear(NUMBERS + code, dense), nn.Linear(dense, dense)])
        channels = [2 * width] * stages + [width]
        self.first = nn.Linear(dense, channels[0] * math.prod(COARSEST))
        self.stages = nn.ModuleList(
            _Stage(before, after, brushes, [side << k for side in COARSEST])
            for k, (before, after) in enumerate(pairwise(channels), 1)
        )
        self.last = nn.Conv2d(width, 2 * 4, 3, padding=1)  # opacity and tone of four texels
        self.apply(initialise)
        with torch.no_grad():
            self.last.weight.mul_(LAST_GAIN)
            assert self.last.bias is not None
            self.last.bias[:4] = EMPTY
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # a fifth faster on a processor
        self.restore(checkpoint, window=window, brushes=brushes, code=code, dense=dense, width=width, stages=stages)

    def forward(self, strokes: Strokes) -> TexturedProfile:
        half = half_width_of(strokes)
        softened = (half.square() + THIN**2).sqrt()
        valid = clamp_to_prior(rewindow(strokes)) if self.project and not self.training else strokes
        with torch.set_grad_enabled(self.training and torch.is_grad_enabled()):
            textures = self.textures(parameters_of(valid), strokes.brush % self.brushes)
        smaller = (self.window / valid.scale.detach().clamp_min(1)).log2().floor().clamp(0, TEXTURE_SIZES - 1).long()
        sizes = 1 + max(smaller.tolist(), default=0)
        each = torch.arange(len(strokes), device=half.device)
        return TexturedProfile(
            curve_of(strokes),
            softened * (PAINT_REACH / SPREAD),
            strokes.color,
            strokes.opacity * half / softened,
            look=each * sizes + smaller,
            repeats=torch.ones_like(each),
            flip=torch.ones_like(each),
            sheets=sheets_of(textures, sizes, Loop(0, 0), rounded=not self.training),
        )

    def textures(self, parameters: Tensor, brush: Tensor) -> Tensor:
        """Draw textures (n, 2, rows, columns), opacity in [0, 1] and tone in [-1, 1], for strokes (n, 10).

        ``brush`` (n,) holds the number of each stroke's brush.
        """
        weight = self.last.weight
        shapes = shape_numbers(parameters).to(weight.dtype)
        chunks = zip(shapes.split(CHUNK), brush.split(CHUNK), strict=True) if len(shapes) else ()
        rows, columns = (side << len(self.stages) + 1 for side in COARSEST)
        raw = torch.cat([weight.new_zeros(0, 2, rows, columns), *(self._draw(*chunk) for chunk in chunks)])
        return torch.cat([raw[:, :1].sigmoid(), raw[:, 1:].tanh()], dim=1)

    def _draw(self, shapes: Tensor, brush: Tensor) -> Tensor:
        able = shapes.device.type == "cpu" and torch.cpu._is_avx512_bf16_supported()
        low = not self.training and (self.precision == "bfloat16" or (self.precision == "auto" and able))
        with torch.autocast(shapes.device.type, torch.bfloat16) if low else nullcontext():
            x = torch.cat([shapes, self.codes[brush]], dim=1)
            for layer in self.dense:
                x = functional.silu(layer(x))
            x = functional.relu(self.first(x)).reshape(len(x), *COARSEST, -1).permute(0, 3, 1, 2)
            for stage in self.stages:
                x = stage(x, brush)
            return functional.pixel_shuffle(self.last(x), 2).float()  # 16-bit steps would be visible

    @property
    def at_once(self) -> int:  # type: ignore[override]
        return TEXELS // (math.prod(COARSEST) << 2 * len(self.stages) + 5)

    def rows(self, strokes: Strokes) -> Tensor:
        curve, reach = curve_of(strokes)[:, :, 1:], PAINT_REACH * half_width_of(strokes)[:, None] + SOFT_EDGE
        return torch.cat([curve.amin(1) - reach, curve.amax(1) + reach], dim=1)


class _Stage(nn.Module):
    """A layer that doubles rows and columns, and convolves twice, adding a learned map of the brush in between."""

    def __init__(self, before: int, after: int, brushes: int, sides: Sequence[int]) -> None:
        super().__init__()
        self.convolutions = nn.ModuleList([nn.Conv2d(n, after, 3, padding=1) for n in (before, after)])
        self.maps = nn.Parameter(torch.zeros(brushes, after, *sides))

    def forward(self, x: Tensor, brush: Tensor) -> Tensor:
        first, second = self.convolutions
        x = first(functional.interpolate(x, scale_factor=2))
        x = functional.relu(x + self.maps.to(x.dtype)[brush])
        return functional.relu(second(x))


def shape_numbers(parameters: Tensor) -> Tensor:
    """Describe strokes (n, 10), encoded by `parameters_of`, with NUMBERS features that range from about -2 to 2.

    The features are length, both absolute and in half widths, bend, thickness, direction and colour.
    """
    start, control, end, width, color = parameters.split([2, 2, 2, 1, 3], dim=1)
    half = width_of(width).clamp_min(1e-3)  # a width in windows is a half width in half-windows
    length = torch.linalg.vector_norm(end - start, dim=1, keepdim=True).clamp_min(SHORTEST_CHORD)
    along, across = control_offset(torch.stack([start, control, end], dim=1), SHORTEST_CHORD).split(1, dim=1)
    thick = 1.5 * (half.log() + 2.4)
    sizes = [1.5 * (length - 0.8), (length / half).log() - 2, width, thick]
    return torch.cat([*sizes, 4 * along, 2 * across, 0.25 * across * length / half, (end - start) / length, color], 1)


def initialise(module: nn.Module) -> None:
    """Initialise weights as in He et al. (2015), so that differences between strokes reach the last layer."""
    if isinstance(module, nn.Conv2d | nn.Linear):
        nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
        if module.bias is not None:
            nn.init.zeros_(module.bias)
