"""The critic of adversarial training, and what critic and renderer are told by it."""

import torch
from torch import Tensor, nn
from torch.nn import functional

SLOPE = 0.2  # of the leaky ReLU
SMALLEST = 4  # pixels on the side of what the dense layers see
WIDEST = 256
DENSE = (256, 64)


def relativistic_loss(above: Tensor, below: Tensor) -> Tensor:
    """RaSGAN (Jolicoeur-Martineau, 2018, arXiv:1807.00734): small when ``above`` scores higher than ``below``.

    -E[log sigma(D(a) - E D(b))] - E[log(1 - sigma(D(b) - E D(a)))], through softplus, so that it is finite for any
    score. The critic minimises it with the true pictures above the drawn ones, the renderer with the drawn ones above.
    Scores (n,) and (m,) are before any sigmoid. Differs from the thesis (4.6 to 4.10): there a bracket is misplaced.
    """
    return functional.softplus(below.mean() - above).mean() + functional.softplus(below - above.mean()).mean()


class Critic(nn.Module):
    """VGG encoder: three convolutions and pooling until 4 x 4 pixels, then three dense layers to one number.

    Source: thesis 2020, 6.2. The ``window`` has 4 times a power of two pixels; there are ``width`` channels at full
    size and twice as many after each pooling, at most 256.
    """

    def __init__(self, window: int, width: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        before, side = 4, window
        while side > SMALLEST:
            channels = min(width * window // side, WIDEST)
            for _ in range(3):
                layers += [nn.Conv2d(before, channels, 3, padding=1), nn.LeakyReLU(SLOPE)]
                before = channels
            layers.append(nn.AvgPool2d(2))
            side //= 2
        layers.append(nn.Flatten())
        sizes = [before * SMALLEST**2, *DENSE]
        for inputs, outputs in zip(sizes, DENSE, strict=False):
            layers += [nn.Linear(inputs, outputs), nn.LeakyReLU(SLOPE)]
        layers.append(nn.Linear(DENSE[-1], 1))
        self.layers = nn.Sequential(*layers)
        for convolution in (layer for layer in layers if isinstance(layer, nn.Conv2d)):
            nn.init.kaiming_normal_(convolution.weight, a=SLOPE)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # a fifth faster on a processor

    def forward(self, pictures: Tensor) -> Tensor:
        """Raw scores (n,) of premultiplied RGBA (n, 4, S, S)."""
        scores: Tensor = self.layers(2 * pictures - 1)[:, 0]
        return scores.float()
