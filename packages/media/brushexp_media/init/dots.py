"""Place dots of divided colour, which are purer than the picture but match it on average."""

from dataclasses import dataclass, replace
from typing import Annotated

import torch
from torch import Tensor

from brushexp.contracts import above, between, register
from brushexp.contracts.families import Initializer
from brushexp.contracts.members import InLayers
from brushexp.contracts.pictures import to_lab, to_rgb
from brushexp.contracts.strokes import Strokes

CALMER = 0.5  # exponent of dot size in the separation of hues: small dots differ less
DIVISION_CHROMA = 100.0  # chroma by which dots of division 1 differ from the colour of the picture
WARM = torch.tensor([0.34, 0.94], dtype=torch.float64)  # direction of orange in a* and b*; that of blue is the opposite
SHADE = 55.0  # L* below which a place is in shadow
GREY = 4.0  # chroma of the pair of orange and blue in which greys are divided
BROAD, LONG, SHIFTED = 2.2, 1.2, 0.2  # width, length and random shift of undertouches, in their spacing
SHADOW = 56.0  # L* below which an undertouch is in shadow
WHITE = 87.0  # L* above which an undertouch keeps its colour
DULL, DUSK, MUTED, COOL = 0.92, 0.15, 0.75, 40.0  # of touches: lightness over the place's, less in shadow; chroma; blue
OPPOSITE, LIGHT = 0.18, 0.2  # shares of dots of the complementary hue in shadow, and of the colour of the light
RARE = 0.35  # share of complementary dots in light, relative to that in shadow
SHADED = 40.0, 70.0  # L* below which a place is fully in shadow, and above which it is fully in light
PURER = 0.46  # shift of purer and of complementary dots, relative to dots of the colour of the light
TURNED, UNEVEN = 0.3, 0.08  # standard deviation between dots: hue in radians, and L* relative to chroma


@register("init", "dots")
@dataclass(kw_only=True)
class Dots(Initializer):
    """Dabs of divided hues in layers, with larger dabs everywhere and smaller dabs where there is detail.

    Each dab has the picture's lightness at its position. Its colour is shifted by ``division``, mostly towards a purer
    colour, sometimes towards the colour of the light (orange in light, blue in shadow) or the complementary hue; greys
    become orange and blue. Source: Signac (1899), Chevreul (1839). The optimiser then makes the mean of the dabs match
    the picture (``loss=[blurred,chroma]``).

    Args:
        layers: number of layers of dabs, from large to small.
        ratio: dab size in a layer, relative to the layer below.
        cover: canvas area that a layer covers, as a fraction of the area that the layer below covers.
        width: dab width, in the layer's mean stroke spacing; below 1, the ground shows between dabs.
        length: dab length, in the layer's mean stroke spacing.
        jitter: standard deviation of a random shift of each dab, in the layer's mean stroke spacing.
        division: separation of the hues of the largest dabs, 0 to 1; smaller dabs, and dabs in the focus, differ less.
        under: fraction of the strokes that are broad touches below the dots.
    """

    layers: Annotated[int, between(1, 8)] = 2
    ratio: Annotated[float, between(0.2, 1)] = 0.7
    cover: Annotated[float, above(0, 1)] = 0.6
    width: Annotated[float, above(0, 10)] = 0.9
    length: Annotated[float, above(0, 10)] = 0.3
    jitter: Annotated[float, between(0, 2)] = 0.22
    division: Annotated[float, between(0, 1)] = 0.3
    under: Annotated[float, between(0, 1)] = 0.0

    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        layers = InLayers(
            layers=self.layers, ratio=self.ratio, cover=self.cover, width=self.width, length=self.length,
            opacity=1.0, jitter=self.jitter,
        )  # fmt: skip
        under = round(n * self.under)
        dots = self._divide_hues(layers(target, n - under, generator, focus), generator, focus)
        return Strokes.join(_undertouches(target, under, generator), dots) if under else dots

    def _divide_hues(self, strokes: Strokes, generator: torch.Generator, focus: Tensor | None) -> Strokes:
        """Separate the hues of strokes with hardly any change in lightness, so that no dot stands out as a speck."""
        n, lab = len(strokes), torch.from_numpy(to_lab(strokes.color.double().numpy()))
        kind, sign = torch.rand(2, n, 1, generator=generator, dtype=torch.float64)
        turn, light = torch.randn(2, n, generator=generator, dtype=torch.float64)
        hue = lab[:, 1:] + GREY * torch.where(sign < 0.5, -1, 1) * WARM
        angle = torch.atan2(hue[:, 1], hue[:, 0]) + TURNED * turn
        own = torch.stack([angle.cos(), angle.sin()], 1)
        of_light = torch.where(lab[:, :1] > SHADE, WARM, -WARM)
        of_light = of_light * (0.5 + 0.5 * (of_light * own).sum(1, keepdim=True))  # orange would make a blue sky grey
        lit = ((lab[:, :1] - SHADED[0]) / (SHADED[1] - SHADED[0])).clamp(0, 1)
        opposite = OPPOSITE * torch.lerp(torch.ones_like(lit), torch.full_like(lit, RARE), lit)
        by = torch.where(kind < opposite, -PURER * own, torch.where(kind < opposite + LIGHT, of_light, PURER * own))
        room = (1 - (lab[:, :1] / 50 - 1).abs()).clamp_min(0).sqrt()  # neither black nor white has a hue
        size = (strokes.width * strokes.scale).double()[:, None]
        room = room * (size / size.max()) ** CALMER
        if focus is not None:
            room = room * _at(focus, strokes)[:, None].clamp_min(1) ** -0.5
        lab[:, 1:] += DIVISION_CHROMA * self.division * room * by
        lab[:, 0] += DIVISION_CHROMA * self.division * UNEVEN * light
        return replace(strokes, color=torch.from_numpy(to_rgb(lab.numpy())).float())


def _undertouches(target: Tensor, n: int, generator: torch.Generator) -> Strokes:
    """Place broad touches, duller than the picture and cooler in shadow, that cover the ground below the dots."""
    strokes = InLayers(layers=1, width=BROAD, length=LONG, opacity=1.0, jitter=SHIFTED)(target, n, generator)
    lab = torch.from_numpy(to_lab(strokes.color.double().numpy()))
    shadow = (1 - lab[:, :1] / SHADOW).clamp(0, 1)
    below = lab[:, :1] < WHITE
    lab[:, :1] *= torch.where(below, DULL - DUSK * shadow, 1.0)
    lab[:, 1:] = torch.where(below, MUTED * lab[:, 1:] - COOL * shadow * WARM, lab[:, 1:])
    return replace(strokes, color=torch.from_numpy(to_rgb(lab.numpy())).float())


def _at(weights: Tensor, strokes: Strokes) -> Tensor:
    """Look up weights (H, W) at the positions of N strokes."""
    x, y = (part.long().clamp(0, side - 1) for part, side in zip(strokes.position.T, weights.shape[::-1], strict=True))
    return weights[y, x].double()
