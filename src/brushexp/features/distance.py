"""How far apart two pictures look, measured by the bundled network."""

from functools import cache

import torch
from torch import Tensor

from brushexp.features import open_backbone
from brushexp.features.base import Backbone

# Fitted by non-negative least squares to LPIPS (AlexNet) on 392 pairs of distorted pictures; leaving out the picture
# at hand, it orders the pairs as LPIPS does at a Spearman correlation of 0.95.
WEIGHTS = {"stem": 0.42, "b8.expand": 1.13}
FLOOR = 1e-10  # under the length of a feature vector: a position without any activation counts as the zero vector


@torch.no_grad()
def effl0_distance(image: Tensor, target: Tensor) -> float:
    """Perceptual distance of two pictures (3, H, W), sRGB in [0, 1]; 0 for equal ones, about 1 for unlike ones.

    Squared difference of the feature vectors, each scaled to length 1, averaged over positions and summed over the
    taps: the form of LPIPS (Zhang et al., 2018, arXiv:1801.03924). Differs from the source: another network, and one
    weight per tap instead of one per channel; so it is called effl0, never LPIPS, and the numbers do not compare.
    """
    network = _network(image.device)
    ours, theirs = network(image[None], WEIGHTS), network(target[None], WEIGHTS)
    return sum(weight * _apart(ours[tap], theirs[tap]) for tap, weight in WEIGHTS.items())


def _apart(a: Tensor, b: Tensor) -> float:
    """Mean over positions of the squared difference of unit vectors; a and b (1, C, h, w)."""
    a, b = (x / (x.norm(dim=1, keepdim=True) + FLOOR) for x in (a, b))
    return float((a - b).square().sum(1).mean())


@cache
def _network(device: torch.device) -> Backbone:
    return open_backbone("effl0").to(device)
