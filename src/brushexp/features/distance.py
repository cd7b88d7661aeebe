"""Measure an LPIPS-style perceptual distance between two pictures."""

from collections.abc import Mapping, Sequence
from functools import cache

import torch
from torch import Tensor, nn

from brushexp.features import open_backbone
from brushexp.features.base import OPTION, Backbone, mean_squares

# Fitted by non-negative least squares to LPIPS (AlexNet) on 392 pairs of distorted pictures, without human judgements.
WEIGHTS = {"stem": 0.42, "b8.expand": 1.13}
# Added to the squared length of a feature vector: a position without any activation is the zero vector.
LEAST_SQUARED_LENGTH = 1e-8


class Distance(nn.Module):
    """Perceptual distance between two pictures: 0 if they are equal, about 1 if they have nothing in common.

    Source: LPIPS (Zhang et al., 2018, arXiv:1801.03924), which squares the differences between feature vectors scaled
    to length 1, averages over positions, and weights the channels of several taps. The distance based on the network
    ``effl0`` has one weight per tap instead of one per channel, so it is called effl0, never LPIPS, and the two are not
    comparable.

    The ``weights`` for each tap are (C,), or (1,) for all channels; ``label`` names the distance in logs and metrics.
    """

    def __init__(self, network: Backbone, weights: Mapping[str, Tensor], label: str) -> None:
        super().__init__()
        self.network, self.taps, self.label = network, tuple(weights), label
        for number, weight in enumerate(weights.values()):
            self.register_buffer(f"weight{number}", weight, persistent=False)

    def look(self, picture: Tensor) -> list[Tensor]:
        """Compute each tap's feature vectors (1, C, h, w) for a picture (3, H, W), scaled to length 1.

        Vectors that are shorter than about 1e-4 before scaling stay shorter than 1.
        """
        activations = self.network(picture[None], self.taps)
        features = (activations[tap] for tap in self.taps)
        return [x / (x.square().sum(1, keepdim=True) + LEAST_SQUARED_LENGTH).sqrt() for x in features]

    def compare(
        self, ours: Sequence[Tensor], theirs: Sequence[Tensor], focus: Sequence[Tensor | None] | None = None
    ) -> Tensor:
        """Compute the distance between two pictures from their vectors; ``focus`` (h, w) weights a tap's positions."""
        taps = zip(ours, theirs, self.buffers(recurse=False), focus or [None] * len(ours), strict=True)
        return torch.stack([(mean_squares(a, b, at) * weight).sum() for a, b, weight, at in taps]).sum()

    def forward(self, image: Tensor, target: Tensor) -> Tensor:
        return self.compare(self.look(image), self.look(target))


def bundled_distance(weights: str | None = None, option: str = OPTION) -> Distance:
    """Return the distance based on the bundled network, with its own weights or those in the ``weights`` file."""
    network = open_backbone("effl0", weights, option)
    return Distance(network, {tap: torch.tensor([weight]) for tap, weight in WEIGHTS.items()}, "effl0")


@torch.no_grad()
def perceptual_distance(image: Tensor, target: Tensor) -> float:
    """Measure the distance between two pictures (3, H, W), sRGB in [0, 1], with the bundled network."""
    return float(_bundled().to(image.device)(image, target))


_bundled = cache(bundled_distance)
