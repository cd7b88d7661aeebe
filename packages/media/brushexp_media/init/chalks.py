"""Place strokes as in pastels: rubbed-in masses, with hatching, small forms and accents on top."""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import above, between, register
from brushexp.contracts.families import Initializer
from brushexp.contracts.members import InLayers
from brushexp.contracts.pictures import sample_at, structure_tensor
from brushexp.contracts.strokes import Strokes
from brushexp_media.init.accents import accents
from brushexp_media.init.hatching import ANGLES, forms, hatching, rows_drawn
from brushexp_media.init.ink import strokes_of
from brushexp_media.marks import RUBBED, VARIANTS
from brushexp_media.picture.noise import noise_of

Array = np.ndarray
BLUR = 0.004  # standard deviation of the blur under hatching, in longer sides
EDGE_SLOPE = 3.0  # slope of colour, per longer side, at which hatching ends
PATCH, LEFT = 0.13, -0.8  # longer sides between rubbed areas; deviations below which there is no hatching
FOLLOWED = 0.6  # turn from the slant of the hand towards the direction of forms; 1 = all the way
SWAY = 0.14  # radians by which groups of lines are rotated
GROUP = 0.12  # longer sides between groups
BROKEN, PRESSED = 0.065, 0.25  # standard deviations of the lightness of hatching, and of the logarithm of line widths
FOCUSED = 0.5  # reduction of hatching in areas of attention
LINE_SPACING = 1.5  # distance between hatching lines in line widths
SHORTER = 0.6  # length of strokes in a face drawn separately, relative to others
EDGED, LIGHTS = 0.7, 0.2  # width of an accent relative to hatching; share of accents that are light
DEEPER, LIGHTER = 0.35, 0.6  # shift of dark accents towards black, and of light ones towards white


@register("init", "chalks")
@dataclass(kw_only=True)
class Chalks(Initializer):
    """Broad rubbed-in masses, hatching at the natural slant of a hand, small forms, and accents along edges.

    Hatching leaves some rubbed areas uncovered, ends at colour edges, and turns halfway towards the direction of forms.
    The strokes are in the order given above, which ``order=fixed`` preserves. With ``renderer.kind=chalk``, masses have
    the soft mark of rubbed-in chalk, and all other strokes have the grain of chalk.

    Args:
        layers: number of layers of masses and forms, from the side of the stick to its edge.
        ratio: stroke size in a layer, relative to the layer below.
        cover: canvas area that a layer covers, as a fraction of the area that the layer below covers.
        width: stroke width, in the layer's mean stroke spacing.
        length: stroke length, in the layer's mean stroke spacing.
        edges: colour difference from the picture at which a stroke ends, 0 to 1.
        calm: weight of a nearly horizontal direction, relative to the picture's mean structure.
        hatched: fraction of the strokes that are hatching lines, 0 to 1.
        accents: fraction of the strokes that are accents, 0 to 1.
        thickness: thickness of hatching lines, in the mean spacing of all strokes; accents are thinner.
        reach: length of hatching lines, relative to their thickness.
    """

    layers: Annotated[int, between(1, 8)] = 4
    ratio: Annotated[float, between(0.2, 1)] = 0.5
    cover: Annotated[float, above(0, 1)] = 0.6
    width: Annotated[float, above(0, 10)] = 0.6
    length: Annotated[float, above(0, 10)] = 3.5
    edges: Annotated[float, above(0, 1)] = 0.1
    calm: Annotated[float, between(0, 100)] = 0.02
    hatched: Annotated[float, between(0, 1)] = 0.36
    accents: Annotated[float, between(0, 1)] = 0.02
    thickness: Annotated[float, above(0, 10)] = 0.6
    reach: Annotated[float, above(0, 100)] = 9.0

    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        random = np.random.default_rng(int(torch.randint(2**31, (1,), generator=generator)))
        hatched = min(n - 1, round(n * self.hatched))
        last = min(n - 1 - hatched, round(n * self.accents))
        layers = InLayers(
            layers=self.layers, ratio=self.ratio, cover=self.cover, width=self.width, length=self.length,
            edges=self.edges, calm=self.calm, underpainting=self.layers > 1, opacity=1.0,
        )(target, n - hatched - last, generator, focus)  # fmt: skip
        picture = target.numpy().astype(np.float64)
        weight = None if focus is None else focus.numpy().astype(np.float64)
        thick = self.thickness * math.sqrt(picture[0].size / n)
        size = layers.width * layers.scale
        fine = size < 1.01 * size.min()
        strokes = Strokes.join(
            layers[~fine],
            self._hatchings(picture, weight, hatched, thick, random),
            layers[fine],
            self._accents(picture, weight, last, thick),
        )
        number = torch.arange(n)
        rubbed = number < int((~fine).sum())
        sides = torch.where(rubbed, VARIANTS - RUBBED + number % RUBBED, number % (VARIANTS - RUBBED))
        return replace(strokes, brush=sides + VARIANTS * (number // VARIANTS % 2))

    def nearer(self) -> "Chalks":
        return replace(self, layers=1, hatched=0.0, length=SHORTER * self.length)  # over existing masses

    def _hatchings(
        self, picture: Array, weight: Array | None, n: int, thick: float, random: np.random.Generator
    ) -> Strokes:
        from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

        side = max(picture.shape)
        blurred = np.stack([gaussian_filter(plane, BLUR * side) for plane in picture])
        xx, _, yy = structure_tensor(blurred, 0.0)
        free = 1 - np.sqrt(xx + yy) * side / EDGE_SLOPE
        free *= noise_of(free.shape, PATCH, random) > LEFT
        if weight is not None:
            free *= 1 - FOCUSED * weight / weight.max()
        turned = FOLLOWED * forms(picture) + SWAY * noise_of(free.shape, GROUP, random)
        length = self.reach * thick
        gap = max(LINE_SPACING * thick, rows_drawn(free, 0.0) / max(n, 1) / (0.7 * length))
        curve = hatching(free, 0.0, ANGLES[0], turned, gap, length, random)
        curve = curve[np.sort(random.permutation(len(curve))[:n])]
        color = sample_at(blurred, *curve.mean(1).T).T + random.normal(0, BROKEN, (len(curve), 1))
        width = thick * random.lognormal(0, PRESSED, len(curve))
        return strokes_of(curve, width, np.ones(len(curve), bool), color, n)

    def _accents(self, picture: Array, weight: Array | None, n: int, thick: float) -> Strokes:
        """Draw accents along edges, visible only where the focus is at least average, so that other edges stay soft."""
        lights = round(LIGHTS * n)
        length, width = self.reach * thick, EDGED * thick
        drawn = Strokes.join(
            accents(picture, n - lights, length, width, None, dark=True, toward=np.zeros(3), share=DEEPER),
            accents(picture, lights, length, width, None, dark=False, toward=np.ones(3), share=LIGHTER),
        )
        if weight is None:
            return drawn
        seen = sample_at(weight, *drawn.position.double().numpy().T) >= 1
        return replace(drawn, opacity=drawn.opacity * torch.from_numpy(seen))
