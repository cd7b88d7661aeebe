"""Palette plugin in a single file: ``palette=sepia``."""

from typing import Annotated

import torch
from torch import Tensor

from brushexp.contracts import between, register
from brushexp.contracts.families import Palette

INK = (0.36, 0.23, 0.13)


@register("palette", "sepia")
class Sepia(Palette):
    """Brown tones from dark ink to white paper, as in old photographs.

    Args:
        share: strength of the sepia tone; 0 keeps the picture unchanged.
    """

    def __init__(self, *, share: Annotated[float, between(0, 1)] = 1.0) -> None:
        self.share = share

    def __call__(self, picture: Tensor) -> Tensor:
        light = picture.mean(0, keepdim=True)
        return torch.lerp(
            picture, torch.lerp(picture.new_tensor(INK)[:, None, None], torch.ones_like(light), light), self.share
        )
