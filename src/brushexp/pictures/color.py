"""Match the colours of pictures, convert them to CIELAB, and reduce them to a few inks."""

import warnings

import numpy as np
import torch
from torch import Tensor

LEAST_VARIANCE = 1 / 255**2  # a level of 8 bits, squared; below this variance a picture has one colour
MOST_GAIN = 8.0  # largest gain; more would spread the noise of a nearly even picture into its content
ROUNDS = 100  # rounds of k-means, which settles in a dozen

Array = np.ndarray


def recolor(picture: Tensor, like: Tensor) -> Tensor:
    """Map the colours of a picture (3, H, W) linearly to the mean and covariance of another picture's colours.

    Source: Gatys et al. (2016), "Preserving color in neural artistic style transfer", arXiv:1606.05897, "image
    analogies" variant: x -> A (x - mean) + mean_like with A = S_like^(1/2) S^(-1/2), where S and S_like are
    covariances, so that A S A = S_like. Unlike in the source, S^(-1/2) uses standard deviations of at least one grey
    level, and no direction is stretched more than 8 times, so that a uniform picture gives a finite result with
    little noise.
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
    """Compute the mean (3, 1) and the covariance (3, 3) of a picture's colours, in double precision."""
    colors = picture.flatten(1).to(torch.float64)
    mean = colors.mean(1, keepdim=True)
    offset = colors - mean
    return mean, offset @ offset.T / colors.shape[1]


def palette(lab: Array, weight: Array, count: int) -> Array:
    """Find the best inks (K <= count, 3) for reproducing a picture, with k-means in CIELAB (Lloyd, 1982).

    ``weight`` (N,) >= 0 is the fraction of the picture covered by each of the colours ``lab`` (N, 3). Inks are added
    one by one at the colour with the largest error, so the result is deterministic and no ink increases the error.
    """
    lab, weight = lab[weight > 0], weight[weight > 0]
    if len(lab) == 0:
        return np.empty((0, 3))
    inks = np.average(lab, axis=0, weights=weight)[None]
    while True:
        inks = _refine_inks(lab, weight, inks)
        error = weight * np.square(lab - inks[nearest_ink(lab, inks)]).sum(1)
        if len(inks) == count or error.max() <= 1e-9 * weight.max():
            return inks
        inks = np.concatenate([inks, lab[[error.argmax()]]])


def nearest_ink(lab: Array, inks: Array) -> Array:
    """Find the index (N,) of the nearest of K inks (K, 3) for each colour (N, 3)."""
    return (np.square(inks).sum(1) - 2 * lab @ inks.T).argmin(1)  # squared distances without |lab|^2


def _refine_inks(lab: Array, weight: Array, inks: Array) -> Array:
    """Repeatedly move each ink to the mean of the colours assigned to it."""
    chosen = nearest_ink(lab, inks)
    for _ in range(ROUNDS):
        share = np.bincount(chosen, weight, len(inks))[:, None]
        total = np.stack([np.bincount(chosen, weight * channel, len(inks)) for channel in lab.T], axis=1)
        inks = np.where(share > 0, total / np.maximum(share, np.finfo(float).tiny), inks)
        before, chosen = chosen, nearest_ink(lab, inks)
        if np.array_equal(before, chosen):
            break
    return inks


def hex_of(color: Array) -> str:
    """Format a colour (3,) in [0, 1] as ``#rrggbb``; halves are rounded up, as `to_bytes` does."""
    return "#" + (np.nan_to_num(color).clip(0, 1) * 255 + 0.5).astype("u1").tobytes().hex()


def to_lab(rgb: Array) -> Array:
    """Convert sRGB colours (N, 3) in [0, 1] to CIELAB."""
    from skimage.color import rgb2lab  # noqa: PLC0415  (slow to import)

    return rgb2lab(rgb.reshape(-1, 1, 3)).reshape(-1, 3)


def to_rgb(lab: Array) -> Array:
    """Convert CIELAB colours (N, 3) to sRGB, clipped to [0, 1]."""
    from skimage.color import lab2rgb  # noqa: PLC0415  (slow to import)

    with warnings.catch_warnings():  # warnings about colours outside sRGB
        warnings.simplefilter("ignore", UserWarning)
        rgb: Array = lab2rgb(lab.reshape(-1, 1, 3)).reshape(-1, 3)
    return rgb.clip(0, 1)


def as_lab(picture: Tensor) -> Array:
    """Convert a picture (3, H, W) to CIELAB (H, W, 3)."""
    rgb = picture.movedim(0, -1).double().numpy()
    return to_lab(rgb.reshape(-1, 3)).reshape(rgb.shape)


def as_picture(lab: Array) -> Tensor:
    """Convert CIELAB (H, W, 3) to a picture (3, H, W), float32, clipping colours outside the sRGB gamut."""
    rgb = to_rgb(lab.reshape(-1, 3)).reshape(lab.shape)
    return torch.from_numpy(rgb).movedim(-1, 0).float().contiguous()
