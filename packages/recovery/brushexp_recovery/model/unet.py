"""Define the U-Net that predicts each pixel's stroke attributes, and which of its neighbours are in the same stroke."""

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

from brushexp_recovery.model.channels import ATTRIBUTES, CHANNELS, PAINT, StrokeAttribute

LEVEL_CHANNELS = (24, 40, 64, 96, 128, 128)  # number of channels at full resolution, half, ...
STRIDE = 2 ** (len(LEVEL_CHANNELS) - 1)  # divisor of the sides in pixels of the network's inputs
TRAINED_WIDTH = 14.0  # width of strokes in the network's inputs in pixels
FIRST_BIAS = {  # initial bias of outputs whose mean is far from 0
    "adjacent affinity": (slice(0, 2), 1.0),
    "paint": (PAINT, 1.5),
    "log width": (ATTRIBUTES.start + StrokeAttribute.LOG_WIDTH, 2.5),
    "log length": (ATTRIBUTES.start + StrokeAttribute.LOG_LENGTH, 3.8),
}


class ResidualBlock(nn.Module):
    """Two convolutions with a shortcut connection (He et al., 2016)."""

    def __init__(self, before: int, after: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(before, after, 3, padding=1, bias=False),
            nn.BatchNorm2d(after),
            nn.ReLU(True),
            nn.Conv2d(after, after, 3, padding=1, bias=False),
            nn.BatchNorm2d(after),
        )
        self.skip = nn.Conv2d(before, after, 1)

    def forward(self, x: Tensor) -> Tensor:
        return self.body(x).add_(self.skip(x)).relu_()  # in place, because the layers of a large picture are large


class StrokeNetwork(nn.Module):
    """A U-Net (Ronneberger et al., 2015) from pictures (B, 3, H, W) in [0, 1] to maps (B, `CHANNELS`, H, W).

    H and W must be multiples of `STRIDE`. The maps are, in the order of `channels`:

    - affinities, as in Lee et al. (2017, arXiv:1706.00120): log-odds that the pixel at each of the `AFFINITY_OFFSETS`
      belongs to the same stroke as this pixel;
    - log-odds that this pixel is paint;
    - each `StrokeAttribute` of the stroke visible at this pixel;
    - occlusions: log-odds that the stroke at each of the `OCCLUSION_OFFSETS` is above the stroke at this pixel.
    """

    def __init__(self) -> None:
        super().__init__()
        before = (3, *LEVEL_CHANNELS[:-1])
        self.down = nn.ModuleList(ResidualBlock(a, b) for a, b in zip(before, LEVEL_CHANNELS, strict=True))
        self.reduce = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in pairwise(LEVEL_CHANNELS))
        self.up = nn.ModuleList(ResidualBlock(2 * width, width) for width in LEVEL_CHANNELS[:-1])
        self.pool = nn.MaxPool2d(2)
        self.out = nn.Conv2d(LEVEL_CHANNELS[0], CHANNELS, 1)
        with torch.no_grad():
            self.out.bias.zero_()  # type: ignore[union-attr]
            for channels, value in FIRST_BIAS.values():
                self.out.bias[channels] = value  # type: ignore[index]

    def forward(self, x: Tensor) -> Tensor:
        x = 4 * (x - 0.5)
        skips = []
        for level, down in enumerate(self.down):
            x = down(self.pool(x) if level else x)
            skips.append(x)
        skips.pop()
        for level in range(len(self.up) - 1, -1, -1):  # no variables, so that concatenated layers are freed
            x = torch.cat([interpolate(self.reduce[level](x), scale_factor=2, mode="nearest"), skips.pop()], 1)
            x = self.up[level](x)
        return self.out(x)
