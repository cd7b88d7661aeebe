"""Limit a palette to the colours that can be mixed from given paints."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import Rule, register
from brushexp.contracts.families import Palette
from brushexp.contracts.pictures import to_lab
from brushexp_changes.tubes.mixtures import Mixtures, all_mixtures, map_tones
from brushexp_changes.tubes.paints import load_tubes

Array = np.ndarray
NODES = 25  # lattice points per channel, between which colours are interpolated
NEAREST = 8  # mixtures averaged at each lattice point, weighted by nearness
SOFT = 2.0  # CIELAB units added to distances, so that no single mixture dominates


@register("palette", "pigments")
@dataclass(kw_only=True, eq=False)
class OfPigments(Palette):
    """Limits a palette to the colours that mixtures of named paints can produce; the number of colours is not limited.

    Tones are mapped to the range between the darkest and the lightest grey of the paints, and each colour is moved to
    the nearest mixtures in CIELAB.

    Args:
        tubes: set of tubes: eight, acrylics, primaries, zorn, or a CSV file.
    """

    tubes: Annotated[str, Rule(load_tubes)] = "zorn"

    def __call__(self, picture: Tensor) -> Tensor:
        from scipy.ndimage import map_coordinates  # noqa: PLC0415  (slow to import)

        places = map_tones(picture, self._mixtures).double().numpy() * (NODES - 1)
        channels = [map_coordinates(table, places, order=1, mode="nearest") for table in self._table]
        return torch.from_numpy(np.stack(channels)).to(picture)

    @cached_property
    def _mixtures(self) -> Mixtures:
        return all_mixtures(load_tubes(self.tubes))

    @cached_property
    def _table(self) -> Array:
        """Lookup table (3, `NODES`, `NODES`, `NODES`) that maps sRGB colours to the colours of mixtures."""
        from scipy.spatial import KDTree  # noqa: PLC0415  (slow to import)

        mixtures, side = self._mixtures.color.double().numpy(), np.linspace(0, 1, NODES)
        nodes = np.stack(np.meshgrid(side, side, side, indexing="ij"), -1).reshape(-1, 3)
        away, which = KDTree(to_lab(mixtures)).query(to_lab(nodes), [*range(1, min(NEAREST, len(mixtures)) + 1)])
        weight = 1 / (SOFT + away) ** 2
        colors = (weight[..., None] * mixtures[which]).sum(1) / weight.sum(1)[:, None]
        return colors.T.reshape(3, NODES, NODES, NODES)
