"""A loss that compares the features of a network."""

import math
from typing import Annotated

import torch
from torch import Tensor
from torch.nn import functional

from brushexp.bounds import FILE, between, one_of
from brushexp.features import NETWORKS, open_backbone
from brushexp.features.base import mean_squares
from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.registry import register

# Four shifts (x, y) in pixels in which each column and each row appears once, taken modulo jitter + 1.
SHIFTS = ((0, 0), (1, 2), (2, 1), (3, 3))


@register("loss", "perceptual")
class Perceptual(Loss):
    """Perceptual loss (Johnson et al.): mean squared difference of the features of a network.

    Source: thesis 2020, eq. 6.23, which takes the fourth block of VGG16. Differs from it: the default network is the
    small one that is always there (``effl0``); several taps count alike; and the picture is jittered, because a
    network whose first step is two pixels wide lets errors of that period pass unseen (alone, 3 pixels of jitter gave
    a PSNR 1.5 dB higher than none, on two pictures).

    Args:
        weight: factor in the sum of losses. With the default, the gradient in the picture is about as long as that of
            ``mse`` for pictures of 256 pixels blurred by two (0.0009 to 0.0024, by picture and blur).
        backbone: feature network: effl0, or vgg16, alexnet, squeeze (need ``weights``).
        weights: file with the network's weights; null takes those of its package.
        taps: activations to compare; null or [] takes the network's own choice, b3.expand or relu4_3.
        jitter: largest shift in pixels, 0 (none) to 3, that painting and target take together. It goes through at most
            four fixed shifts, one per call, so that the target's features are computed once for each. The value then
            depends on the call: set 0 for an optimiser with a line search.
    """

    weight = 0.0015
    cost = "3.8 x mse"
    exact_on_parts = False
    calls: Tensor

    def __init__(
        self,
        *,
        backbone: Annotated[str, one_of(*NETWORKS)] = "effl0",
        weights: Annotated[str | None, FILE] = None,
        taps: list[str] | None = None,
        jitter: Annotated[int, between(0, 3)] = 3,
    ) -> None:
        super().__init__()
        self.network = open_backbone(backbone, weights)
        self.taps = list(taps or self.network.default_taps)
        self.network.check(self.taps)
        self.jitter = jitter
        self.shifts = sorted({(x % (jitter + 1), y % (jitter + 1)) for x, y in SHIFTS})
        self.register_buffer("calls", torch.zeros((), dtype=torch.long))  # which shift is next, also after a restart
        self.context, self.grid = self.network.context, self.network.grid

    def forward(self, view: PaintedView) -> Tensor:
        shift = self.shifts[int(self.calls) % len(self.shifts)]
        self.calls += 1
        wanted = self.of_target(view.target, lambda target: self._features(target, shift), key=shift)
        terms = [
            mean_squares(ours, theirs, view.weights(ours)).mean()
            for ours, theirs in zip(self._features(view.image, shift), wanted, strict=True)
        ]
        return torch.stack(terms).mean() * (self._enlarged(view.image) / self._enlarged(view.whole_target))

    def _enlarged(self, picture: Tensor) -> float:
        """By how much the margin for the shifts makes a picture larger, so that a part counts by its own pixels."""
        return math.prod((side + self.jitter) / side for side in picture.shape[1:])

    def _features(self, picture: Tensor, shift: tuple[int, int]) -> list[Tensor]:
        """Features of a picture (3, H, W) moved by ``shift``; its border is repeated, its size the same for all."""
        padding = (shift[0], self.jitter - shift[0], shift[1], self.jitter - shift[1])
        found = self.network(functional.pad(picture[None], padding, mode="replicate"), self.taps)
        return [found[tap] for tap in self.taps]
