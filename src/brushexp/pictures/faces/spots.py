"""Find conspicuous small dark spots, such as the eyes of animals."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from brushexp.pictures.face import Face
from brushexp.pictures.load import BRIGHTNESS, downsample

SIDE = 512  # pixels on the longer side at which spots are sought
SIGMAS = (0.003, 0.0045, 0.0068, 0.01, 0.015)  # standard deviations of the Gaussians for spots, in longer sides
AROUND = 4.0  # standard deviation, in sigmas, of the Gaussian that measures the detail around a spot
CALM_DETAIL = 0.01  # strength below which detail around a spot is ignored
WEAKEST_SPOT = 1e-3  # strength of the weakest spot
SPOTS_APART = 6.0  # smallest distance between two spots, in sigmas of the larger one
SPOT_RADIUS = 3.5  # sigmas, radius of a spot with its immediate surroundings
MIDDLE, RING = 1.0, (2.5, 4.0)  # sigmas, radius of the middle of a spot, and radii of the ring around it
LEAST_CONTRAST = 0.45  # smallest difference between ring and middle of a spot, relative to the ring
TINY = 1e-9  # prevents division by zero where luma is constant
MOST_SPOTS = 12  # maximum number of spots in a picture or a head
EYE_SIGMAS = (0.01, 0.015, 0.022, 0.033)  # like `SIGMAS`, for spots in the square around a head
AROUND_HEAD = 0.9  # half the side of this square, in sides of the head
IN_HEAD = 0.6  # distance from the middle of a head at which the weight of a spot falls to 1/e, in sides of the head
MOST_HEADS = 3  # maximum number of heads that are searched for eyes


@dataclass(frozen=True)
class Spot:
    """A round, dark spot at (``x``, ``y``); ``radius``, in pixels, includes its immediate surroundings."""

    x: float
    y: float
    radius: float


def find_spots(picture: Tensor, attended: Tensor, scales: Sequence[float] = SIGMAS) -> list[Spot]:
    """Find up to `MOST_SPOTS` small dark spots in a picture (3, H, W), weighted by attention (H, W) in [0, 1].

    A spot is a maximum, over position and size, of the smaller eigenvalue of the scale-normalised Hessian of luma
    (Lindeberg, 1998), so it is dark and round. Its strength is divided by the strength of the surrounding detail, which
    favours isolated spots, and multiplied by the attention, which favours places where people look first. A spot whose
    contrast is below `LEAST_CONTRAST` is ignored.
    """
    from scipy.ndimage import gaussian_filter, maximum_filter  # noqa: PLC0415  (slow to import)

    small = downsample(picture.detach().cpu().float(), SIDE)
    zoom = max(picture.shape[1:]) / max(small.shape[1:])
    luma = np.tensordot(BRIGHTNESS, small.double().numpy(), 1)
    weight = functional.adaptive_avg_pool2d(attended[None].float(), luma.shape)[0].double().numpy()
    sigmas = [share * max(luma.shape) for share in scales]
    strengths = []
    for sigma in sigmas:
        across = sigma**2 * gaussian_filter(luma, sigma, order=(0, 2))
        down = sigma**2 * gaussian_filter(luma, sigma, order=(2, 0))
        aslant = sigma**2 * gaussian_filter(luma, sigma, order=(1, 1))
        mean = (across + down) / 2
        apart = np.hypot((across - down) / 2, aslant)
        least = (mean - apart).clip(0)  # eigenvalue: contrast to the surroundings, in any direction
        roundness = np.sqrt(least / (mean + apart).clip(TINY))
        busy = np.sqrt(gaussian_filter((2 * mean) ** 2, AROUND * sigma))
        strengths.append(weight * least**2 * roundness / (busy + CALM_DETAIL))
    strength = np.stack(strengths)
    peaks = np.argwhere((strength == maximum_filter(strength, size=(3, 5, 5))) & (strength > WEAKEST_SPOT))
    found: list[tuple[float, float, float]] = []
    for scale, row, column in sorted(peaks.tolist(), key=lambda peak: -strength[tuple(peak)]):
        x, y, sigma = column + 0.5, row + 0.5, sigmas[scale]
        if len(found) == MOST_SPOTS:
            break
        is_apart = all(math.hypot(x - a, y - b) > SPOTS_APART * max(sigma, c) for a, b, c in found)
        if is_apart and contrast_of_spot(luma, x, y, sigma) > LEAST_CONTRAST:
            found.append((x, y, sigma))
    return [Spot(zoom * x, zoom * y, zoom * SPOT_RADIUS * sigma) for x, y, sigma in found]


def contrast_of_spot(luma: np.ndarray, x: float, y: float, sigma: float) -> float:
    """Compute how much darker a spot at (x, y) is than its surroundings in luma (H, W), relative to the surroundings.

    The spot is the disc of radius `MIDDLE` sigmas and the surroundings are a ring; each has at least one pixel.
    """
    reach = math.ceil(RING[1] * sigma) + 1
    top, left = max(0, int(y) - reach), max(0, int(x) - reach)
    around = luma[top : int(y) + reach + 1, left : int(x) + reach + 1]
    rows, columns = np.ogrid[: around.shape[0], : around.shape[1]]
    distance = np.hypot(rows + top + 0.5 - y, columns + left + 0.5 - x)
    middle = around[distance <= max(MIDDLE * sigma, 1.0)].mean()
    ring = around[(distance >= RING[0] * sigma) & (distance <= RING[1] * sigma + 1)].mean()
    return float((ring - middle) / max(ring, TINY))


def find_eyes(picture: Tensor, heads: Sequence[Face]) -> list[Spot]:
    """Find up to `MOST_SPOTS` dark spots, the likely eyes, in each of the first `MOST_HEADS` animal heads."""
    height, width = picture.shape[1:]
    eyes = []
    for head in heads[:MOST_HEADS]:
        reach = AROUND_HEAD * head.side
        top, bottom = max(0, round(head.y - reach)), min(height, round(head.y + reach))
        left, right = max(0, round(head.x - reach)), min(width, round(head.x + reach))
        if top >= bottom or left >= right:
            continue
        y, x = torch.arange(top, bottom) + 0.5 - head.y, torch.arange(left, right) + 0.5 - head.x
        distance = torch.hypot(y[:, None], x) / (IN_HEAD * head.side)
        found = find_spots(picture[:, top:bottom, left:right], (-(distance**4)).exp(), EYE_SIGMAS)
        eyes += [replace(spot, x=spot.x + left, y=spot.y + top) for spot in found]
    return eyes
