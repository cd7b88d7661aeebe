"""Place strokes as in pen-and-wash drawings: transparent washes, hatching, contours and the darkest accents."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import UserError, above, between, register
from brushexp.contracts.families import Initializer
from brushexp.contracts.members import InLayers
from brushexp.contracts.pictures import flatten_picture, sample_at
from brushexp.contracts.strokes import Strokes
from brushexp_media.init.contours import LOOKED_AT, TINY, contours
from brushexp_media.init.hatching import ANGLES, EVEN, forms, hatching, rows_drawn
from brushexp_media.init.ink import INK, INKED, rgb_of, strokes_of
from brushexp_media.init.shapes import fill_shape, remove_specks
from brushexp_media.marks import PEN
from brushexp_media.picture.decolorization import contrast_weights, decolorize
from brushexp_media.picture.lines import edge_lines
from brushexp_media.picture.noise import noise_of

Array = np.ndarray
LAYERS = 3  # hatching layers
REED, BLUNT = 0.0065, (2.2, 0.04)  # broadest accent in longer sides; scale and least difference of accent lines
DEEPEST = 0.33  # largest colour channel of a pixel that gets an accent
FEATURE_BLUR = 0.0016  # standard deviation of the blur under features, in longer sides
FEATURE_SIZES = ((0.02, 0.15, 0.5), (0.05, 0.3, 0.2))  # breadth, least depth, darkest lightness of features
SPECK = 1.2e-3  # smallest accent relative to the area of attention
SMOOTH = 0.004  # standard deviation of the blur of tones under hatching, in longer sides
KEPT = 0.5  # share of the given tone, rather than the one that leaves just enough white, in light pictures
FLAT_AT = 768  # longer side in pixels at which ``flatness`` is the weight of total variation
MARGIN, WAVER, WAVES = 0.022, 0.35, 0.06  # longer sides that stay bare; deviation of its edge over it; longer sides
SPARED = 0.4  # share of darkness that hatching leaves to lines in areas of attention
FOLLOWED = 0.5  # share of the turn towards the direction of forms that hatching takes
GROUPS, SWAY = 0.35, 0.2  # longer sides between groups of lines, and their rotation in radians
FACE_WASHES = 0.6  # share of washes among the strokes of a face; the others are contours
WASH_OPACITY, CALM = 0.9, 0.2  # of washes
CLOSEST = 0.6  # least distance between rows of hatching, in widths of the broadest contour
PRESSED = 0.3  # standard deviation of the logarithm of the width of hatching lines


@register("init", "drawing")
@dataclass(kw_only=True)
class Drawing(Initializer):
    """Washes in the colours of the picture, and over them, in ink: hatching, contours that swell, and dark accents.

    Washes are placed as by ``init=layers``. With ``renderer.kind=pen``, they are optimised, while the lines stay as
    drawn.

    Source: Winkenbach and Salesin (1994), on pen-and-ink illustration: tone is built up by successive layers of
    hatching, and outlines are drawn where neighbouring tones do not separate objects. Unlike in the source, hatching
    has fixed angles, from which it turns where forms are strong. Tones are those of a flattened picture, whose grey
    keeps the contrast between colours. In the focus, contours are finer, hatching is sparser, and small dark shapes
    (lids, pupils, a mouth) are filled.

    Args:
        washes: fraction of the strokes that are washes, 0 to 1.
        contours: fraction of the strokes that are contours, 0 to 1.
        accents: fraction of the strokes that fill small dark shapes, 0 to 1; all remaining strokes are hatching.
        layers: number of layers of washes.
        ratio: ratio of a layer's wash size to that of the layer below.
        cover: canvas area that a layer covers, as a fraction of the area that the layer below covers.
        broad: width of a wash, in the layer's mean wash spacing.
        reach: length of a wash, in the layer's mean wash spacing.
        edges: colour difference from the picture at which a wash ends, 0 to 1.
        flatness: flattening of forms by total variation, in proportion to the size of the picture; 0 = none.
        tones: darkness (0 = white, 1 = black) from which each of the three hatching layers is drawn; lower in light
            pictures.
        white: minimum fraction of the picture that has no hatching, 0 to 1.
        width: contour width, in thousandths of the longer side.
        length: line length, in hundredths of the longer side.
        color: colour of the ink, as '#rrggbb'.
    """

    washes: Annotated[float, between(0, 1)] = 0.4
    contours: Annotated[float, between(0, 1)] = 0.3
    accents: Annotated[float, between(0, 1)] = 0.1
    layers: Annotated[int, between(1, 8)] = 4
    ratio: Annotated[float, between(0.2, 1)] = 0.5
    cover: Annotated[float, above(0, 1)] = 0.7
    broad: Annotated[float, above(0, 10)] = 1.1
    reach: Annotated[float, above(0, 10)] = 6.0
    edges: Annotated[float, above(0, 1)] = 0.08
    flatness: Annotated[float, between(0, 2)] = 0.3
    tones: tuple[float, float, float] = (0.5, 0.68, 0.84)
    white: Annotated[float, between(0, 1)] = 0.5
    width: Annotated[float, above(0, 100)] = 3.4
    length: Annotated[float, above(0, 100)] = 7.0
    color: Annotated[str, INK] = "#16130f"

    def __post_init__(self) -> None:
        if len(self.tones) != LAYERS:
            cure = "give three, as init.tones=[0.4,0.6,0.8]"
            raise UserError(f"init.tones={list(self.tones)} are {len(self.tones)} values; {cure}")

    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

        picture = target.numpy().astype(np.float64)
        side, size = max(picture.shape), picture.shape[1:]
        flat = flatten_picture(target, self.flatness * side / FLAT_AT).numpy().astype(np.float64)
        weight = None if focus is None else focus.numpy().astype(np.float64)
        attended = np.zeros(size) if weight is None else (weight - weight.min()) / max(np.ptp(weight), TINY)
        near = np.ones(size, bool) if weight is None else attended > LOOKED_AT
        simple = flat + attended * (picture - flat)
        random = np.random.default_rng(int(torch.randint(2**31, (1,), generator=generator)))
        inner = _within_margin(size, random)
        weights = contrast_weights(picture)
        grey = decolorize(picture, weights)
        dark = (1 - decolorize(flat, weights)) * inner
        washes = round(n * self.washes)
        lines = min(n - washes, round(n * self.contours))
        accents = min(n - washes - lines, round(n * self.accents))
        sparing = gaussian_filter(dark * (1 - SPARED * attended), SMOOTH * side)
        ink = Strokes.join(
            self._hatching(sparing, _sway(FOLLOWED * forms(picture), random), n - washes - lines - accents, random),
            contours(picture, grey, lines, self._longest(side), self._widest(side), rgb_of(self.color), weight),
            self._fill_lines(
                edge_lines(simple, *BLUNT) * (simple.max(0) < DEEPEST) * near * inner, inner, accents // 2, random
            ),
            self._fill_lines(
                dark_features(picture.max(0)) * (attended > LOOKED_AT) * inner, attended, accents - accents // 2, random
            ),
        )
        ink = replace(ink, brush=PEN + ink.brush)
        return Strokes.join(self._layers()(target, washes, generator, focus), ink) if washes else ink

    def nearer(self) -> "Drawing":
        """Return a finer drawing for a face, whose small washes lie over those of the whole picture."""
        layers = self._layers().nearer()
        return replace(self, washes=FACE_WASHES, contours=1 - FACE_WASHES, layers=layers.layers, reach=layers.length)

    def _layers(self) -> InLayers:
        """Return the initialiser of the washes."""
        return InLayers(
            layers=self.layers, ratio=self.ratio, cover=self.cover, width=self.broad, length=self.reach,
            edges=self.edges, opacity=WASH_OPACITY, calm=CALM,
        )  # fmt: skip

    def _fill_lines(self, lines: Array, area: Array, n: int, random: np.random.Generator) -> Strokes:
        """Fill lines (H, W) with strokes of the same thickness, omitting parts tiny relative to an ``area`` (H, W)."""
        shapes = remove_specks(lines > INKED, SPECK * float((area > LOOKED_AT).sum()))
        curve, half = fill_shape(shapes, n, REED * max(lines.shape), random)
        return strokes_of(curve, 2 * half, half > 0, rgb_of(self.color), n)

    def _hatching(self, dark: Array, turned: Array, n: int, random: np.random.Generator) -> Strokes:
        """Draw hatching over dark areas, at fixed angles plus ``turned`` (H, W), as densely as ``n`` lines allow."""
        side, tones = max(dark.shape), self._above(self.tones, dark)
        area = sum(rows_drawn(dark, tone) for tone in tones)
        gap = max(CLOSEST * self._widest(side), area / max(n, 1) / (0.9 * self._longest(side)))
        hatchings = zip(tones, ANGLES, strict=True)
        parts = [hatching(dark, tone, angle, turned, gap, self._longest(side), random) for tone, angle in hatchings]
        curve = np.concatenate(parts)
        curve = curve[np.sort(random.permutation(len(curve))[:n])]
        darkness = sample_at(dark, *curve.mean(1).T)
        width = self._widest(side) * (0.08 + 0.5 * darkness**2) * random.lognormal(0, PRESSED, len(curve))
        return strokes_of(curve, width, darkness > 0, rgb_of(self.color), n)

    def _above(self, tones: Sequence[float], dark: Array) -> list[float]:
        """Adapt tone thresholds to a picture: raise them if too little paper would stay white; otherwise lower them."""
        left = [1 - (1 - self.white) / 2**k for k in range(len(tones))]
        most = [float(np.quantile(dark, share)) - EVEN for share in left]
        return [max(one, one + KEPT * (tone - one)) for tone, one in zip(tones, most, strict=True)]

    def _longest(self, side: int) -> float:
        return 0.01 * self.length * side

    def _widest(self, side: int) -> float:
        return 0.001 * self.width * side


def dark_features(lightness: Array) -> Array:
    """Find dark shapes surrounded by lighter areas, such as pupils, lids and nostrils, as a map (H, W) of 0 and 1."""
    from scipy.ndimage import black_tophat, gaussian_filter  # noqa: PLC0415  (slow to import)

    side, found = max(lightness.shape), np.zeros(lightness.shape, bool)
    even = gaussian_filter(lightness, FEATURE_BLUR * side)
    for breadth, least, darkest in FEATURE_SIZES:
        pixels = 2 * max(1, round(0.5 * breadth * side)) + 1
        found |= (black_tophat(even, size=pixels) > least) & (even < darkest)
    return found.astype(np.float64)


def _within_margin(size: tuple[int, ...], random: np.random.Generator) -> Array:
    """Mark the area (H, W) inside the draughtsman's margin, whose edge wavers."""
    y, x = (np.minimum(np.arange(side), np.arange(side)[::-1]) / max(size) for side in size)
    reach = np.minimum(x, y[:, None])
    return reach > MARGIN * (1 + WAVER * noise_of(size, WAVES, random))


def _sway(turned: Array, random: np.random.Generator) -> Array:
    """Vary hatching angles (H, W), in radians, slightly from one group of lines to the next."""
    return turned + SWAY * noise_of(turned.shape, GROUPS, random)
