"""Decode channels to pictures by a curve for each channel, a matrix to linear RGB, and the sRGB curve.

For float32 on the CPU, the decoder and its gradient are compiled, because PyTorch would make a dozen passes over
memory.
"""
# mypy: allow-untyped-defs

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts.kernels import Compiled, function, inline
from brushexp.contracts.machine import share

F = np.float32
STEEPEST, KNEE, KNEE_SHOWN = 12.92, 0.0031308, 0.04045  # slope of the curve of displays at black, and where that ends
GAIN, LIFT, POWER = 1.055, 0.055, 2.4
BLOCK = 256  # pixels per block, whose rows fit into the first-level cache
CHANNELS = 3
Part = Callable[..., Any]


def linear_of(color: Tensor) -> Tensor:
    """Compute linear RGB from display-referred RGB, both in [0, 1] (IEC 61966-2-1)."""
    curved = ((color.clamp_min(KNEE_SHOWN) + LIFT) / GAIN) ** POWER
    return torch.where(color <= KNEE_SHOWN, color / STEEPEST, curved)


def display_of(light: Tensor) -> Tensor:
    """Compute display-referred RGB from linear RGB, as the inverse of `linear_of`."""
    return torch.where(light <= KNEE, STEEPEST * light, GAIN * light.clamp_min(KNEE) ** (1 / POWER) - LIFT)


class Decoder:
    """A decoder from channels (C, H, W) to pictures (3, H, W): clamp(display curve(matrix @ rise(channels))).

    Colours outside the display gamut are clamped channel by channel; their gradient ignores the clamping, so that they
    can return to the gamut.

    Args:
        matrix: matrix (3, C), float64, to linear RGB.
        rise: curve from channels to the input of the matrix.
        compiled: the same curve for a single float32 number, marked `inline`.
        slope: derivative of the compiled curve.
    """

    def __init__(self, matrix: Tensor, rise: Callable[[Tensor], Tensor], compiled: Part, slope: Part) -> None:
        self.matrix, self.rise = matrix, rise
        parts: dict[str, Any] = {"CHANNELS": matrix.shape[1], "rise": compiled, "rise_slope": slope}
        self.forward, self.backward = _decode.with_parts(**parts), _decode_back.with_parts(**parts)

    def __call__(self, picture: Tensor) -> Tensor:
        if picture.dtype == torch.float32 and picture.device.type == "cpu":
            return Decoded.apply(picture, self)
        shown = display_of(torch.tensordot(self.matrix.to(picture), self.rise(picture), 1))
        return shown + (shown.clamp(0, 1) - shown).detach()

    @cached_property
    def rows(self) -> np.ndarray:
        """The matrix as the float32 array that the compiled functions need."""
        return self.matrix.numpy().astype(F)


class Decoded(torch.autograd.Function):
    """The compiled decoder as a differentiable operation."""

    @staticmethod
    def forward(ctx: Any, picture: Tensor, decoder: Decoder) -> Tensor:
        ctx.decoder = decoder
        ctx.save_for_backward(picture)
        shown = torch.empty(3, *picture.shape[1:])
        _run(decoder.forward, picture, decoder.rows, shown)
        return shown

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor, None]:
        (picture,) = ctx.saved_tensors
        out = torch.empty_like(picture, memory_format=torch.contiguous_format)
        _run(ctx.decoder.backward, picture, ctx.decoder.rows, grad, out)
        return out, None


def _run(compiled: Compiled, picture: Tensor, rows: np.ndarray, *others: Tensor) -> None:
    flat = [tensor.detach().contiguous().flatten(1).numpy() for tensor in (picture, *others)]
    share(compiled, -(-flat[0].shape[1] // BLOCK), flat[0], rows, *flat[1:])


def _fit_root() -> tuple[float, ...]:
    """Fit a polynomial in u = light^(1/8) to light^(1 / POWER) above the knee; return coefficients, highest first."""
    u = np.cos(np.pi * (np.arange(400) + 0.5) / 400) * 0.5 * (1 - KNEE**0.125) + 0.5 * (1 + KNEE**0.125)
    fit = np.polynomial.Chebyshev.fit(u, u ** (8 / POWER), 7).convert(kind=np.polynomial.Polynomial)
    return tuple(fit.coef[::-1].tolist())


ROOT = _fit_root()


@inline
def rise(x):
    """Placeholder for the curve that is applied to each channel."""


@inline
def rise_slope(x):
    """Placeholder for the derivative of `rise`."""


@inline
def _root(light):
    u = np.sqrt(np.sqrt(np.sqrt(max(light, F(KNEE)))))
    y = F(ROOT[0])
    for k in range(1, 8):
        y = y * u + F(ROOT[k])
    return y


@inline
def _gather(picture, rows, block, channels, light):
    """Write a block's channels, mapped by `rise` (C, BLOCK), and linear RGB (3, BLOCK); return its start and size."""
    begin = block * BLOCK
    size = min(BLOCK, picture.shape[1] - begin)
    for c in range(CHANNELS):
        for q in range(size):
            channels[c, q] = rise(picture[c, begin + q])
    for k in range(3):
        light[k, :size] = F(0)
        for c in range(CHANNELS):
            for q in range(size):
                light[k, q] += rows[k, c] * channels[c, q]
    return begin, size


@function
def _decode(first_block, end_block, picture, rows, shown):
    """Decode channels (C, P) to pixels (3, P) in a range of blocks; ``rows`` is the matrix (3, C)."""
    for block in range(first_block, end_block):
        channels, light = np.empty((CHANNELS, BLOCK), F), np.empty((3, BLOCK), F)
        begin, size = _gather(picture, rows, block, channels, light)
        for k in range(3):
            for q in range(size):
                x = light[k, q]
                y = F(GAIN) * _root(x) - F(LIFT) if x > F(KNEE) else F(STEEPEST) * x
                shown[k, begin + q] = min(max(y, F(0)), F(1))


@function
def _decode_back(first_block, end_block, picture, rows, grad, out):
    """Write the channels' gradient (C, P) in a range of blocks, given the pixels' gradient ``grad`` (3, P)."""
    for block in range(first_block, end_block):
        channels, light = np.empty((CHANNELS, BLOCK), F), np.empty((3, BLOCK), F)
        begin, size = _gather(picture, rows, block, channels, light)
        for k in range(3):
            for q in range(size):
                x = max(light[k, q], F(KNEE))
                slope = F(GAIN / POWER) * _root(x) / x if light[k, q] > F(KNEE) else F(STEEPEST)
                light[k, q] = slope * grad[k, begin + q]
        for c in range(CHANNELS):
            for q in range(size):
                slope = rise_slope(picture[c, begin + q])
                red, green, blue = light[0, q], light[1, q], light[2, q]
                out[c, begin + q] = slope * (rows[0, c] * red + rows[1, c] * green + rows[2, c] * blue)
