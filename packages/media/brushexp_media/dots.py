"""Place dots of divided colour: each purer than the picture, and their mean the picture."""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import torch
from torch import Tensor

from brushexp.bounds import above, between
from brushexp.plugins.init.base import Initializer
from brushexp.plugins.init.layers import InLayers
from brushexp.registry import register
from brushexp.strokes.catalogue import Strokes

DARK = 0.45  # mean of RGB below which the ground is covered, the more the darker


@register("init", "dots")
@dataclass(kw_only=True)
class Dots(Initializer):
    """Dabs in layers, larger ones everywhere and smaller ones where there is detail, whose hues go apart.

    The colour of each is that of the picture, moved by ``division`` in a direction of hue drawn at random. Source:
    Signac (1899); the optimiser then makes their mean the picture (``loss=[blurred,chroma]``).

    Args:
        layers: of dabs, from large to small.
        ratio: size of the dabs of a layer over that of the layer below.
        cover: share of the canvas that a layer covers, of what the one below does.
        width: of a dab, in distances of its layer; below 1 ground shows between them.
        length: of a dab, in distances of its layer.
        jitter: random shift of a dab in distances of its layer, its deviation: more is less regular.
        variety: of sizes within a layer, the deviation of their logarithm.
        division: how far hues go apart, 0 to 1.
        under: share of the strokes that cover the ground below the dots where it is dark, 0 to 1.
    """

    layers: Annotated[int, between(1, 4)] = 2
    ratio: Annotated[float, between(0.2, 1)] = 0.7
    cover: Annotated[float, above(0, 1)] = 0.6
    width: Annotated[float, above(0, 10)] = 0.9
    length: Annotated[float, above(0, 10)] = 0.3
    jitter: Annotated[float, between(0, 2)] = 0.22
    variety: Annotated[float, between(0, 1)] = 0.0
    division: Annotated[float, between(0, 1)] = 0.3
    under: Annotated[float, between(0, 1)] = 0.0

    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        layers = InLayers(
            layers=self.layers, ratio=self.ratio, cover=self.cover, width=self.width, length=self.length,
            opacity=1.0, jitter=self.jitter,
        )  # fmt: skip
        under = round(n * self.under)
        return Strokes.join(
            *([_shadows(target, under, generator)] if under else []),
            self._divided(layers(target, n - under, generator, focus), generator),
        )

    def _divided(self, strokes: Strokes, generator: torch.Generator) -> Strokes:
        angle = 2 * math.pi * torch.rand(len(strokes), generator=generator)
        thirds = angle[:, None] + torch.arange(3) * (2 * math.pi / 3)
        room = 1 - (2 * strokes.color.mean(1, keepdim=True) - 1).abs()  # neither black nor white has a hue
        color = (strokes.color + self.division * room.sqrt() * thirds.cos()).clamp(0, 1)
        if not self.variety:
            return replace(strokes, color=color)
        larger = (self.variety * torch.randn(len(strokes), generator=generator)).exp()
        sizes = {name: getattr(strokes, name) * larger[:, None] for name in ("start", "control", "end")}
        return replace(strokes, color=color, width=strokes.width * larger, **sizes)


def _shadows(target: Tensor, n: int, generator: torch.Generator) -> Strokes:
    """Lay n broad strokes that hide the ground where a picture (3, H, W) is dark, and leave it elsewhere."""
    strokes = InLayers(layers=1, underpainting=True, opacity=1.0)(target, n, generator)
    return replace(strokes, opacity=(1.5 * (1 - strokes.color.mean(1) / DARK)).clamp(0, 1))
