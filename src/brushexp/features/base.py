"""What every feature network is: frozen convolutions whose activations have names."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from typing import Any

import torch
from torch import Tensor, nn
from torch.autograd.function import once_differentiable
from torch.nn import functional

from brushexp.errors import UserError


class Backbone(nn.Module, ABC):
    """A frozen network; its activations ("taps") are differentiable in the pictures.

    Its weights are constants that come from a file of their own: no parameters, and no part of a checkpoint.

    Attributes:
        taps: names of all activations, shallow to deep.
        default_taps: those that serve best as a content loss.
        least: pixels of the shortest sides that it takes as they are; shorter ones are widened, see `widened`.
        context: pixels on every side of a part of a picture that its activations are looked at with. They see farther
            (up to twice as far), but hardly: what a margin costs is measured in docs/performance.md.
        grid: pixels; a part that begins at multiples of it has its activations where the whole picture has them.
    """

    taps: tuple[str, ...]
    default_taps: tuple[str, ...]
    least: int = 1
    context: int = 32
    grid: int = 16

    @abstractmethod
    def walk(self, pictures: Tensor) -> Iterator[tuple[str, Tensor]]:
        """Yield name and activation, in the order of ``taps``; computes nothing beyond what is asked for."""

    def forward(self, pictures: Tensor, taps: Collection[str]) -> dict[str, Tensor]:
        """Activations (B, C, h, w) of pictures (B, 3, H, W), sRGB in [0, 1]; nothing below the last tap is computed.

        Raises:
            UserError: if a tap does not exist, or none is asked for.
        """
        self.check(taps)
        found: dict[str, Tensor] = {}
        for name, value in self.walk(pictures):
            if name in taps:
                found[name] = value
            if len(found) == len(set(taps)):
                break
        return found

    def check(self, taps: Collection[str]) -> None:
        """Refuse taps that this network does not have."""
        wrong = [tap for tap in taps if tap not in self.taps]
        if wrong or not taps:
            asked = repr(wrong[0]) if wrong else "an empty list"
            raise UserError(f"taps: {asked} names no activation of this network; choose from {', '.join(self.taps)}")


def widened(pictures: Tensor, least: int) -> Tensor:
    """Pictures (B, C, H, W) of at least ``least`` pixels on each side: their border is repeated where it takes that."""
    height, width = pictures.shape[-2:]
    down, across = max(least - height, 0), max(least - width, 0)
    if not (down or across):
        return pictures
    padding = (across // 2, across - across // 2, down // 2, down - down // 2)
    return functional.pad(pictures, padding, mode="replicate")


class _MeanSquares(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, ours: Tensor, theirs: Tensor, weights: Tensor | None) -> Tensor:
        difference = ours - theirs
        ctx.save_for_backward(difference, weights)
        squares = difference.square()
        return (squares if weights is None else squares * weights).mean((0, 2, 3))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, slope: Tensor) -> tuple[Tensor | None, Tensor | None, None]:
        difference, weights = ctx.saved_tensors
        channels = difference.shape[1]
        found = difference * (slope * (2 * channels / difference.numel())).reshape(channels, 1, 1)
        if weights is not None:
            found = found * weights
        ours, theirs, _ = ctx.needs_input_grad
        return found if ours else None, -found if theirs else None, None


def mean_squares(ours: Tensor, theirs: Tensor, weights: Tensor | None = None) -> Tensor:
    """Mean squared difference (C,) of activations (B, C, h, w), over pictures and positions.

    With ``weights`` (h, w), without gradient, each position is multiplied by its own before the mean.

    The gradient lies in memory as the activations do. Those of PyTorch's own functions lie channel by channel, and in a
    network with the channels innermost every step back from there took two to five times as long for it on a CPU.
    """
    found: Tensor = _MeanSquares.apply(ours, theirs, weights)
    return found


class Normalise(nn.Module):
    """Turns pictures in [0, 1] into the numbers that a network was trained on, of its precision.

    Args:
        scale: what each channel is multiplied by.
        shift: what is added then.
    """

    scale: Tensor
    shift: Tensor

    def __init__(self, scale: tuple[float, ...], shift: tuple[float, ...]) -> None:
        super().__init__()
        self.register_buffer("scale", torch.tensor(scale).reshape(3, 1, 1), persistent=False)
        self.register_buffer("shift", torch.tensor(shift).reshape(3, 1, 1), persistent=False)

    def forward(self, pictures: Tensor) -> Tensor:
        return pictures.to(self.scale.dtype) * self.scale + self.shift


class FrozenConvolution(nn.Module):
    """Convolution with constant weights, zero-padded so that ceil(side / stride) outputs remain.

    Where the padding is odd, the far side gets the larger half, as TensorFlow's "same" has it; with stride 1 that is
    the usual (kernel - 1) / 2 on every side.

    Args:
        weight: (O, I / groups, K, K), K odd.
        bias: (O,).
        stride: step between outputs.
        groups: number of channel groups.
        padding: zeros on every side instead.
    """

    weight: Tensor
    bias: Tensor

    def __init__(
        self, weight: Tensor, bias: Tensor, *, stride: int = 1, groups: int = 1, padding: int | None = None
    ) -> None:
        super().__init__()
        self.register_buffer("weight", weight, persistent=False)
        self.register_buffer("bias", bias, persistent=False)
        self.stride, self.groups, self.padding = stride, groups, padding

    def forward(self, x: Tensor) -> Tensor:
        kernel = self.weight.shape[-1]
        if self.stride == 1 or self.padding is not None:
            padding = kernel // 2 if self.padding is None else self.padding
            return functional.conv2d(x, self.weight, self.bias, self.stride, padding, groups=self.groups)
        if (self.stride, self.groups, kernel) == (2, 1, 3):
            found: Tensor = _Halve.apply(x, self.weight, self.bias)
            return found
        return _same(x, self.weight, self.bias, self.stride, self.groups)


def _same(x: Tensor, weight: Tensor, bias: Tensor, stride: int, groups: int) -> Tensor:
    """Convolution whose padding is what TensorFlow calls "same"."""
    kernel = weight.shape[-1]
    short = [max(kernel - 1 - (side - 1) % stride, 0) for side in x.shape[-2:]]
    if any(total % 2 for total in short):
        # The near side gets a zero less: the kernel has it instead. Zeros on one side of x only would take a copy of
        # it, forward and backward, that costs more than the convolution.
        weight = functional.pad(weight, (short[1] % 2, 0, short[0] % 2, 0))
    return functional.conv2d(x, weight, bias, stride, [(total + 1) // 2 for total in short], groups=groups)


class _Halve(torch.autograd.Function):
    """Convolution by 3 x 3 in steps of two.

    Each 2 x 2 pixels of the gradient are a convolution by 2 x 2 of the slope, with four times the channels. PyTorch's
    own takes 16 channels where there are 3, and on a CPU nearly twice the time.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
        ctx.save_for_backward(weight)
        ctx.size = x.shape
        return _same(x, weight, bias, 2, 1)

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> tuple[Tensor, None, None]:
        (weight,) = ctx.saved_tensors
        pictures, channels, height, width = ctx.size
        top, left = height % 2, width % 2  # an odd side has a zero before it, an even one has none
        taps = functional.pad(weight, (left, 1 - left, top, 1 - top)).reshape(-1, channels, 2, 2, 2, 2).flip(2, 4)
        kernel = taps.permute(3, 5, 1, 0, 2, 4).reshape(4 * channels, -1, 2, 2)
        kernel = kernel.contiguous(memory_format=torch.channels_last)
        rows, columns = slope.shape[2:]
        found = functional.conv2d(slope, kernel, padding=1)[:, :, top : top + rows, left : left + columns]
        found = found.permute(0, 2, 3, 1).reshape(pictures, rows, columns, 2, 2, channels).permute(0, 5, 1, 3, 2, 4)
        return found.reshape(pictures, channels, 2 * rows, 2 * columns)[:, :, :height, :width], None, None
