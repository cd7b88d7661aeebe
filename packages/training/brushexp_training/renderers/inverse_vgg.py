"""The thesis's neural renderer, which draws a stroke's window from ten parameters."""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Annotated

import torch
from torch import Tensor, nn
from torch.nn import functional

from brushexp.contracts import UserError, between, one_of, register
from brushexp.contracts.families import PRECISIONS, RENDERERS, PatchRenderer
from brushexp.contracts.files import shorten_value
from brushexp.contracts.networks import CoordConv, add_noise, fixed_grain, window_planes
from brushexp.contracts.strokes import width_of
from brushexp_training.renderers.neural import initialise

COARSEST = 4  # side in pixels of the picture that the dense layers make
CONVOLUTIONS = 3  # number of convolutions at each size
GROUPS = 8  # number of groups in group normalisation
LAST_GAIN = 0.1  # initial gain of the last convolution, so that tanh is not saturated at first
EMPTY = -1.5  # initial alpha; most of a window is empty, and starting at 1/2 overshoots into a tanh without slope
WAVES = 4  # number of cosines and sines across the stroke, of 1/2, 1, 2, 4 periods per half width, for streaks
PLANES = 3 + 2 * WAVES
LEAST_SQUARED_CHORD = 1e-4  # lower bound of squared lengths used as divisors, half-windows; valid strokes have 0.007
THINNEST = 1e-3  # lower bound of half widths used as divisors, half-windows; valid strokes have 0.03
MOST_WEIGHTS = 10**9  # maximum number of weights, which take 4 GB
FARTHEST_COORDINATE = 3.0  # largest coordinate across a stroke in half widths

COORDINATES = ("none", "window", "stroke")
ACTIVATIONS = ("relu", "leaky_relu", "elu", "gelu", "silu")
UPSAMPLING = ("nearest", "bilinear", "pixel_shuffle")
NORMALISATIONS: dict[str, Callable[[int], nn.Module]] = {
    "none": lambda channels: nn.Identity(),
    "batch": nn.BatchNorm2d,
    "group": lambda channels: nn.GroupNorm(min(GROUPS, channels), channels),
    "instance": lambda channels: nn.GroupNorm(channels, channels),
}


@register("renderer", "inverse_vgg")
class InverseVGG(PatchRenderer):
    """Inverse VGG: dense layers, then upsampling and three convolutions at each size; trained on simulated strokes.

    Source: thesis 2020, 6.2; its original size is the `neural_thesis` preset. The default size differs from the source
    in three ways: the last convolution draws squares of ``subpixel`` pixels (Shi et al., 2016, arXiv:1609.05158),
    because on a CPU a few channels at full size would take most of the time; the network receives the stroke's
    coordinates (``coordconv``); and it does not draw the stroke's colour (``tint``).

    Args:
        window: side of the picture in pixels: 64, 128 or 256.
        width: number of channels at the finest size, which doubles at each coarser size.
        widest: maximum number of channels at any size.
        dense: widths of the dense layers before the layer that makes the coarsest picture.
        subpixel: side of the squares that the last convolution draws at once: 1 (the source), 2 or 4.
        coordconv: coordinates given to the network: none; window, x and y as two extra channels of every convolution
            (Liu et al., 2018, arXiv:1807.03247); or stroke, coordinates along and across the stroke at the first
            convolution of each size (`stroke_planes`), so that the network only has to learn the look of paint, not its
            position.
        tint: whether the stroke's colour is added to the output, so that the network only has to learn the light on it.
        noise: initial strength of the noise added to every convolution, learned per channel (Karras et al., 2019,
            arXiv:1812.04948, who start at 0); 1 is about as strong as the signal; 0 = none. It is sampled anew at each
            training step, but is the same for all strokes when painting. Unlike in the source, all channels share one
            noise plane.
        activation: activation after every layer but the last: relu, leaky_relu, elu, gelu or silu.
        normalisation: normalisation after every convolution but the last: none, batch, group (of channels) or instance.
        upsampling: upsampling between sizes: nearest, bilinear, or pixel_shuffle, which is learned.
        channels: widths of all layers but the last, as written by task=prune: dense layers, coarsest picture, and every
            convolution; null = from the checkpoint, or otherwise from width, widest and dense.
        precision: precision of the network when painting; bfloat16 is faster on GPUs and on CPUs that support it
            (AVX-512 BF16, AMX). Training has a separate precision.
        project: whether strokes are moved into the training range before they are drawn; false shows what the network
            draws outside the range.
        checkpoint: trained weights: a .safetensors file from task=train, or the name of shipped weights; null = random
            weights, for training.
    """

    def __init__(
        self,
        *,
        window: Annotated[int, one_of(64, 128, 256)] = 64,
        width: Annotated[int, between(1, 4096)] = 32,
        widest: Annotated[int, between(1, 4096)] = 96,
        dense: Annotated[list[int], between(1, 65536)] = [256, 256],  # noqa: B006
        subpixel: Annotated[int, one_of(1, 2, 4)] = 2,
        coordconv: Annotated[str, one_of(*COORDINATES)] = "stroke",
        tint: bool = True,
        noise: Annotated[float, between(0, 100)] = 0.0,
        activation: Annotated[str, one_of(*ACTIVATIONS)] = "relu",
        normalisation: Annotated[str, one_of(*NORMALISATIONS)] = "none",
        upsampling: Annotated[str, one_of(*UPSAMPLING)] = "nearest",
        channels: list[int] | None = None,
        precision: Annotated[str, one_of(*PRECISIONS)] = "float32",
        project: bool = True,
        checkpoint: str | None = "inverse_vgg",
    ) -> None:
        super().__init__()
        if channels is None and checkpoint is not None:
            channels = RENDERERS.read_recipe(RENDERERS.path_of(checkpoint))["options"].get("channels")
        if not dense:
            raise UserError("renderer.dense=[] has no width; try 'renderer.dense=[256,256]'")
        self.window, self.subpixel, self.precision, self.project = window, subpixel, precision, project
        self.coordconv, self.tint, self.activate = coordconv, tint, getattr(functional, activation)
        sides = [COARSEST * 2**k for k in range((window // subpixel // COARSEST).bit_length())]
        by_size = [min(width * sides[-1] // side, widest) for side in sides]
        widths = _choose_widths([*dense, by_size[0], *(n for n in by_size[1:] for _ in range(CONVOLUTIONS))], channels)
        in_dense, in_pictures = widths[: len(dense)], widths[len(dense) :]
        self.dense = nn.ModuleList(nn.Linear(a, b) for a, b in zip([10, *in_dense], in_dense, strict=False))
        self.first = Coarsest(in_dense[-1], in_pictures[0])
        self.growing = nn.ModuleList(_enlarge(before, upsampling) for before in in_pictures[:-1:CONVOLUTIONS])
        self.convolving = nn.ModuleList()
        for k, (before, after) in enumerate(pairwise(in_pictures)):
            side = sides[1 + k // CONVOLUTIONS]
            planes = 2 if coordconv == "window" else 0
            if coordconv == "stroke" and k % CONVOLUTIONS == 0:
                planes = PLANES * (subpixel**2 if side == sides[-1] else 1)
            self.convolving.append(_Layer(before, after, side, planes, noise, normalisation))
        self.last = nn.Conv2d(in_pictures[-1], 4 * subpixel**2, 3, padding=1)
        self.apply(initialise)
        with torch.no_grad():
            self.last.weight.mul_(LAST_GAIN)
            assert self.last.bias is not None
            self.last.bias[3 * subpixel**2 :] = EMPTY  # pixel_shuffle takes the squares of a channel one after another
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # a fifth faster on a processor
        self.restore(
            checkpoint, window=window, width=width, widest=widest, dense=dense, subpixel=subpixel, coordconv=coordconv,
            tint=tint, noise=noise, activation=activation, normalisation=normalisation, upsampling=upsampling,
            channels=channels,
        )  # fmt: skip

    def draw(self, parameters: Tensor) -> Tensor:
        x = parameters
        for layer in (*self.dense, self.first):
            x = self.activate(layer(x))
        for k, layer in enumerate(self.convolving):
            if k % CONVOLUTIONS == 0:
                x = self.growing[k // CONVOLUTIONS](x)
                planes = self._planes(parameters, x.shape[-1])
            x = self.activate(layer(x, planes))
        x = functional.pixel_shuffle(self.last(x), self.subpixel).to(parameters.dtype)  # 16-bit steps would be visible
        drawn = 0.5 * (x.tanh() + 1)
        if not self.tint:
            return drawn
        light, alpha = drawn.split([3, 1], dim=1)
        color = 0.5 * (parameters[:, 7:, None, None] + 1) + (2 * light - 1)
        return torch.cat([color.clamp(0, 1), alpha], dim=1)

    @property
    def widths(self) -> list[int]:
        """The widths of all layers but the last, in the format of the ``channels`` option."""
        dense = [len(layer.weight) for layer in self.dense]  # type: ignore[arg-type]
        return [*dense, self.first.channels, *(len(layer.convolution.weight) for layer in self.convolving)]  # type: ignore[arg-type, union-attr]

    def _planes(self, parameters: Tensor, side: int) -> Tensor | None:
        """Return the coordinate planes (n or 1, ., side, side), or None if the network receives none.

        At the finest size, the stroke's planes are computed at the picture's resolution and folded.
        """
        if self.coordconv == "stroke":
            zoom = self.subpixel if side * self.subpixel == self.window else 1
            return stroke_planes(parameters, side * zoom, zoom)
        if self.coordconv == "window":
            return window_planes(side, parameters)
        return None


def _choose_widths(widths: list[int], channels: list[int] | None) -> list[int]:
    """Return the ``channels`` of a pruned network if they are given, and otherwise ``widths``.

    Raises UserError if the channels are invalid or the network is too large.
    """
    if channels is not None:
        possible = isinstance(channels, list) and all(isinstance(n, int) and 1 <= n <= 65536 for n in channels)
        if not possible or len(channels) != len(widths):
            wrong = f"renderer.channels={shorten_value(channels)} are not {len(widths)} widths, all but the last"
            raise UserError(f"{wrong}; leave it at null, or give the widths from task=prune")
        widths = channels
    numbers = 9 * sum(a * b for a, b in pairwise(widths))
    if numbers > MOST_WEIGHTS:
        raise UserError(f"renderer.width, widest, dense make {numbers:.0e} weights; use at most {MOST_WEIGHTS:.0e}")
    return widths


class Coarsest(nn.Linear):
    """A dense layer (n, F) -> (n, C, 4, 4), whose output is stored with channels last."""

    def __init__(self, before: int, channels: int) -> None:
        super().__init__(before, channels * COARSEST**2)
        self.channels = channels

    def forward(self, x: Tensor) -> Tensor:
        return super().forward(x).reshape(len(x), COARSEST, COARSEST, -1).permute(0, 3, 1, 2)


def _enlarge(channels: int, upsampling: str) -> nn.Module:
    """Return a layer that doubles the resolution: (n, C, h, w) -> (n, C, 2h, 2w)."""
    if upsampling == "pixel_shuffle":
        return nn.Sequential(nn.Conv2d(channels, 4 * channels, 1), nn.PixelShuffle(2))
    return nn.Upsample(scale_factor=2, mode=upsampling)


class _Layer(CoordConv):
    """A convolution followed by noise and normalisation, without the activation."""

    grain: Tensor

    def __init__(self, before: int, after: int, side: int, planes: int, noise: float, normalisation: str) -> None:
        super().__init__(before, after, planes)
        self.strength = nn.Parameter(torch.full((after,), float(noise))) if noise else None
        self.normalise = NORMALISATIONS[normalisation](after)
        self.register_buffer("grain", fixed_grain(side), persistent=False)

    def forward(self, x: Tensor, planes: Tensor | None = None) -> Tensor:
        x = super().forward(x, planes)
        if self.strength is not None:
            x = add_noise(x, self.strength, None if self.training else self.grain)
        return self.normalise(x)


def stroke_planes(parameters: Tensor, side: int, zoom: int = 1) -> Tensor:
    """Compute coordinate planes (n, PLANES, side, side) for strokes (n, 10) from `strokes.prior.parameters_of`.

    With a ``zoom`` z, the planes are folded as by pixel_unshuffle: (n, PLANES * z * z, side / z, side / z).

    The planes contain the coordinate along the chord from -1 (start) to 1 (end), the coordinate across it in half
    widths, the distance beyond an end in half widths, and waves across the stroke, which fade away from it. The curve
    is approximated by a parabola over its chord, with a first-order correction for an asymmetric control point. This
    avoids a search for nearest points; valid strokes deviate little from it, and the network corrects the rest.
    """
    line = (torch.arange(side, device=parameters.device, dtype=parameters.dtype) + 0.5) * (2 / side) - 1
    line = line.reshape(-1, zoom).T  # (z, side / z)
    start, control, end, width, _ = parameters[:, :, None, None, None].split([2, 2, 2, 1, 3], dim=1)
    half = width_of(width).clamp_min(THINNEST)  # a width in windows is a half width in half-windows
    chord, lift = end - start, control - start
    square = chord.square().sum(1, keepdim=True).clamp_min(LEAST_SQUARED_CHORD)
    length = square.sqrt()
    dx, dy = chord[:, :1], chord[:, 1:]
    x, y = line[:, None] - start[:, :1], line[:, None, :, None] - start[:, 1:]
    along = (x * dx + y * dy) / square  # (n, z, z, side / z, side / z)
    lean = (lift * chord).sum(1, keepdim=True) / square - 0.5
    bend = (dx * lift[:, 1:] - dy * lift[:, :1]) / length
    t = along.clamp(0, 1)
    t = (t - 2 * lean * t * (1 - t)).clamp(0, 1)
    slope = 2 * bend / length * (1 - 2 * t)
    across = ((dx * y - dy * x) / length - 2 * bend * t * (1 - t)) / half * torch.rsqrt(1 + slope.square())
    beyond = ((along - 0.5).abs() - 0.5).clamp_min(0) * length / half
    v = across.clamp(-FARTHEST_COORDINATE, FARTHEST_COORDINATE)
    near = torch.exp(-0.25 * v.square())
    planes = [2 * along.clamp(-0.5, 1.5) - 1, v, beyond.clamp_max(FARTHEST_COORDINATE)]
    cosine, sine = torch.cos(0.5 * math.pi * v), torch.sin(0.5 * math.pi * v)
    for _ in range(WAVES):
        cosine, sine = cosine.square() - sine.square(), 2 * sine * cosine  # double the angle
        planes += [near * cosine, near * sine]
    return torch.stack(planes, dim=1).flatten(1, 3)
