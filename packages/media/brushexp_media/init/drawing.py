"""Place strokes as in ink drawings: washes in the shapes of shadows, hatching, contours and the darkest accents."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import Rule, UserError, above, between, register
from brushexp.contracts.families import Initializer
from brushexp.contracts.pictures import flatten_picture, named_color, sample_at, structure_tensor
from brushexp.contracts.strokes import Strokes
from brushexp_media.init.contours import LOOKED_AT, TINY, contours
from brushexp_media.init.dark_shapes import DarkShapes
from brushexp_media.init.hatching import ANGLES, EVEN, forms, hatching
from brushexp_media.init.ink import INKED, rgb_of, strokes_of
from brushexp_media.init.washes import between_tones, fill_shape, remove_specks
from brushexp_media.picture.decolorization import contrast_weights, decolorize
from brushexp_media.picture.lines import edge_lines
from brushexp_media.picture.noise import noise_of

Array = np.ndarray
BROADEST = 0.06  # width of a wash, in longer sides
DEPTHS = (0.9, 2.4, 6.5)  # successive washes, as powers of the colour of the first
LEAST_WASH = 0.006  # share of the picture below which a shape is no wash, and a hole in a wash is filled
REED, BLUNT = 0.0065, (2.2, 0.04)  # broadest accent in longer sides; scale and least difference of accent lines
DEEPEST = 0.33  # largest colour channel of a pixel that gets an accent
FEATURE_BLUR = 0.0016  # standard deviation of the blur under features, in longer sides
FEATURE_SIZES = ((0.02, 0.15, 0.5), (0.05, 0.3, 0.2))  # breadth, least depth, darkest lightness of features
SPECK = 1.2e-3  # smallest accent relative to the area of attention
EDGE, LOST = 0.05, 0.7  # softness of the edge of a wash, and additional softness of a lost edge, in stroke widths
FOUND = 5.0  # slope of darkness, per longer side, above which the edge of a wash is sharp
SMOOTH, SMOOTH_WASH = 0.004, 0.008  # standard deviation of the blur of tones under hatching and washes, in longer sides
SMOOTH_FAR = 0.018  # standard deviation of the blur of tones under washes away from the focus, in longer sides
FADED = 0.55  # by how much the exponent of darkness grows away from the focus, where washes are lighter
KEPT = 0.5  # share of the given tone, rather than the one that leaves just enough white, in light pictures
FLAT_AT = 768  # longer side in pixels at which ``flatness`` is the weight of total variation
MARGIN, WAVER, WAVES = 0.022, 0.35, 0.06  # longer sides that stay bare; deviation of its edge over it; longer sides
SPARED = 0.4  # share of darkness that hatching leaves to lines in areas of attention
GROUPS, SWAY = 0.09, 0.12  # longer sides between groups of lines, and their rotation in radians
PRESSED = 0.3  # standard deviation of the logarithm of the width of hatching lines
INK = Rule(named_color)


@register("init", "drawing")
@dataclass(kw_only=True)
class Drawing(Initializer):
    """Washes in the shapes of three tones, hatching over them, contours that swell with contrast, and dark accents.

    Source: Winkenbach and Salesin (1994), on pen-and-ink illustration: tone is built up by successive layers of
    hatching, and outlines are drawn where neighbouring tones do not separate objects. Unlike in the source, hatching
    has fixed angles, from which it turns by up to `TURN` where forms are strong. Shapes are found in a flattened
    picture, whose grey keeps the contrast between colours. In the focus, forms are kept, contours are finer, hatching
    is sparser, and small dark shapes (lids, pupils, a mouth) are filled; elsewhere, tones are lighter.

    Args:
        contours: fraction of the strokes that are contours, 0 to 1.
        washes: fraction of the strokes that are washes, 0 to 1.
        accents: fraction of the strokes that fill small dark shapes, 0 to 1.
        flatness: flattening of forms by total variation, in proportion to the size of the picture; 0 = none.
        tones: darkness (0 = white, 1 = black) from which each of the three hatching layers is drawn; lower in light
            pictures.
        wash_tones: darkness from which the light, the middle and the dark wash are drawn; lower in light pictures.
        white: minimum fraction of the picture that has neither hatching nor wash, 0 to 1.
        width: contour width, in thousandths of the longer side.
        length: line length, in hundredths of the longer side.
        color: colour of the ink, as '#rrggbb'.
        wash: colour of the light wash, as '#rrggbb'; the other washes are powers of it, like several layers of a tint.
    """

    contours: Annotated[float, between(0, 1)] = 0.4
    washes: Annotated[float, between(0, 1)] = 0.25
    accents: Annotated[float, between(0, 1)] = 0.15
    flatness: Annotated[float, between(0, 2)] = 0.3
    tones: tuple[float, float, float] = (0.5, 0.68, 0.84)
    wash_tones: tuple[float, float, float] = (0.4, 0.6, 0.78)
    white: Annotated[float, between(0, 1)] = 0.5
    width: Annotated[float, above(0, 100)] = 3.4
    length: Annotated[float, above(0, 100)] = 7.0
    color: Annotated[str, INK] = "#16130f"
    wash: Annotated[str, INK] = "#c9c3b8"

    def __post_init__(self) -> None:
        for option, tones in (("tones", self.tones), ("wash_tones", self.wash_tones)):
            if len(tones) != len(DEPTHS):
                cure = f"give three, as init.{option}=[0.4,0.6,0.8]"
                raise UserError(f"init.{option}={list(tones)} are {len(tones)} values; {cure}")

    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

        picture = target.numpy().astype(np.float64)
        side, size = max(picture.shape), picture.shape[1:]
        flat = flatten_picture(target, self.flatness * side / FLAT_AT).numpy().astype(np.float64)
        weight = None if focus is None else focus.numpy().astype(np.float64)
        attended = np.zeros(size) if weight is None else (weight - weight.min()) / max(np.ptp(weight), TINY)
        simple = flat + attended * (picture - flat)
        random = np.random.default_rng(int(torch.randint(2**31, (1,), generator=generator)))
        inner = _within_margin(size, random)
        weights = contrast_weights(picture)
        grey = decolorize(picture, weights)
        dark = (1 - decolorize(flat, weights)) * inner
        washes = round(n * self.washes)
        lines = min(n - washes, round(n * self.contours))
        accents = min(n - washes - lines, round(n * self.accents))
        steep = slope_of(inner * (1 - grey))
        distant = np.zeros(size) if weight is None else _distance_from(attended)
        sparing = gaussian_filter(dark ** (1 + FADED * distant) * (1 - SPARED * attended), SMOOTH * side)
        return Strokes.join(
            self._washes(_simplify(dark, distant), steep, washes, random),
            self._hatching(sparing, _sway(forms(picture), random), n - washes - lines - accents, random),
            contours(picture, grey, lines, self._longest(side), self._widest(side), rgb_of(self.color), weight),
            self._fill_lines(
                edge_lines(simple, *BLUNT) * (simple.max(0) < DEEPEST) * inner, inner, accents // 2, random
            ),
            self._fill_lines(
                dark_features(picture.max(0)) * (attended > LOOKED_AT) * inner, attended, accents - accents // 2, random
            ),
        )

    def details(self) -> Initializer:
        return DarkShapes(color=self.color)

    def _fill_lines(self, lines: Array, area: Array, n: int, random: np.random.Generator) -> Strokes:
        """Fill lines (H, W) with strokes of the same thickness, omitting parts tiny relative to an ``area`` (H, W)."""
        shapes = remove_specks(lines > INKED, SPECK * float((area > LOOKED_AT).sum()))
        curve, half = fill_shape(shapes, n, REED * max(lines.shape), random)
        return strokes_of(curve, 2 * half, half > 0, rgb_of(self.color), n)

    def _hatching(self, dark: Array, turned: Array, n: int, random: np.random.Generator) -> Strokes:
        """Draw hatching over dark areas, at fixed angles plus ``turned`` (H, W), as densely as ``n`` lines allow."""
        side, tones = max(dark.shape), self._above(self.tones, dark)
        area = sum(float((dark > tone).sum()) for tone in tones)
        gap = max(1.2, area / max(n, 1) / (0.9 * self._longest(side)))
        hatchings = zip(tones, ANGLES, strict=True)
        parts = [hatching(dark, tone, angle, turned, gap, self._longest(side), random) for tone, angle in hatchings]
        curve = np.concatenate(parts)
        curve = curve[np.sort(random.permutation(len(curve))[:n])]
        darkness = sample_at(dark, *curve.mean(1).T)
        width = self._widest(side) * (0.08 + 0.5 * darkness**2) * random.lognormal(0, PRESSED, len(curve))
        return strokes_of(curve, width, darkness > 0, rgb_of(self.color), n)

    def _washes(self, dark: Array, steep: Array, n: int, random: np.random.Generator) -> Strokes:
        """Place a wash over the shapes of each tone; each wash is darker than the previous one.

        A wash has sharp edges where the picture has an edge nearby, and blurred edges where forms are soft.
        """
        from scipy.ndimage import distance_transform_edt  # noqa: PLC0415  (slow to import)

        tones = self._above([between_tones(dark, tone) for tone in self.wash_tones], dark)
        parts = []
        for number, (depth, tone) in enumerate(zip(DEPTHS, tones, strict=True)):
            count = n * (number + 1) // len(tones) - n * number // len(tones)
            shape = remove_specks(dark > tone, LEAST_WASH * dark.size)
            curve, half = fill_shape(shape, count, BROADEST * max(dark.shape), random)
            strokes = strokes_of(curve, 2 * half, half > 0, rgb_of(self.wash) ** depth, count)
            ends = distance_transform_edt(np.pad(shape, 1, mode="edge"), return_indices=True, return_distances=False)
            y, x = (sample_at(end[1:-1, 1:-1] - 1, *curve.mean(1).T) for end in ends)
            lost = np.pad((1 - sample_at(steep, x, y) / FOUND).clip(0, 1), (0, count - len(curve)))
            parts.append(replace(strokes, softness=(EDGE + LOST * torch.from_numpy(lost).float()) * strokes.width))
        return Strokes.join(*parts)

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


def _distance_from(attended: Array) -> Array:
    """Compute each pixel's distance from the area of attention: 0 inside, 1 far away, with a soft transition."""
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

    near: Array = gaussian_filter(attended.clip(0, LOOKED_AT) / LOOKED_AT, SMOOTH_FAR * max(attended.shape))
    return 1 - near


def _simplify(dark: Array, distant: Array) -> Array:
    """Blur and lighten darkness (H, W) for washes, most where ``distant`` (H, W) is 1, to simplify backgrounds."""
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

    near, far = (gaussian_filter(dark, blur * max(dark.shape)) for blur in (SMOOTH_WASH, SMOOTH_FAR))
    return (near + distant * (far - near)) ** (1 + FADED * distant)


def _within_margin(size: tuple[int, ...], random: np.random.Generator) -> Array:
    """Mark the area (H, W) inside the draughtsman's margin, whose edge wavers."""
    y, x = (np.minimum(np.arange(side), np.arange(side)[::-1]) / max(size) for side in size)
    reach = np.minimum(x, y[:, None])
    return reach > MARGIN * (1 + WAVER * noise_of(size, WAVES, random))


def _sway(turned: Array, random: np.random.Generator) -> Array:
    """Vary hatching angles (H, W), in radians, slightly from one group of lines to the next."""
    return turned + SWAY * noise_of(turned.shape, GROUPS, random)


def slope_of(luma: Array) -> Array:
    """Compute the slope (H, W) of luma, per longer side, after the blur used for washes."""
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

    side = max(luma.shape)
    xx, _, yy = structure_tensor(gaussian_filter(luma, SMOOTH_WASH * side)[None], 0.0)
    slope: Array = np.sqrt(xx + yy) * side
    return slope
