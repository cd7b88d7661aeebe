"""An example of a plugin in one file: ``init=scatter`` places strokes at random.

The decorator makes the class a choice on the command line. The keyword-only parameters of ``__init__`` become typed
options with these defaults (``init.detail=0.5``). ``brushexp/plugins/init/base.py`` documents the arguments and the
result of ``__call__``.
"""

import math
from typing import Annotated

import torch
from torch import Tensor

from brushexp.contracts import above, between, register
from brushexp.contracts.families import Initializer
from brushexp.contracts.strokes import Strokes, roomy_window, strokes_along


@register("init", "scatter")
class Scatter(Initializer):
    """Place strokes at random, more densely where the picture has detail, and in random directions.

    Args:
        detail: fraction of the strokes placed in proportion to local contrast, 0 to 1; the rest is spread evenly.
        size: length and width of a stroke, in stroke spacings.
    """

    def __init__(
        self, *, detail: Annotated[float, between(0, 1)] = 0.7, size: Annotated[float, above(0, 100)] = 1.0
    ) -> None:
        self.detail = detail
        self.size = size

    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        _, height, width = target.shape
        padded = torch.nn.functional.pad(target[None], (0, 1, 0, 1), mode="replicate")[0]
        change = (padded[:, 1:, :-1] - target).abs().sum(0) + (padded[:, :-1, 1:] - target).abs().sum(0)  # (H, W)
        chance = (1 - self.detail) / (height * width) + self.detail * change / change.sum().clamp_min(1e-9)
        pixel = torch.multinomial(chance.flatten() + 1e-12, n, replacement=False, generator=generator)
        row, column = pixel // width, pixel % width
        pitch = math.sqrt(height * width / n)  # stroke spacing in pixels
        angle = math.pi * torch.rand(n, generator=generator)
        half = torch.stack([angle.cos(), angle.sin()], -1) * self.size * pitch / 2
        return strokes_along(
            torch.stack([-half, torch.zeros(n, 2), half], 1),  # pixels, relative to the positions
            self.size * pitch,
            target[:, row, column].T.contiguous(),
            0.95,
            window=roomy_window(pitch),
            position=torch.stack([column, row], -1) + 0.5,
        )
