"""What every feature network is: frozen convolutions whose activations have names."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator

from torch import Tensor, nn
from torch.nn import functional

from brushexp.errors import UserError


class Backbone(nn.Module, ABC):
    """A frozen network; its activations ("taps") are differentiable in the pictures.

    Its weights are constants that come from a file of their own: no parameters, and no part of a checkpoint.

    Attributes:
        taps: names of all activations, shallow to deep.
        default_taps: those that serve best as a content loss.
    """

    taps: tuple[str, ...]
    default_taps: tuple[str, ...]

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


class FrozenConvolution(nn.Module):
    """Convolution with constant weights, zero-padded so that ceil(side / stride) outputs remain.

    Where the padding is odd, the far side gets the larger half, as TensorFlow's "same" has it; with stride 1 that is
    the usual (kernel - 1) / 2 on every side.

    Args:
        weight: (O, I / groups, K, K), K odd.
        bias: (O,).
        stride: step between outputs.
        groups: number of channel groups.
    """

    weight: Tensor
    bias: Tensor

    def __init__(self, weight: Tensor, bias: Tensor, *, stride: int = 1, groups: int = 1) -> None:
        super().__init__()
        self.register_buffer("weight", weight, persistent=False)
        self.register_buffer("bias", bias, persistent=False)
        self.stride, self.groups = stride, groups

    def forward(self, x: Tensor) -> Tensor:
        kernel = self.weight.shape[-1]
        if self.stride == 1:
            return functional.conv2d(x, self.weight, self.bias, padding=kernel // 2, groups=self.groups)
        short = [max(kernel - 1 - (side - 1) % self.stride, 0) for side in (x.shape[-1], x.shape[-2])]
        x = functional.pad(x, [part for total in short for part in (total // 2, total - total // 2)])
        return functional.conv2d(x, self.weight, self.bias, self.stride, groups=self.groups)
