"""The ``haeberli`` painter: straight strokes at random positions."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch

from brushexp.contracts import above, between, one_of, register
from brushexp.contracts.families import Painter, PaintRequest, PaintState
from brushexp.contracts.pictures import along_edges, sample_at, structure_tensor
from brushexp_painters._laying import lay, numpy_generator, strokes_from_arrays, vectors


@register("painter", "haeberli")
@dataclass(kw_only=True)
class Haeberli(Painter):
    """Straight strokes at random positions, along the picture's edges and in its colours, from large to small.

    Source: Haeberli, 1990 (Paint by Numbers: Abstract Image Representations). A stroke takes its colour from the
    picture, and its direction is normal to the picture's gradient.

    Unlike in the paper, positions and sizes are not chosen by a person: positions are sampled, and the brush becomes
    finer from the first stroke to the last. Directions come from the structure tensor, in which gradients of opposite
    signs do not cancel. Haeberli's relaxation of a fixed set of strokes is not included.

    Args:
        places: distribution of the positions: jittered (a scrambled Sobol sequence, without clumps or holes) or random.
        largest: thickness of the first strokes, in stroke spacings.
        smallest: thickness of the last strokes, in stroke spacings.
        length: length of a stroke, in units of its thickness.
        stray: standard deviation of the angle between a stroke's direction and the picture's, in degrees.
        opacity: fraction of the paint below that a stroke hides, 0 to 1.
    """

    kind = "local rules"
    author = "Haeberli"

    places: Annotated[str, one_of("jittered", "random")] = "jittered"
    largest: Annotated[float, above(0, 1000)] = 3.0
    smallest: Annotated[float, above(0, 1000)] = 0.6
    length: Annotated[float, above(0, 1000)] = 4.0
    stray: Annotated[float, between(0, 180)] = 5.0
    opacity: Annotated[float, between(0, 1)] = 1.0

    def __call__(self, request: PaintRequest) -> Iterator[PaintState]:
        picture, n = request.target.cpu().numpy(), request.n
        random = numpy_generator(request.generator)
        if self.places == "random":
            share = random.random((n, 2))
        else:
            sobol = torch.quasirandom.SobolEngine(2, scramble=True, seed=int(random.integers(2**31)))
            share = sobol.draw(n).numpy()
        x, y = (share * request.size[::-1]).T
        thickness = request.pitch * np.geomspace(self.largest, self.smallest, n)
        tensor = structure_tensor(picture, max(0.5, request.pitch * self.smallest))
        angle = along_edges(sample_at(tensor, x, y)) + np.radians(self.stray) * random.standard_normal(n)
        along = vectors(0.5 * max(self.length - 1, 0) * thickness, angle)  # round ends add half a thickness each
        middle = np.stack([x, y], 1)
        curves = np.stack([middle - along, middle, middle + along], 1)
        yield from lay(strokes_from_arrays(curves, thickness, sample_at(picture, x, y).T, self.opacity))
