"""Compare pictures in the feature space of a network."""

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

SHIFTS = ((0, 0), (1, 2), (2, 1), (3, 3))  # (x, y) in pixels, modulo jitter + 1; each column and row appears once


@register("loss", "perceptual")
class Perceptual(Loss):
    """Perceptual loss (Johnson et al.): mean squared difference between the network features of two pictures.

    Source: thesis 2020, eq. 6.23, which uses the fourth block of VGG16 and sums over the C channels of a tap, so that
    its loss is C times as large. Unlike in the source, the default network is the bundled ``effl0``; several taps have
    equal weights; and the pictures are jittered, because a network with a stride of two pixels cannot detect errors of
    that period (3 pixels of jitter alone raised the PSNR of two pictures by 1.5 dB).

    Args:
        weight: factor in the sum of losses. With the default, the gradient with respect to the picture is about as long
            as that of ``mse`` for pictures of 256 pixels blurred by two pixels; depending on picture and blur, weights
            of 0.0009 to 0.0024 achieve this.
        backbone: feature network: effl0, or vgg16, alexnet or squeeze, which need ``weights``.
        weights: file with the network's weights; null uses those of its package.
        taps: activations to compare; null or [] uses the network's own choice, b3.expand or relu4_3.
        jitter: largest shift of both pictures in pixels, 0 to 3. Calls cycle through at most four fixed shifts;
            use 0 with an optimiser that does a line search, because the loss differs between calls.
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
        self.register_buffer("calls", torch.zeros((), dtype=torch.long))  # the count continues after a restart
        self.context, self.grid = self.network.context, self.network.grid

    def forward(self, view: PaintedView) -> Tensor:
        shift = self.shifts[int(self.calls) % len(self.shifts)]
        self.calls += 1
        theirs = self.of_target(view.target, lambda target: self._features(target, shift), key=shift)
        pairs = zip(self._features(view.image, shift), theirs, strict=True)
        terms = [mean_squares(a, b, view.weights(a)).mean() for a, b in pairs]
        return torch.stack(terms).mean() * (self._enlargement(view.image) / self._enlargement(view.whole_target))

    def _enlargement(self, picture: Tensor) -> float:
        """Compute the factor by which the margin for shifts enlarges the picture's area."""
        return math.prod((side + self.jitter) / side for side in picture.shape[1:])

    def _features(self, picture: Tensor, shift: tuple[int, int]) -> list[Tensor]:
        padding = (shift[0], self.jitter - shift[0], shift[1], self.jitter - shift[1])
        features = self.network(functional.pad(picture[None], padding, mode="replicate"), self.taps)
        return [features[tap] for tap in self.taps]
