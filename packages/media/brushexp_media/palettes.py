"""Palettes that map a picture's tones and colours to those of a medium."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import Rule, between, register
from brushexp.contracts.families import Palette
from brushexp.contracts.pictures import as_lab, as_picture, flatten_picture, load_picture, named_color, palette, recolor
from brushexp.contracts.tasks import PICTURE
from brushexp_media.init.ink import INK, rgb_of
from brushexp_media.picture.decolorization import contrast_weights, decolorize
from brushexp_media.picture.lines import edge_lines

Array = np.ndarray
GROUND = Rule(named_color)


def group_tones(lightness: Array, values: int, blend: float) -> Array:
    """Move lightness, 0 to 100, towards the nearest of ``values`` evenly spaced tones, by the fraction ``blend``."""
    if values == 0:
        return lightness
    steps = lightness / 100 * values
    middle = (np.floor(steps.clip(0, values - 1e-9)) + 0.5) / values * 100
    return lightness + blend * (middle - lightness)


def equalise_tones(lightness: Array, share: float) -> Array:
    """Equalise the histogram of lightness, 0 to 100; ``share`` is the strength, 0 to 1.

    Source: contrast-limited histogram equalisation (Zuiderveld, 1994). Unlike in the source, the histogram is computed
    over the whole picture.
    """
    if share == 0:
        return lightness
    count, ends = np.histogram(lightness, TONES, (0, 100))
    counted = np.minimum(count, STEEPEST * lightness.size / TONES)
    counted += (lightness.size - counted.sum()) / TONES
    even = np.interp(lightness, ends, 100 / lightness.size * np.append(0, counted.cumsum()))
    return lightness + share * (even - lightness)


def compress_chroma(chroma: Array, most: Array) -> Array:
    """Compress chroma so that it stays below ``most``; chroma up to half of this limit is unchanged."""
    half = most.clip(1e-6) / 2
    bent: Array = np.minimum(chroma, half) + half * (1 - np.exp(-(chroma - half).clip(0) / half))
    return bent


def harmonise(ab: Array, hues: int, share: float) -> Array:
    """Shift a* and b* (H, W, 2) towards the nearest of ``hues`` colours, found by k-means, and keep the chroma.

    Colours that are far from all of these, such as small accents, keep their hue. To make such colours rare, k-means
    weights each colour by the square root of its area.
    """
    cells = (ab.reshape(-1, 2) / BIN).round().astype(np.int64)
    lowest, sides = cells.min(0), np.ptp(cells, 0) + 1
    counts = np.bincount(np.ravel_multi_index(tuple((cells - lowest).T), sides))
    colors = BIN * (np.stack(np.unravel_index(counts.nonzero()[0], sides), 1) + lowest)
    weight = np.sqrt(counts[counts > 0]) * np.hypot(*colors.T)
    inks = palette(np.pad(colors, ((0, 0), (1, 0))), weight, hues)[:, 1:]
    if not len(inks):
        return ab
    far = np.square(ab[..., None, :] - inks).sum(-1)
    near = np.exp((far.min(-1, keepdims=True) - far) / (2 * SOFT**2))
    share = share * np.exp(-far.min(-1, keepdims=True) / (2 * ACCENT**2))
    drawn = ab + share * (near @ inks / near.sum(-1, keepdims=True) - ab)
    drawn *= (np.hypot(*ab.T).T / np.hypot(*drawn.T).T.clip(1e-6))[..., None]
    return drawn


@register("palette", "toned")
@dataclass(kw_only=True, eq=False)
class Toned(Palette):
    """Maps lightness to a range, scales chroma, groups values, flattens forms and draws outlines.

    Args:
        dark: lightness (CIELAB L*) to which black is mapped.
        light: lightness to which white is mapped.
        white: L* in the picture above which the painting has the lightness ``light``; 100 = none.
        spread: strength of contrast-limited histogram equalisation of tones, 0 (none) to 1 (full).
        gamma: exponent of lightness: below 1 raises the middle tones, above 1 lowers them.
        chroma: factor by which chroma is multiplied.
        least_chroma: chroma towards which colours other than grey are raised; 0 = none.
        most_chroma: upper limit of chroma, which is lower for the lightest colours unless they are yellow; 0 = none.
        hues: number of colours, found in the picture, towards which hues are shifted; 0 = none.
        harmony: strength with which hues are shifted towards these colours, 0 to 1.
        values: number of groups into which lightness is divided; 0 = none.
        grouping: strength with which lightness is shifted towards its group, 0 to 1.
        flatness: flattening of forms by total variation, in proportion to the size of the picture; 0 = none.
        irradiation: increase in lightness contrast with the surroundings, 0 to 2.
        outlines: strength of outlines, 0 to 1.
        night: extent to which dark areas of night scenes keep their own lightness, 0 to 1.
        warmth: shift of lights towards yellow and darks towards blue, in CIELAB units.
    """

    dark: Annotated[float, between(0, 100)] = 0.0
    light: Annotated[float, between(0, 100)] = 100.0
    white: Annotated[float, between(1, 100)] = 100.0
    spread: Annotated[float, between(0, 1)] = 0.0
    gamma: Annotated[float, between(0.1, 10)] = 1.0
    chroma: Annotated[float, between(0, 5)] = 1.0
    least_chroma: Annotated[float, between(0, 100)] = 0.0
    most_chroma: Annotated[float, between(0, 200)] = 0.0
    hues: Annotated[int, between(0, 16)] = 0
    harmony: Annotated[float, between(0, 1)] = 0.5
    values: Annotated[int, between(0, 64)] = 0
    grouping: Annotated[float, between(0, 1)] = 0.5
    flatness: Annotated[float, between(0, 2)] = 0.0
    irradiation: Annotated[float, between(0, 2)] = 0.0
    outlines: Annotated[float, between(0, 1)] = 0.0
    night: Annotated[float, between(0, 1)] = 0.75
    warmth: Annotated[float, between(0, 50)] = 0.0

    def __call__(self, picture: Tensor) -> Tensor:
        lines = edge_lines(picture.numpy()) if self.outlines else None
        own = as_lab(picture)[..., 0]
        lab = as_lab(flatten_picture(picture, self.flatness * max(picture.shape) / FLAT_AT))
        lightness = group_tones(equalise_tones(lab[..., 0], self.spread), self.values, self.grouping)
        if self.irradiation:
            lightness = lightness + self.irradiation * (lightness - _around(lightness))
        tone = (lightness / self.white).clip(0, 1) ** self.gamma
        toned = self.dark + tone * (self.light - self.dark)
        share = self.night * share_of_night(own.mean(), toned.mean()) * share_of_dark(own)
        tone = tone + share * (own / 100 - tone)
        chroma = np.hypot(lab[..., 1], lab[..., 2])
        tint = green_tint(lab[..., 1], chroma, toned)
        raised = self.chroma * chroma
        raised += (self.least_chroma - raised).clip(0) * (chroma / LEAST_HUE).clip(0, 1)
        if self.chroma > 1 or self.least_chroma:
            raised += tint * (NEUTRAL * chroma - raised)
        if self.most_chroma:
            yellow = (lab[..., 2] / chroma.clip(1e-6)).clip(0) ** 2  # yellow may be pure even where it is light
            raised = compress_chroma(
                raised, self.most_chroma * np.sqrt(1 - ((1 - yellow) * (2 * tone - 1).clip(0)) ** 2)
            )
        if self.hues:
            lab[..., 1:] = harmonise(lab[..., 1:], self.hues, self.harmony)
        purity = raised / chroma.clip(1e-6)
        lab[..., 0] = toned + share * (own - toned)
        bleached = ((tone - 0.9) / 0.1).clip(0, 1) * (2 - 2 * chroma / CLEAR).clip(0, 1) * (self.white < 100)
        lab[..., 1:] *= (purity * (1 - bleached))[..., None]
        lab[..., 2] += self.warmth * (2 * tone - 1) * (1 - bleached)
        if lines is not None:
            strength = self.outlines * lines[..., None]
            lab += strength * (np.array(OUTLINE) - lab)
        return as_picture(lab)


@register("palette", "one_ink")
@dataclass(kw_only=True, eq=False)
class OneInk(Toned):
    """Paints in washes of one ink: greys that keep the contrast between colours, toned, as ever darker washes on paper.

    Washes are powers of the colour of one wash, like several layers of a tint (the law of Beer and Lambert); each has
    the lightness of the tone that it stands for.

    Args:
        paper: colour of the lightest tone, as '#rrggbb'; ``mean`` and ``transparent`` = white.
        wash: colour of one wash on white paper, as '#rrggbb'.
    """

    paper: Annotated[str, GROUND] = "#f6efe0"
    wash: Annotated[str, INK] = "#d8c7aa"
    has_hues: ClassVar[bool] = False

    def __call__(self, picture: Tensor) -> Tensor:
        planes = picture.numpy().astype(np.float64)
        grey = torch.from_numpy(decolorize(planes, contrast_weights(planes))).to(picture)
        tone = as_lab(super().__call__(grey.expand(3, -1, -1).contiguous()))[..., 0]
        depth = np.linspace(0, DEEPEST, SHADES)[:, None]
        paper = np.ones(3) if named_color(self.paper, "palette.paper") is None else rgb_of(self.paper)
        washes = paper * rgb_of(self.wash) ** depth
        lightness = as_lab(torch.from_numpy(washes.T[:, :, None]))[:, 0, 0]
        darkness = np.interp(-tone, -lightness, depth[:, 0])
        color = paper * rgb_of(self.wash) ** darkness[..., None]
        return torch.from_numpy(color).permute(2, 0, 1).to(picture).contiguous()


def green_tint(red: Array, chroma: Array, lightness: Array) -> Array:
    """Compute how close colours are to a greenish white, 0 to 1, from their a*, chroma and L*.

    If the chroma of such colours were raised, teeth, eyes and linen would turn green. Faint warm and blue tints, such
    as those of clouds, are harmless.
    """
    green = (-red / chroma.clip(1e-6)).clip(0, 1)
    light = ((lightness - TINTED[0]) / (TINTED[1] - TINTED[0])).clip(0, 1)
    return green * light * (1 - chroma / TINT).clip(0, 1)


def share_of_night(own: float, toned: float) -> float:
    """Compute how much of a picture's own lightness, 0 to 1, a palette should keep so that night scenes stay dark.

    ``own`` is the mean L* of the picture, and ``toned`` its mean L* after the palette's tone mapping.
    """
    allowed = NIGHT_LIFT + TWILIGHT_LIFT * max(own - NIGHT, 0.0)
    return 1 - min(1.0, allowed / max(toned - own, 1e-6))


def share_of_dark(lightness: Array) -> Array:
    """Compute each pixel's darkness, from 0 (lit) to 1 (dark), from its L*."""
    lit = ((lightness - LAMPLIGHT[0]) / (LAMPLIGHT[1] - LAMPLIGHT[0])).clip(0, 1)
    return 1 - lit * lit * (3 - 2 * lit)


def _around(lightness: Array) -> Array:
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415  (slow to import)

    around: Array = gaussian_filter(lightness, IRRADIATED * max(lightness.shape))
    return around


LEAST_HUE = 8.0  # chroma above which the chroma of a colour may be raised fully
TINT = 24.0  # chroma of a green above which it is no longer a tint of white
TINTED = 55.0, 85.0  # L* below which no green is a tint of white, and above which every pale green is
NEUTRAL = 0.3  # share of its chroma that such a tint keeps where other colours become purer
NIGHT = 32.0  # mean L* below which a picture is a night scene
NIGHT_LIFT, TWILIGHT_LIFT = 1.0, 1.5  # L* by which a palette may lighten a night scene, and more per L* above `NIGHT`
LAMPLIGHT = 28.0, 56.0  # L* below which areas of a night scene are dark, and above which they are fully lit
BIN, SOFT = 2.0, 8.0  # CIELAB: side of the cells in which colours are counted; softness of the borders between hues
ACCENT = 12.0  # CIELAB: distance from all hues at which the shift towards them fades
IRRADIATED = 0.02  # longer sides: standard deviation of the blur with which each pixel is compared
TONES, STEEPEST = 64, 2.5  # histogram bins for tones, and limit of a bin relative to the mean
FLAT_AT = 768  # longer side in pixels at which ``flatness`` is the weight of total variation
CLEAR = 45.0  # chroma above which a colour never becomes white, however light
PALETTE_SIDE = 512  # longer side in pixels at which the colours of another picture are sampled
DEEPEST, SHADES = 16.0, 256  # number of washes over each other in the darkest tone; tones between it and the paper
OUTLINE = (18.0, 6.0, -28.0)  # L*, a*, b* of outlines: Prussian blue


@register("palette", "picture")
@dataclass(kw_only=True, eq=False)
class OfPicture(Palette):
    """Gives a picture's colours the mean and the covariance of another picture's colours.

    Args:
        image: picture file, or the name of a sample.
    """

    image: Annotated[str, PICTURE] = "coffee"

    def __call__(self, picture: Tensor) -> Tensor:
        return recolor(picture, like=self._like)

    @cached_property
    def _like(self) -> Tensor:
        return load_picture(self.image, PALETTE_SIDE)
