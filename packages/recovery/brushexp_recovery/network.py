"""The network says of each pixel to which neighbours it belongs, and what the stroke is like that is seen there."""

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

DISTANCES = (3, 8, 20)  # pixels, beyond the nearest neighbours
OFFSETS = ((0, 1), (1, 0), *(o for d in DISTANCES for o in ((0, d), (d, 0), (d, d), (d, -d))))  # rows, columns
OVER = OFFSETS[2:10]  # at which is said which of two strokes lies on top
AFFINE = len(OFFSETS)
UNIT = 32.0  # pixels of the offset to the centre
PAINT, CENTRE, TURN, WIDTH, LENGTH, SHARE = 0, slice(1, 3), slice(3, 5), 5, 6, 7  # maps of the geometry
GEOMETRY = 8
CHANNELS = AFFINE + GEOMETRY + len(OVER)
WIDTHS = (24, 40, 64, 96, 128, 128)  # channels at full resolution, half, ...
STRIDE = 2 ** (len(WIDTHS) - 1)  # pixels: sides of what the network takes are multiples
USUAL = 14.0  # pixels: width of strokes at which pictures are shown to the network
FIRST_GUESS = {"paint": 1.5, "width": 2.5, "length": 3.8, "next": 1.0}  # of the outputs that are far from 0


class Block(nn.Module):
    """Two convolutions beside a shortcut (He et al., 2016)."""

    def __init__(self, before: int, after: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(before, after, 3, padding=1, bias=False), nn.BatchNorm2d(after), nn.ReLU(True),
            nn.Conv2d(after, after, 3, padding=1, bias=False), nn.BatchNorm2d(after),
        )  # fmt: skip
        self.skip = nn.Conv2d(before, after, 1)

    def forward(self, x: Tensor) -> Tensor:
        return self.body(x).add_(self.skip(x)).relu_()  # in place: a large picture's layers are large, too


class StrokeNetwork(nn.Module):
    """A U-Net (Ronneberger et al., 2015) from pictures (B, 3, H, W) in [0, 1] to maps (B, `CHANNELS`, H, W).

    H and W are multiples of `STRIDE`. The maps are log-odds that the pixel at each of the `OFFSETS` is of the same
    stroke; geometry: log-odds of paint, offset to the centre of the stroke (x, y, in `UNIT` pixels), cosine and sine of
    twice its direction, log of its width and length in pixels, log-odds of the share of it that is seen; and log-odds
    that the stroke at each offset of `OVER` lies above the one here. Affinities as in Lee et al. (2017,
    arXiv:1706.00120).
    """

    def __init__(self) -> None:
        super().__init__()
        before = (3, *WIDTHS[:-1])
        self.down = nn.ModuleList(Block(a, b) for a, b in zip(before, WIDTHS, strict=True))
        self.reduce = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in pairwise(WIDTHS))
        self.up = nn.ModuleList(Block(2 * width, width) for width in WIDTHS[:-1])
        self.pool = nn.MaxPool2d(2)
        self.out = nn.Conv2d(WIDTHS[0], CHANNELS, 1)
        with torch.no_grad():
            self.out.bias.zero_()  # type: ignore[union-attr]
            places = {"paint": AFFINE + PAINT, "width": AFFINE + WIDTH, "length": AFFINE + LENGTH, "next": slice(2)}
            for name, guess in FIRST_GUESS.items():
                self.out.bias[places[name]] = guess  # type: ignore[index]

    def forward(self, x: Tensor) -> Tensor:
        x, skips = 4 * (x - 0.5), []
        for level, down in enumerate(self.down):
            x = down(self.pool(x) if level else x)
            skips.append(x)
        skips.pop()
        for level in range(len(self.up) - 1, -1, -1):  # without names: what has been put together is freed
            x = torch.cat([interpolate(self.reduce[level](x), scale_factor=2, mode="nearest"), skips.pop()], 1)
            x = self.up[level](x)
        return self.out(x)
