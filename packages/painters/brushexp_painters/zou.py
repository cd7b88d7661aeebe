"""The ``zou`` painter: add strokes one by one, and optimise them, in increasingly fine blocks of the canvas."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import torch
from torch import Tensor
from torch.optim import Optimizer, RMSprop

from brushexp.contracts import above, at_least, between, build_named, register
from brushexp.contracts.families import PaintedView, Painter, PaintRequest, PaintState
from brushexp.contracts.pictures import sample_at
from brushexp.contracts.strokes import Catalogue, Strokes
from brushexp_painters._laying import numpy_generator, strokes_from_arrays, vectors

STROKES_PER_BLOCK = 10  # approximate number of strokes per block, unless ``levels`` is set
INSIDE = 0.9  # share of a block, measured from each side, in which a stroke's middle may lie
BLUR = 1 / 16  # standard deviation, in blocks, by which the error map is blurred before sampling
WIDTHS = (0.02, 0.6)  # range of stroke widths, in blocks
INITIAL_SIZES = (0.1, 0.25)  # range of initial lengths and thicknesses, in blocks
SHARPNESS = 4  # probability of a place is proportional to this power of the error
UNITS = {"position": 1.0, "start": 1.0, "control": 1.0, "end": 1.0, "width": 0.3, "color": 1.0, "opacity": 0.5}


@register("painter", "zou")
@dataclass(kw_only=True)
class ProgressiveBlocks(Painter):
    """Strokes added one by one in each of 1, then 4, 9, ... blocks of the canvas, and optimised by gradient descent.

    Source: Zou et al., 2021 (Stylized Neural Painting, arXiv:2011.08114). A new stroke is placed where the error is
    large, in the picture's colour and a random direction, with a tenth to a quarter of the block's size. After each
    addition, centred RMSprop optimises all strokes of the level for the L1 difference and a transport loss; earlier
    levels are below and stay fixed.

    Unlike in the paper, ``renderer`` draws the strokes instead of the paper's networks. All blocks of a level share one
    canvas, so that strokes may extend beyond their block, and the transport loss (`loss.sinkhorn`, debiased) covers the
    whole canvas. There are fewer iterations at a higher rate. For style transfer, use `style=` with
    ``painter=gradient``.

    Args:
        levels: number of levels; null = chosen so that a block has about ten strokes.
        iterations: number of iterations per level, divided among the strokes added.
        lr: learning rate of RMSprop, in half-blocks.
        transport: weight of the transport loss relative to the L1 difference; 0 omits it.
    """

    kind = "gradients, stroke by stroke"
    author = "Zou et al."
    differentiates = True

    levels: Annotated[int | None, between(1, 1000, typical=4)] = None
    iterations: Annotated[int, at_least(1)] = 60
    lr: Annotated[float, above(0, 10)] = 0.01
    transport: Annotated[float, at_least(0)] = 0.1

    def __post_init__(self) -> None:
        self._sinkhorn = build_named("loss", "sinkhorn", {})

    def __call__(self, request: PaintRequest) -> Iterator[PaintState]:
        random, strokes = numpy_generator(request.generator), Strokes.none(request.target)
        levels = self.levels or max(1, round((3 * request.n / STROKES_PER_BLOCK) ** (1 / 3)))
        while levels > 1 and sum(m * m for m in range(1, levels + 1)) > request.n:
            levels -= 1
        each = request.n // sum(m * m for m in range(1, levels + 1))
        for m in range(1, levels + 1):
            level = Catalogue(initial_strokes(request, strokes, m, random), UNITS)
            optimizer = RMSprop(level.parameters(), lr=self.lr, centered=True)
            for turn in range(each):
                if turn:
                    new = initial_strokes(request, Strokes.join(strokes, detach(level)), m, random)
                    level.revise(torch.ones(len(level), dtype=torch.bool, device=new.width.device), new, optimizer)
                self._optimize(request, strokes, level, optimizer, m, max(1, self.iterations // each))
                yield PaintState(Strokes.join(strokes, detach(level)), (m - 1) * each + turn + 1, levels * each)
            strokes = Strokes.join(strokes, detach(level))

    def _optimize(
        self, request: PaintRequest, below: Strokes, level: Catalogue, optimizer: Optimizer, m: int, steps: int
    ) -> None:
        """Optimise the strokes of a level with m x m blocks, on top of the strokes in ``below``."""
        size = level.scale.new_tensor(request.size[::-1])
        middle = ((level().position.detach() * m / size).floor().clamp(0, m - 1) + 0.5) * size / m
        reach = (INSIDE - 0.5) * size / m
        for _ in range(steps):
            optimizer.zero_grad()
            strokes = Strokes.join(below, level())
            image = request.draw(strokes)
            loss = (image - request.target).abs().mean()
            if self.transport:
                loss = loss + self.transport * self._sinkhorn(PaintedView(image, request.target, strokes))
            loss.backward()
            optimizer.step()
            level.keep_in_range()
            moved = detach(level)
            position = torch.maximum(torch.minimum(moved.position, middle + reach), middle - reach)
            level.replace(replace(moved, position=position, width=moved.width.clamp(*WIDTHS)))


def detach(catalogue: Catalogue) -> Strokes:
    """Return a catalogue's strokes, detached from the graph."""
    return catalogue().map(Tensor.detach)


def initial_strokes(request: PaintRequest, strokes: Strokes, m: int, random: np.random.Generator) -> Strokes:
    """Make a stroke in each of m x m blocks, at a position sampled according to the error in the painting so far."""
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (--help does not need it)

    height, width = request.size
    error = (request.draw(strokes.map(Tensor.detach)) - request.target).abs().sum(0).double().cpu().numpy()
    smooth = gaussian_filter(error, BLUR * max(height, width) / m) ** SHARPNESS
    places = []
    for row in range(m):
        for column in range(m):
            (top, bottom), (left, right) = block_span(row, m, height), block_span(column, m, width)
            block = smooth[top:bottom, left:right].ravel() + 1e-12
            y, x = divmod(int(random.choice(block.size, p=block / block.sum())), right - left)
            places.append((left + x + 0.5, top + y + 0.5))
    middle = np.array(places)
    block = max(height, width) / m
    angle, length, thickness = random.uniform(0, np.pi, m * m), *(block * random.uniform(*INITIAL_SIZES, (2, m * m)))
    along = vectors(0.5 * length, angle)
    curves = np.stack([middle - along, middle, middle + along], 1)
    color = sample_at(request.target.cpu().numpy(), *middle.T).T
    new = with_windows(strokes_from_arrays(curves, thickness, color, 0.95), block)
    return new.map(lambda value: value.to(request.target))


def block_span(number: int, m: int, side: int) -> tuple[int, int]:
    """Return the half-open pixel range of a block without its outer tenths; it contains at least one pixel."""
    first, last = (number + 1 - INSIDE) * side / m, (number + INSIDE) * side / m
    first = min(int(first), side - 1)
    return first, max(int(last), first + 1)


def with_windows(strokes: Strokes, side: float) -> Strokes:
    """Express strokes relative to windows of ``side`` pixels, so that learning rates are equal within a level."""
    share = strokes.scale / side
    points = {name: getattr(strokes, name) * share[:, None] for name in ("start", "control", "end")}
    return replace(strokes, scale=torch.full_like(strokes.scale, side), width=strokes.width * share, **points)
