"""Break the colours of finished strokes, as a painter does who mixes each anew."""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import torch

from brushexp.bounds import at_least, between
from brushexp.pictures.color import to_lab, to_rgb
from brushexp.pictures.structure import sampled_at
from brushexp.plugins.density.base import DensificationState, DensificationUpdate, Density
from brushexp.registry import register
from brushexp.strokes.bezier import half_width_of

BROAD = 0.6  # quantile of widths from which on strokes are moved by all of it
FINEST = 0.25  # least share by which finer ones are moved
DIM, DARKEST = 50.0, 0.3  # L* below which colours are moved less, and the share by which black is


@register("density", "broken")
@dataclass(kw_only=True)
class Broken(Density):
    """Move the colour of each stroke at random, after the last step, so that no two beside each other are the same.

    Strokes lie in the order of the catalogue then, as with ``order=fixed`` before. Fine strokes, dark ones, and those
    where one looks first are moved less. A run that is ended before its last step keeps its colours.

    Args:
        lightness: the largest shift of L* (CIELAB).
        chroma: the largest length of the shift in a* and b*, whose direction is drawn at random.
        seed: of what is drawn.
    """

    lightness: Annotated[float, at_least(0)] = 6.0
    chroma: Annotated[float, at_least(0)] = 14.0
    seed: Annotated[int, between(0, 2**31 - 1)] = 0

    def due(self, step: int, steps: int) -> bool:
        return step >= steps

    def revise(self, state: DensificationState) -> DensificationUpdate:
        strokes = state.strokes
        width = half_width_of(strokes).double().cpu().numpy()
        lab = to_lab(strokes.color.double().cpu().numpy())
        share = (width / np.quantile(width, BROAD)).clip(FINEST, 1) * (lab[:, 0] / DIM).clip(DARKEST, 1)
        if state.focus is not None:
            weight = sampled_at(state.focus.double().cpu().numpy(), *strokes.position.double().cpu().numpy().T)
            share *= weight.clip(1) ** -0.5
        random = np.random.default_rng(self.seed)
        light, far = share * random.uniform(-1, 1, (2, len(lab)))
        way = random.uniform(0, 2 * math.pi, len(lab))
        shift = [self.lightness * light, self.chroma * far * np.cos(way), self.chroma * far * np.sin(way)]
        color = torch.from_numpy(to_rgb(lab + np.stack(shift, 1))).to(strokes.color)
        keep = torch.zeros(len(strokes), dtype=torch.bool, device=color.device)
        return DensificationUpdate(keep, replace(strokes, color=color))
