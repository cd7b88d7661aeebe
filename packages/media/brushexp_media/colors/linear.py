"""Mix paint in linear light."""
# mypy: allow-untyped-defs

import torch
from torch import Tensor

from brushexp.contracts import register
from brushexp.contracts.families import ColorSpace
from brushexp.contracts.kernels import inline
from brushexp_media.colors.decoding import Decoder, F, linear_of


@inline
def _same(x):
    return x


@inline
def _one(x):
    return F(1)


DECODER = Decoder(torch.eye(3, dtype=torch.float64), torch.Tensor.clone, _same, _one)


@register("color", "linear")
class Linear(ColorSpace):
    """Mixes amounts of light (linear RGB), as coloured lights and fine dots of ink do; soft edges become lighter."""

    cost, mixes = "not measured", "light grey"

    def encode(self, color: Tensor) -> Tensor:
        return linear_of(color)

    def decode(self, picture: Tensor) -> Tensor:
        return DECODER(picture)
