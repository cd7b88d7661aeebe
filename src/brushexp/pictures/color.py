"""Giving a picture the colours of another."""

import torch
from torch import Tensor

LEAST_VARIANCE = (
    1 / 255
) ** 2  # least variance of a colour direction: a level of 8 bits; below it a picture has one colour
MOST_GAIN = 8.0  # times: a nearly even picture is not spread further than this, its noise would become its content


def recolored(picture: Tensor, like: Tensor) -> Tensor:
    """A picture with the mean and the covariance of the colours of another, by a linear map of its colours.

    Source: Gatys et al. (2016), "Preserving color in neural artistic style transfer", arXiv:1606.05897, "image
    analogies" variant: x -> A (x - mean) + mean_like with A = S_like^(1/2) S^(-1/2), S the covariances and roots by
    eigen-decomposition, so that A S A = S_like. Differs: in the roots a variance counts as one grey level at least,
    and no direction is spread more than 8 times, so that even pictures stay finite and their noise small.

    Both are (3, H, W) in [0, 1], of any sizes; what is returned is like ``picture`` in shape and dtype, and clipped.
    """
    mean, covariance = _moments(picture)
    wanted_mean, wanted = _moments(like)
    spread, axes = torch.linalg.eigh(covariance)
    wanted_spread, wanted_axes = torch.linalg.eigh(wanted)
    narrow = (axes * spread.clamp_min(LEAST_VARIANCE).rsqrt()) @ axes.T
    widen = (wanted_axes * wanted_spread.clamp_min(0).sqrt()) @ wanted_axes.T
    u, gains, v = torch.linalg.svd(widen @ narrow)
    change = (u * gains.clamp_max(MOST_GAIN)) @ v
    colors = change @ (picture.flatten(1).to(torch.float64) - mean) + wanted_mean
    return colors.clamp(0, 1).to(picture.dtype).reshape(picture.shape)


def _moments(picture: Tensor) -> tuple[Tensor, Tensor]:
    """Mean (3, 1) and covariance (3, 3) of the colours, in double precision."""
    colors = picture.flatten(1).to(torch.float64)
    mean = colors.mean(1, keepdim=True)
    offset = colors - mean
    return mean, offset @ offset.T / colors.shape[1]
