"""Mix paint as pigments, by multiplying rather than adding reflectances in seven spectral bands."""
# mypy: allow-untyped-defs

import math

import torch
from torch import Tensor

from brushexp.contracts import register
from brushexp.contracts.families import ColorSpace
from brushexp.contracts.kernels import inline
from brushexp_media.colors.decoding import Decoder, F, linear_of

# Share of light reflected by paints of pure colours, in bands from violet to red; white reflects all light. Chosen by
# benchmarks/pigments.py to be smooth, with mixtures of two paints close to those that painters know.
REFLECTANCE = torch.tensor(
    [
        [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0],  # white
        [0.9630, 0.8462, 0.9687, 0.7685, 0.3292, 0.0459, 0.0334],  # cyan
        [0.9401, 0.8405, 0.4552, 0.2322, 0.7243, 0.9424, 0.9734],  # magenta
        [0.0266, 0.1039, 0.4187, 0.8803, 0.9663, 0.9733, 0.9663],  # yellow
        [0.0259, 0.0522, 0.0346, 0.1098, 0.5823, 0.8979, 0.9735],  # red
        [0.0576, 0.0974, 0.6515, 0.7759, 0.4732, 0.0823, 0.0343],  # green
        [0.9662, 0.9184, 0.5221, 0.1474, 0.0267, 0.0337, 0.0267],  # blue
    ],
    dtype=torch.float64,
)
PURE = [[1, 1, 1], [0, 1, 1], [1, 0, 1], [1, 1, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]  # linear RGB of these paints
BAND_COLORS = torch.linalg.solve(
    REFLECTANCE, torch.tensor(PURE, dtype=torch.float64)
).T  # (3, 7): linear RGB of each band
DEEPEST = 0.01  # share of light reflected by the blackest paint, which sets the effect of black in mixtures
DEPTH = math.log((1 + DEEPEST) / DEEPEST)


def reflectances_of(channels: Tensor) -> Tensor:
    """Convert channels to the reflected fraction of light in each band."""
    return (1 + DEEPEST) * (DEPTH * (channels - 1)).exp() - DEEPEST


@inline
def _power(x):
    """Compute exp(DEPTH (x - 1)) for x in [0, 1] as the 16th power of a truncated series for its 16th root."""
    y = (x - F(1)) * F(DEPTH / 16)
    y = F(1) + y * (F(1) + y * (F(1 / 2) + y * (F(1 / 6) + y * (F(1 / 24) + y * (F(1 / 120) + y * F(1 / 720))))))
    y = y * y
    y = y * y
    y = y * y
    return y * y


@inline
def _reflect(x):
    return F(1 + DEEPEST) * _power(x) - F(DEEPEST)


@inline
def _slope(x):
    return F(DEPTH * (1 + DEEPEST)) * _power(x)


DECODER = Decoder(BAND_COLORS, reflectances_of, _reflect, _slope)


@register("color", "pigment")
class Pigment(ColorSpace):
    """Mixes like paint (yellow over blue gives green): the weighted geometric mean of reflectances in seven bands.

    A colour is split into white and two of six pure paints, whose reflectances are mixed (Smits, 1999, "An RGB to
    spectrum conversion for reflectances"); the channels are the logarithms of the mixed reflectances. Compositing the
    channels gives the weighted geometric mean, as in MyPaint. Kubelka and Munk's theory instead averages ratios of
    absorption to scattering, which gives darker paint more weight. Reflectances in the bands were not measured but
    chosen to give plausible mixtures; the blackest paint reflects 1 %.
    """

    cost, mixes = "1.5", "green"

    def encode(self, color: Tensor) -> Tensor:
        reflected = paints(linear_of(color)) @ REFLECTANCE.to(color)
        return ((reflected + DEEPEST) / (1 + DEEPEST)).log() / DEPTH + 1

    def decode(self, picture: Tensor) -> Tensor:
        return DECODER(picture)


def paints(light: Tensor) -> Tensor:
    """Split linear RGB (..., 3) into amounts (..., 7) of white and six pure paints; at most three are nonzero."""
    white = light.amin(-1)
    red, green, blue = (light - white[..., None]).unbind(-1)
    cyan, magenta, yellow = torch.minimum(green, blue), torch.minimum(red, blue), torch.minimum(red, green)
    pure = red - magenta - yellow, green - cyan - yellow, blue - cyan - magenta
    return torch.stack([white, cyan, magenta, yellow, *(amount.clamp_min(0) for amount in pure)], dim=-1)
