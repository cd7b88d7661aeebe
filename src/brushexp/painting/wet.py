"""Wet paint: a stroke picks up what lies under its start, and carries it along until it is spent."""

from dataclasses import replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from brushexp.compositing.bands import cuts
from brushexp.compositing.eager import padded_lists
from brushexp.compositing.layers import Layers
from brushexp.compositing.tile_lists import TILE
from brushexp.painting.picture import Picture
from brushexp.plugins.blend.dense import over
from brushexp.strokes.bezier import curve_of, unfinished
from brushexp.strokes.catalogue import Strokes

if TYPE_CHECKING:
    from brushexp.painting.painting_module import PaintingModule

REACHES = (0.9, 0.65, 0.4, 0.2)  # of the curve: how far each film of what was picked up is carried, the lowest first
MOST = 0.8  # share of picked-up paint at the start of a stroke with wet=1
NARROWER = 0.9  # width of these films, in widths of the stroke
ALIKE = 0.02  # a difference of colour, in every channel, that is not worth a film
LEAST = 0.1  # of the canvas that has to be covered under a start; a bare canvas is dry
STARTS = 1024  # that are looked at together


@torch.no_grad()
def wetted(painter: "PaintingModule", wet: float) -> tuple[Strokes, Tensor]:
    """The strokes of a painting, and which lies on which (front to back), after paint has been dragged along.

    A stroke has one colour. What it drags lies on it as thin films, strokes like itself from its start on, each shorter
    than the one below, in the colour that lies under its start: so the colours mix along the stroke, in the colour
    space of the painting, and every renderer and exporter knows how. Films come after the N strokes, which keep their
    numbers. What lies under a start is taken as it was before anything was dragged.
    """
    strokes, front_to_back = painter.strokes(), painter.depth.front_to_back
    if not wet or not len(strokes):
        return strokes, front_to_back
    picked, covered = under_starts(strokes, front_to_back, painter.picture)
    dragging = (((picked - strokes.color).abs().amax(1) > ALIKE) & (covered > LEAST)).nonzero()[:, 0]
    share = 1 - (1 - MOST * wet) ** (1 / len(REACHES))
    found, height = [strokes], [torch.empty_like(front_to_back)]
    height[0][front_to_back] = torch.arange(len(strokes), 0, -1, device=front_to_back.device) * (len(REACHES) + 1)
    for k, reach in enumerate(REACHES, start=1):
        film = unfinished(strokes[dragging], torch.full_like(strokes.width[dragging], reach))
        opacity, width = share * covered[dragging] * film.opacity, NARROWER * film.width
        found.append(painter.renderer.clamp(replace(film, color=picked[dragging], opacity=opacity, width=width)))
        height.append(height[0][dragging] + k)
    brush = torch.cat([part.brush for part in found])  # a film has the bristles of its stroke
    return replace(Strokes.join(*found), brush=brush), torch.cat(height).argsort(descending=True)


@torch.no_grad()
def under_starts(strokes: Strokes, front_to_back: Tensor, picture: Picture) -> tuple[Tensor, Tensor]:
    """Colour (N, 3) of the paint that lies under the start of each stroke, and how far (N,) it covers the canvas."""
    place, colors, covered = front_to_back.argsort(), strokes.color.clone(), torch.zeros_like(strokes.opacity)
    space = picture.blend.space
    for top, rows, number in cuts(strokes, picture.size, picture.renderer):
        part, size = strokes[number].moved(shift=(0, -top)), (rows, picture.size[1])
        layers = picture.renderer(part)
        layers = layers if space.is_rgb else layers.encoded(space.encode)
        start = curve_of(part)[:, 0]
        inside = ((start >= 0) & (start < start.new_tensor([size[1], size[0]]))).all(1).nonzero()[:, 0]
        if not len(inside):
            continue
        order = place[number].argsort()
        rank = order.argsort()
        lists, _ = padded_lists(layers, order, size)
        tile = (start[inside] // TILE).long()
        tile = tile[:, 1] * -(-size[1] // TILE) + tile[:, 0]
        chunks = zip(inside.split(STARTS), tile.split(STARTS), strict=True)
        parts = [_below(layers, lists[of], rank, some, start[some]) for some, of in chunks]
        found, covered[number[inside]] = (torch.cat(part) for part in zip(*parts, strict=True))
        shown = found if space.is_rgb else space.decode(found.T[:, :, None])[:, :, 0].T
        colors[number[inside]] = shown.clamp(0, 1)
    return colors, covered


def _below(layers: Layers, index: Tensor, rank: Tensor, number: Tensor, point: Tensor) -> tuple[Tensor, Tensor]:
    """Colour (n, C) and coverage (n,) at points (n, 2) of what in lists (n, K) lies below strokes ``number`` (n,)."""
    alpha, color = layers.sample(index.clamp_min(0), point[:, None])  # (n, K, 1), (n, K, 1, C)
    below = (index >= 0) & (rank[index.clamp_min(0)] > rank[number][:, None])
    painted, light = over(alpha * below[..., None], color)
    covered = 1 - light
    return painted[:, 0] / covered.clamp_min(1e-6), covered[:, 0]
