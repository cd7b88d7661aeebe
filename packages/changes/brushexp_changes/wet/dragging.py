"""Drag wet paint: a stroke picks up the paint under its start, and carries it along until the paint runs out."""

from dataclasses import replace

import torch
from torch import Tensor

from brushexp.contracts.families import PaintingState
from brushexp.contracts.kernels import TILE
from brushexp.contracts.layers import Layers, cuts, padded_lists
from brushexp.contracts.members import over
from brushexp.contracts.strokes import Strokes, curve_of, drift_of, truncate

REACHES = (0.9, 0.65, 0.4, 0.2)  # share of the curve over which each film of paint is carried, bottom to top
MAX_SHARE = 0.8  # share of picked-up paint at the start of a stroke if ``amount`` is 1
FILM_WIDTH = 0.9  # width of a film, in widths of the stroke
MIN_DIFFERENCE = 0.02  # colour difference, in any channel, above which a stroke carries paint along
MIN_COVERAGE = 0.1  # minimum coverage under the start of a stroke that picks up paint; a bare canvas is dry
STARTS = 1024  # starts sampled at once, to limit memory


@torch.no_grad()
def drag_paint(strokes: Strokes, front_to_back: Tensor, state: PaintingState, amount: float) -> tuple[Strokes, Tensor]:
    """Drag paint along N strokes of a painting; return the strokes and their order, front to back.

    ``amount``, 0 to 1, is the fraction of the underlying colour that a stroke drags along.

    The dragged paint is added on top of the stroke as thin films in the colour found under the stroke's start. Films
    are copies of the stroke that begin at its start, each shorter than the film below. They are appended to the N
    strokes, which keep their indices.
    """
    if not amount or not len(strokes):
        return strokes, front_to_back
    picked, covered = sample_under_starts(strokes, front_to_back, state)
    is_new = (picked - strokes.color + drift_of(strokes)).abs().amax(1) > MIN_DIFFERENCE
    dragging = (is_new & (covered > MIN_COVERAGE)).nonzero()[:, 0]
    share = 1 - (1 - MAX_SHARE * amount) ** (1 / len(REACHES))
    parts, height = [strokes], [(len(strokes) - front_to_back.argsort()) * (len(REACHES) + 1)]
    for k, reach in enumerate(REACHES, start=1):
        film = truncate(strokes[dragging], torch.full_like(strokes.width[dragging], reach))
        opacity, width = share * covered[dragging] * film.opacity, FILM_WIDTH * film.width
        numbers = {"color": picked[dragging], "drift": torch.zeros_like(film.drift), "opacity": opacity}
        parts.append(state.renderer.clamp(replace(film, width=width, **numbers)))
        height.append(height[0][dragging] + k)
    brush = torch.cat([part.brush for part in parts])  # a film has the same bristles as its stroke
    return replace(Strokes.join(*parts), brush=brush), torch.cat(height).argsort(descending=True)


@torch.no_grad()
def sample_under_starts(strokes: Strokes, front_to_back: Tensor, state: PaintingState) -> tuple[Tensor, Tensor]:
    """Sample the colour (N, 3) and coverage (N,) of the paint under the start of each stroke."""
    place, colors, covered = front_to_back.argsort(), strokes.color.clone(), torch.zeros_like(strokes.opacity)
    space = state.blend.space
    for top, rows, number in cuts(strokes, state.size, state.renderer):
        part, size = strokes[number].moved(shift=(0, -top)), (rows, state.size[1])
        layers = state.renderer(part)
        layers = layers if space.is_rgb else layers.encoded(space.encode)
        start = curve_of(part)[:, 0]
        inside = ((start >= 0) & (start < start.new_tensor([size[1], size[0]]))).all(1).nonzero()[:, 0]
        if not len(inside):
            continue
        order = place[number].argsort()
        rank = order.argsort()
        lists, _ = padded_lists(layers, order, size)
        column, row = (start[inside] // TILE).long().unbind(1)
        chunks = zip(inside.split(STARTS), (row * -(-size[1] // TILE) + column).split(STARTS), strict=True)
        parts = [_below(layers, lists[of], rank, some, start[some]) for some, of in chunks]
        color, covered[number[inside]] = (torch.cat(part) for part in zip(*parts, strict=True))
        color = color if space.is_rgb else space.decode(color.T[:, :, None])[:, :, 0].T
        colors[number[inside]] = color.clamp(0, 1)
    return colors, covered


def _below(layers: Layers, index: Tensor, rank: Tensor, number: Tensor, point: Tensor) -> tuple[Tensor, Tensor]:
    """Sample colour (n, C) and coverage (n,) at points (n, 2), below the strokes with indices ``number`` (n,).

    ``index`` (n, K) lists the strokes near each point, and ``rank`` contains their ranks from front to back.
    """
    alpha, color = layers.sample(index.clamp_min(0), point[:, None])  # (n, K, 1), (n, K, 1, C)
    below = (index >= 0) & (rank[index.clamp_min(0)] > rank[number][:, None])
    paint, light = over(alpha * below[..., None], color)
    covered = 1 - light
    return paint[:, 0] / covered.clamp_min(1e-6), covered[:, 0]
