"""Layers of networks that render strokes: convolutions with coordinates, and added noise."""

import torch
from torch import Tensor, nn

NOISE_SEED = 2020  # seed of the noise that all strokes of a painting share


class CoordConv(nn.Module):
    """3 x 3 convolution with pixel coordinates as extra input channels (Liu et al., 2018, arXiv:1807.03247).

    Unlike in the source, the coordinates have a separate 1 x 1 convolution, whose result is added, so that planes
    shared by all strokes, (1, planes, H, W), are convolved only once.

    Args:
        before: number of input channels.
        after: number of output channels.
        planes: number of coordinate planes, such as the two from `window_planes`; 0 for a plain convolution.

    >>> layer = CoordConv(8, 16, planes=2)
    >>> layer(torch.zeros(5, 8, 32, 32), window_planes(32)).shape
    torch.Size([5, 16, 32, 32])
    """

    def __init__(self, before: int, after: int, planes: int = 2) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(before, after, 3, padding=1)
        self.coordinates = nn.Conv2d(planes, after, 1, bias=False) if planes else None

    def forward(self, x: Tensor, planes: Tensor | None = None) -> Tensor:
        """Convolve (n, before, H, W) with coordinate ``planes`` (n or 1, planes, H, W) to (n, after, H, W)."""
        x = self.convolution(x)
        return x if self.coordinates is None or planes is None else x + self.coordinates(planes)


class Noise(nn.Module):
    """Adds the same noise to all channels, with a learned strength per channel (Karras et al., 2019, arXiv:1812.04948).

    During training, every call samples new noise; otherwise the noise is the same for every stroke and call. Unlike in
    the source, the initial strength is not 0 by default.

    Args:
        channels: number of channels of the input.
        side: side of the input in pixels.
        strength: initial strength; at 1 the noise is about as strong as a normalised signal.

    >>> layer = Noise(16, side=32).eval()
    >>> x = torch.zeros(5, 16, 32, 32)
    >>> torch.equal(layer(x), layer(x)), torch.equal(layer.train()(x), layer(x))
    (True, False)
    """

    grain: Tensor

    def __init__(self, channels: int, side: int, strength: float = 0.1) -> None:
        super().__init__()
        self.strength = nn.Parameter(torch.full((channels,), float(strength)))
        self.register_buffer("grain", fixed_grain(side), persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        return add_noise(x, self.strength, None if self.training else self.grain)


def add_noise(x: Tensor, strength: Tensor, grain: Tensor | None) -> Tensor:
    """Add noise, multiplied by ``strength`` (C,), to ``x`` (n, C, H, W).

    The noise is ``grain`` (1, 1, H, W); if this is None, every call samples new noise.
    """
    grain = torch.randn_like(x[:, :1]) if grain is None else grain
    return x + strength[:, None, None] * grain


def fixed_grain(side: int) -> Tensor:
    """Sample the fixed noise (1, 1, side, side) that is shared by all paintings."""
    return torch.randn(1, 1, side, side, generator=torch.Generator().manual_seed(NOISE_SEED + side))


def window_planes(side: int, like: Tensor | None = None) -> Tensor:
    """Compute the pixel coordinates x and y in a window, -1 to 1, as a tensor (1, 2, side, side).

    The tensor has the dtype and device of ``like``.
    """
    like = torch.empty(0) if like is None else like
    line = (torch.arange(side, device=like.device, dtype=like.dtype) + 0.5) * (2 / side) - 1
    return torch.stack([line.expand(side, side), line[:, None].expand(side, side)])[None]
