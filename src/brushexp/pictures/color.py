"""Colours of pictures: those of another picture, CIELAB, and a few inks in place of many."""

import numpy as np
import torch
from torch import Tensor

LEAST_VARIANCE = 1 / 255**2  # of a colour direction: a level of 8 bits; below it a picture has one colour
MOST_GAIN = 8.0  # times: a nearly even picture is not spread further than this, its noise would become its content
ROUNDS = 100  # of k-means; it settles in a dozen

Array = np.ndarray


def recolored(picture: Tensor, like: Tensor) -> Tensor:
    """A picture with the mean and the covariance of the colours of another, by a linear map of its colours.

    Source: Gatys et al. (2016), "Preserving color in neural artistic style transfer", arXiv:1606.05897, "image
    analogies" variant: x -> A (x - mean) + mean_like with A = S_like^(1/2) S^(-1/2), S the covariances and roots by
    eigen-decomposition, so that A S A = S_like. Differs: in the roots a variance counts as one grey level at least,
    and no direction is spread more than 8 times, so that even pictures stay finite and their noise small.

    Both are (3, H, W) in [0, 1], of any sizes; what is returned is like ``picture`` in shape and dtype, and clipped.
    """
    mean, covariance = _moments(picture)
    like_mean, like_covariance = _moments(like)
    spread, axes = torch.linalg.eigh(covariance)
    like_spread, like_axes = torch.linalg.eigh(like_covariance)
    narrow = (axes * spread.clamp_min(LEAST_VARIANCE).rsqrt()) @ axes.T
    widen = (like_axes * like_spread.clamp_min(0).sqrt()) @ like_axes.T
    u, gains, v = torch.linalg.svd(widen @ narrow)
    change = (u * gains.clamp_max(MOST_GAIN)) @ v
    colors = change @ (picture.flatten(1).to(torch.float64) - mean) + like_mean
    return colors.clamp(0, 1).to(picture.dtype).reshape(picture.shape)


def _moments(picture: Tensor) -> tuple[Tensor, Tensor]:
    """Mean (3, 1) and covariance (3, 3) of the colours, in double precision."""
    colors = picture.flatten(1).to(torch.float64)
    mean = colors.mean(1, keepdim=True)
    offset = colors - mean
    return mean, offset @ offset.T / colors.shape[1]


def palette(lab: Array, weight: Array, count: int) -> Array:
    """The inks (K <= count, 3) that a picture can best be drawn with: k-means in CIELAB (Lloyd, 1982).

    ``weight`` (N,) >= 0 is how much of the picture has each of the colours ``lab`` (N, 3). It starts from one ink and
    adds, where the error is largest, one after the other, never more than there are different colours; so that there
    is nothing random in it, and no further ink makes the error larger.
    """
    lab, weight = lab[weight > 0], weight[weight > 0]
    if len(lab) == 0:
        return np.empty((0, 3))
    inks = np.average(lab, axis=0, weights=weight)[None]
    while True:
        inks = _settled(lab, weight, inks)
        error = weight * np.square(lab - inks[nearest_ink(lab, inks)]).sum(1)
        if len(inks) == count or error.max() <= 1e-9 * weight.max():
            return inks
        inks = np.concatenate([inks, lab[[error.argmax()]]])


def nearest_ink(lab: Array, inks: Array) -> Array:
    """Number (N,) of the ink (K, 3) that is most like each colour (N, 3)."""
    return (np.square(inks).sum(1) - 2 * lab @ inks.T).argmin(1)  # squared distances, but for |lab|^2


def _settled(lab: Array, weight: Array, inks: Array) -> Array:
    """Inks that are the mean of the colours drawn with them."""
    chosen = nearest_ink(lab, inks)
    for _ in range(ROUNDS):
        share = np.bincount(chosen, weight, len(inks))[:, None]
        total = np.stack([np.bincount(chosen, weight * channel, len(inks)) for channel in lab.T], axis=1)
        inks = np.where(share > 0, total / np.maximum(share, np.finfo(float).tiny), inks)
        before, chosen = chosen, nearest_ink(lab, inks)
        if np.array_equal(before, chosen):
            break
    return inks


def to_lab(rgb: Array) -> Array:
    """Colours (N, 3) of sRGB in [0, 1] in CIELAB."""
    from skimage.color import rgb2lab  # noqa: PLC0415  (slow to import)

    return rgb2lab(rgb.reshape(-1, 1, 3)).reshape(-1, 3)


def to_rgb(lab: Array) -> Array:
    """Colours (N, 3) of CIELAB in sRGB, those that a screen cannot show clipped to [0, 1]."""
    from skimage.color import lab2rgb  # noqa: PLC0415  (slow to import)

    rgb: Array = lab2rgb(lab.reshape(-1, 1, 3)).reshape(-1, 3)
    return rgb.clip(0, 1)
