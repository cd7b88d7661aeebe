"""Mix paint in perceptually uniform steps."""
# mypy: allow-untyped-defs

import torch
from torch import Tensor

from brushexp.contracts import register
from brushexp.contracts.families import ColorSpace
from brushexp.contracts.kernels import inline
from brushexp_media.colors.decoding import Decoder, F, linear_of

# Response of each type of cone to linear red, green and blue (Ottosson, 2020).
CONES = torch.tensor(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ],
    dtype=torch.float64,
)
TOE = 2e-4  # light added before the cube root, whose slope is unbounded at 0
DARK = TOE ** (1 / 3)
RANGE = (1 + TOE) ** (1 / 3) - DARK


def cone_responses(channels: Tensor) -> Tensor:
    """Convert channels to cone responses."""
    return (channels * RANGE + DARK) ** 3 - TOE


@inline
def _cube(x):
    y = x * F(RANGE) + F(DARK)
    return y * y * y - F(TOE)


@inline
def _slope(x):
    y = x * F(RANGE) + F(DARK)
    return F(3 * RANGE) * y * y


DECODER = Decoder(torch.linalg.inv(CONES), cone_responses, _cube, _slope)


@register("color", "oklab")
class Oklab(ColorSpace):
    """Mixes in perceptually even steps: equal parts of two colours look midway between them (Oklab, Ottosson 2020).

    Channels are the cube roots of the responses of the three cone types. Oklab's lightness and its two opponent colours
    are linear functions of these, so compositing gives the same result with either set of channels. Unlike in the
    source, a small amount of light (2e-4) is added before the roots are taken.
    """

    cost, mixes = "not measured", "grey"

    def encode(self, color: Tensor) -> Tensor:
        response = linear_of(color) @ CONES.T.to(color)
        return ((response + TOE).pow(1 / 3) - DARK) / RANGE

    def decode(self, picture: Tensor) -> Tensor:
        return DECODER(picture)
