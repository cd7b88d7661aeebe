"""Place strokes in layers, as painters do: large ones everywhere, smaller ones in detailed areas."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import numpy as np
import torch
from torch import Tensor, nn

from brushexp.bounds import Rule, above, at_least, between
from brushexp.pictures.load import named_color
from brushexp.pictures.structure import FarStructure, along_edges, sample_at
from brushexp.plugins.init.base import Initializer
from brushexp.plugins.init.grid import lattice
from brushexp.registry import register
from brushexp.strokes.bezier import roomy_window, strokes_along
from brushexp.strokes.catalogue import Strokes

Array = np.ndarray
BLUR = 0.35  # standard deviation of the blur of a layer's picture, in pitches of the layer
SUBSTEPS = 4  # points of a stroke on each side of its middle
FAR_AWAY = ((1, 1.0), (4, 0.05), (16, 0.01))  # pairs of the range of structure, in pitches, and its weight
UNDER = 1.5  # width of the strokes of an underpainting, relative to the other strokes
DIM = 0.1  # brightness below which darkness no longer amplifies a difference, 0 to 1
SHORTEST_STROKE = 0.5  # shortest length of a stroke that ends at an edge, relative to its full length
FEWER, SHORTER = 2, 0.6  # reduction of the number of layers in a face, and factor on the length of its strokes
SWELLS, SWING = 4, 0.26  # pitches between turns of the calm direction; its deviation from the horizontal, radians


@register("init", "layers")
@dataclass(kw_only=True)
class InLayers(Initializer):
    """Places layers of strokes that follow the form, from large to small; each adds detail that the layer below lacks.

    Source: Hertzmann (1998). Each layer follows the picture blurred in proportion to the layer's brush size, and covers
    the areas where this blurred picture differs most from the layer below. Strokes bend along the direction of least
    change and end where the picture's colour differs from their own. Unlike in the source, the number of strokes is
    exact, strokes are quadratic curves, and nothing is painted between layers, because each layer is assumed to
    reproduce its blurred picture.

    Args:
        layers: number of layers, from large strokes to small ones.
        ratio: ratio of a layer's stroke size to that of the layer below, 0.2 to 1.
        cover: fraction of the area of the layer below that a layer covers; the rest keeps the larger strokes.
        length: stroke length, in the layer's mean stroke spacing.
        width: stroke width, in the layer's mean stroke spacing.
        calm: weight of a nearly horizontal direction, relative to the mean structure of the picture; it prevents
            strokes in a sky from circling distant objects.
        shadows: dependence of differences on brightness, from none (0) to Weber's law (1).
        edges: colour difference from the picture at which a stroke ends, 0 to 1; smaller values follow edges more
            closely.
        underpainting: whether the lowest layer hides the ground with broader strokes that do not stop at edges.
        opacity: stroke opacity, 0 to 1.
        color: colour of all strokes as '#rrggbb', for drawings in one ink; null = colours of the picture.
        jitter: standard deviation of a random shift of each stroke, in the layer's mean stroke spacing.
    """

    layers: Annotated[int, between(1, 8)] = 3
    ratio: Annotated[float, between(0.2, 1)] = 0.5
    cover: Annotated[float, above(0, 1)] = 0.5
    length: Annotated[float, above(0, 10)] = 2.5
    width: Annotated[float, above(0, 10)] = 0.9
    calm: Annotated[float, between(0, 100)] = 0.0
    shadows: Annotated[float, between(0, 1)] = 0.0
    edges: Annotated[float, above(0, 1)] = 0.15
    underpainting: bool = False
    opacity: Annotated[float, between(0, 1)] = 0.95
    color: Annotated[str | None, Rule(named_color)] = None
    jitter: Annotated[float, at_least(0)] = 0.15

    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        picture = target.numpy().astype(np.float64)
        weight = np.ones(picture.shape[1:]) if focus is None else focus.numpy().astype(np.float64)
        counts = self._counts(n)
        pitch = math.sqrt(weight.size / counts[0])
        structure, level = FarStructure(picture), _level(weight.shape, SWELLS * pitch, generator) if self.calm else 0
        parts: list[Strokes] = []
        below = np.broadcast_to(picture.mean((1, 2), keepdims=True), picture.shape)
        for number, count in enumerate(counts):
            if count:
                side = pitch * self.ratio**number
                blurred = _blur(picture, BLUR * side)
                detail = weight * np.abs(blurred - below).sum(0) / (DIM + blurred.mean(0)) ** self.shadows
                cells = min(weight.size, max(count, round(count / self.cover**number)))
                tensor = structure([(reach * side, share) for reach, share in FAR_AWAY])
                if self.calm:
                    tensor += self.calm * (tensor[0] + tensor[2]).mean() * level
                flow = along_edges(tensor)
                places = _places(detail, cells, count)
                places = places if parts else _spread_to_edges(places, side, picture.shape[:0:-1])
                layer = replace(self, edges=1.0, width=UNDER * self.width) if self.underpainting and not parts else self
                parts.append(layer._layer(blurred, flow, places, side, generator))
                below = blurred
        return Strokes.join(*parts)

    def nearer(self) -> "InLayers":
        return replace(self, layers=max(1, self.layers - FEWER), length=SHORTER * self.length, underpainting=False)

    def _counts(self, n: int) -> list[int]:
        shares = (self.cover / self.ratio**2) ** np.arange(self.layers)
        counts = np.floor(n * shares / shares.sum()).astype(int)
        counts[0] += n - counts.sum()
        return list(map(int, counts))

    def _layer(self, picture: Array, flow: Array, places: Array, side: float, generator: torch.Generator) -> Strokes:
        """Place strokes of one size at ``places`` (n, 2: x, y), in pixels, along a ``flow`` (H, W), in radians."""
        n, limit = len(places), np.array([picture.shape[2], picture.shape[1]]) - 0.5
        shift = torch.randn(n, 2, generator=generator, dtype=torch.float64).numpy()
        places = (places + self.jitter * side * shift).clip(0.5, limit)
        color = sample_at(picture, *places.T).T
        start, end = (self._trace(picture, flow, places, color, sign * 0.5 * self.length * side) for sign in (-1, 1))
        chord = (start + end) / 2
        middle = chord.clip(0.5, limit)
        window = max(roomy_window(side), 1.2 * self.length * side)
        ink = None if self.color is None else named_color(self.color, "init.color")
        # The curve passes through its place.
        offsets = np.stack([start, 2 * places - chord, end], 1) - middle[:, None]
        return strokes_along(
            torch.from_numpy(offsets.clip(-window / 2, window / 2)),
            min(window, self.width * side),
            torch.from_numpy(color).float() if ink is None else (torch.tensor(list(ink)) / 255).repeat(n, 1),
            self.opacity,
            window=window,
            position=torch.from_numpy(middle),
        ).map(Tensor.float)

    def _trace(self, picture: Array, flow: Array, places: Array, color: Array, reach: float) -> Array:
        """Trace a flow (H, W), in radians, from n places until the colour changes, and return the ends (n, 2).

        The largest distance, in pixels, is ``reach``; if this is negative, the flow is traced backwards.
        """
        point, step = places.copy(), abs(reach) / SUBSTEPS
        angle = sample_at(flow, *point.T)
        ahead = np.sign(reach) * np.stack([np.cos(angle), np.sin(angle)], 1)
        going = np.ones(len(places), bool)
        for number in range(1, SUBSTEPS + 1):
            following = point + step * ahead
            differs = np.abs(sample_at(picture, *following.T).T - color).max(1) > self.edges
            going &= ~differs | (number <= SHORTEST_STROKE * SUBSTEPS)
            point = np.where(going[:, None], following, point)
            angle = sample_at(flow, *point.T)
            turned = np.stack([np.cos(angle), np.sin(angle)], 1)
            turned *= np.where((turned * ahead).sum(1) < 0, -1, 1)[:, None]
            ahead = ahead + turned
            ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
        return point


def _level(size: Sequence[int], pitch: float, generator: torch.Generator) -> Array:
    """Sample structure tensors (3, H, W) of trace 1, whose nearly horizontal directions vary over ``pitch`` pixels."""
    knots = torch.randn(1, 1, *(math.ceil(side / pitch) + 1 for side in size), generator=generator, dtype=torch.float64)
    swing = SWING * nn.functional.interpolate(knots, tuple(size), mode="bicubic", align_corners=True)[0, 0].numpy()
    return np.stack([np.sin(swing) ** 2, -np.sin(swing) * np.cos(swing), np.cos(swing) ** 2])


def _places(detail: Array, cells: int, n: int) -> Array:
    """Divide a map (H, W) into cells, and return the centres (n, 2: x, y) of the n cells with the largest means."""
    flat = lattice(detail.shape[0], detail.shape[1], cells).ravel()
    area = np.bincount(flat, minlength=cells)
    best = np.sort(np.argsort(-np.bincount(flat, detail.ravel(), cells) / area, kind="stable")[:n])
    y, x = np.divmod(np.arange(detail.size), detail.shape[1])
    return np.stack([np.bincount(flat, axis + 0.5, cells) / area for axis in (x, y)], 1)[best]


def _spread_to_edges(places: Array, side: float, size: Sequence[int]) -> Array:
    """Stretch positions (n, 2: x, y) so that points half a ``side`` from the canvas edges move onto the edges."""
    middle = np.array(size) / 2
    return middle + (places - middle) * (middle / np.maximum(middle - side / 2, 1))


def _blur(picture: Array, sigma: float) -> Array:
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

    with ThreadPoolExecutor(torch.get_num_threads()) as pool:  # SciPy releases Python's lock
        return np.stack([*pool.map(partial(gaussian_filter, sigma=sigma, mode="nearest"), picture)])
