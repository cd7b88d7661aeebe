"""Measure the perceptual distance of two pictures in the form of LPIPS, in any feature network."""

from collections.abc import Mapping, Sequence
from functools import cache

import torch
from torch import Tensor, nn

from brushexp.features import open_backbone
from brushexp.features.base import Backbone, mean_squares, packaged_file, read_tensors

# Fitted by non-negative least squares to LPIPS (AlexNet) on 392 pairs of distorted pictures; leaving out the picture
# at hand, it orders the pairs as LPIPS does at a Spearman correlation of 0.95.
WEIGHTS = {"stem": 0.42, "b8.expand": 1.13}
# The published weights of the channels (LPIPS 0.1), which come with torchmetrics, and the taps they are for.
PACKAGE, FOLDER = "torchmetrics", "functional/image/lpips_models"
CALIBRATED = {
    "alexnet": ("alex.pth", ("relu1", "relu2", "relu3", "relu4", "relu5")),
    "squeeze": ("squeeze.pth", ("relu1", "fire3", "fire5", "fire6", "fire7", "fire8", "fire9")),
    "vgg16": ("vgg.pth", ("relu1_2", "relu2_2", "relu3_3", "relu4_3", "relu5_3")),
}
OPTION = "loss.lpips.weights"  # key that errors name by default
# Added to the squared length of a feature vector: a position without any activation is the zero vector.
LEAST_SQUARED_LENGTH = 1e-8


class Distance(nn.Module):
    """Perceptual distance of two pictures: 0 for equal ones, about 1 for unlike ones.

    Source: LPIPS (Zhang et al., 2018, arXiv:1801.03924), which squares the difference of feature vectors scaled to
    length 1, averages over positions and weighs the channels of several taps. With the network ``effl0`` there is one
    weight per tap instead of one per channel; so it is called effl0, never LPIPS, and the numbers do not compare.

    The ``weights`` of each tap are (C,), or (1,) for all of its channels; ``label`` is what logs and metrics call it.
    """

    def __init__(self, network: Backbone, weights: Mapping[str, Tensor], label: str) -> None:
        super().__init__()
        self.network, self.taps, self.label = network, tuple(weights), label
        for number, weight in enumerate(weights.values()):
            self.register_buffer(f"weight{number}", weight, persistent=False)

    def look(self, picture: Tensor) -> list[Tensor]:
        """Compute unit vectors (1, C, h, w), shorter for features below 1e-4, of each tap for a picture (3, H, W)."""
        activations = self.network(picture[None], self.taps)
        features = (activations[tap] for tap in self.taps)
        return [x / (x.square().sum(1, keepdim=True) + LEAST_SQUARED_LENGTH).sqrt() for x in features]

    def compare(
        self, ours: Sequence[Tensor], theirs: Sequence[Tensor], focus: Sequence[Tensor | None] | None = None
    ) -> Tensor:
        """Compare the vectors of two pictures; ``focus`` (h, w) weighs the positions of each tap."""
        taps = zip(ours, theirs, self.buffers(recurse=False), focus or [None] * len(ours), strict=True)
        return torch.stack([(mean_squares(a, b, at) * weight).sum() for a, b, weight, at in taps]).sum()

    def forward(self, image: Tensor, target: Tensor) -> Tensor:
        return self.compare(self.look(image), self.look(target))


def open_distance(backbone: str = "effl0", weights: str | None = None, option: str = OPTION) -> Distance:
    """Open a distance in a network of `open_backbone`, LPIPS with its published weights where there are such."""
    network = open_backbone(backbone, weights, option)
    if backbone == "effl0":
        return Distance(network, {tap: torch.tensor([weight]) for tap, weight in WEIGHTS.items()}, backbone)
    file, taps = CALIBRATED[backbone]
    published = read_tensors(packaged_file(PACKAGE, f"{FOLDER}/{file}"))
    tensors = {tap: published[f"lin{number}.model.1.weight"].flatten() for number, tap in enumerate(taps)}
    return Distance(network, tensors, f"lpips-{backbone}")


@torch.no_grad()
def perceptual_distance(image: Tensor, target: Tensor) -> float:
    """Measure the distance of two pictures (3, H, W), sRGB in [0, 1], in the bundled network."""
    return float(_effl0().to(image.device)(image, target))


_effl0 = cache(open_distance)
