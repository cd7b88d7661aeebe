"""An example of a neural renderer in one file: ``renderer=dual`` predicts the shape of a stroke but not its colour.

The shape of paint does not depend on its colour, so the network does not need to learn colours. It receives only the
seven shape parameters and draws two planes, a mask (alpha) and a shading; the exact colour is applied afterwards.

The framework does the rest: `PatchRenderer` moves the parameters into the training range, calls `draw`, places the
windows on the canvas and saves memory; `restore` loads the weights in ``checkpoint``;
``brushexp task=train renderer=dual data=data/fluid`` trains the network;
``brushexp renderer=dual renderer.checkpoint=outputs/x/dual.safetensors`` paints with it.
"""

from itertools import pairwise
from typing import Annotated

import torch
from torch import Tensor, nn
from torch.nn import functional

from brushexp.contracts import between, multiple_of, one_of, register
from brushexp.contracts.families import PRECISIONS, PatchRenderer


@register("renderer", "dual")
class Dual(PatchRenderer):
    """A network for the shape only, with the exact colour applied on top; plugins/dual.py shows how to add a renderer.

    Args:
        window: side of the picture in pixels, a multiple of 16.
        width: number of channels of the finest convolutions; the coarsest convolutions have four times as many.
        shading: maximum relative change of a colour's lightness by shading, 0 (none) to 1.
        precision: precision of the network while painting; the framework applies it.
        checkpoint: path of a .safetensors file written by task=train; null = random weights, for training.
    """

    def __init__(
        self,
        *,
        window: Annotated[int, multiple_of(16)] = 64,  # other values are refused with the nearest valid one
        width: Annotated[int, between(1, 1024)] = 32,
        shading: Annotated[float, between(0, 1)] = 0.5,
        precision: Annotated[str, one_of(*PRECISIONS)] = "float32",
        checkpoint: str | None = None,
    ) -> None:
        super().__init__()
        self.window = window  # the contract: draw() returns pictures of this side
        self.shading = shading
        self.precision = precision
        self.side = window // 16  # side in pixels of the picture that the dense layers make
        self.dense = nn.Sequential(
            nn.Linear(7, 256), nn.GELU(), nn.Linear(256, 256), nn.GELU(), nn.Linear(256, 4 * width * self.side**2)
        )
        # Channels are halved when the side is doubled, which limits the number of operations.
        channels = [4 * width, 4 * width, 2 * width, width]
        self.steps = nn.ModuleList(
            nn.Sequential(
                nn.Upsample(scale_factor=2),
                nn.Conv2d(before, after, 3, padding=1),
                nn.GELU(),
                nn.Conv2d(after, after, 3, padding=1),
                nn.GELU(),
            )
            for before, after in pairwise(channels)
        )
        # pixel_shuffle turns these 2 * 4 channels into 2 planes with twice the side.
        self.last = nn.Conv2d(width, 8, 3, padding=1)
        with torch.no_grad():
            self.last.weight.mul_(0.1)
            self.last.bias[:4] = -3.0  # most of a window is empty
        self.restore(checkpoint, window=window, width=width, shading=shading)

    def draw(self, parameters: Tensor) -> Tensor:
        shape, color = parameters.split([7, 3], dim=1)  # in the order of strokes.prior.parameters_of
        x = functional.gelu(self.dense(shape)).reshape(len(shape), -1, self.side, self.side)
        for step in self.steps:
            x = step(x)
        alpha, light = functional.pixel_shuffle(self.last(x), 2).to(parameters.dtype).split(1, dim=1)  # (n, 1, S, S)
        plain = 0.5 * (color[:, :, None, None] + 1)  # [-1, 1] -> [0, 1]
        shaded = plain * (1 + self.shading * light.tanh())
        return torch.cat([shaded.clamp(0, 1), alpha.sigmoid()], dim=1)
