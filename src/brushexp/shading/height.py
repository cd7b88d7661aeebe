"""How high the paint of a painting stands.

The thickness of one stroke is told by its coverage, or, for plain strokes, by bristles drawn at random. It is in films:
1 is the thickest that a brush leaves. It travels in the place of a texture's light, thickness - 1, because black paint
(0) of that light has the colour thickness * colour.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from brushexp.compositing.bands import Drawer, band_of, cuts, within
from brushexp.compositing.layers import SPREAD, Compose, Layers, Size
from brushexp.compositing.profile import Profile, smooth_rise
from brushexp.compositing.textured_profile import TexturedProfile
from brushexp.compositing.textures import HALF, Loop, Sheets, cells_of, coordinates_of, sheets_of
from brushexp.compositing.windows import Windows
from brushexp.strokes.bezier import half_width_of
from brushexp.strokes.catalogue import Strokes, drawable

FILM = 0.1  # how thick the paint is that a stroke leaves at most, in widths of a stroke as wide as is typical
BROADER = 0.25  # power of a stroke's width to which its film grows: with more of it, relief is uneven
CARRIED = 0.75  # share of the paint below that an opaque stroke carries away or levels
THIN = 0.5  # pixels: a stroke thinner than about twice this is drawn so thick, and lower
AT_ONCE = 256  # windows
DENSE = 0.97  # coverage of a full film
LIT = 0.8  # films by which paint is higher where it is white by light than where it has its own colour
VARIANTS, LEVELS = 8, 5  # brushes of plain strokes; sizes, each half of the one before
ROWS, COLUMNS = 48, 64  # texels of their textures, across and along
KNOTS = 6  # along a stroke, between which bristles waver
RAGGED = 0.2  # share by which the ends of bristles differ
THINNEST = 0.1  # films, between bristles
BODY, FINE, COARSE = 0.5, 0.15, 0.12  # films: of the middle, and of single bristles and tufts
RIDGE, RIDGE_AT, RIDGE_WIDE = 0.3, 0.76, 0.13  # films of what is pushed aside; where and how wide in half widths
SPENT = 0.25  # share of its paint that a brush has left at the end of a stroke
SHOULDER = 0.3  # half widths over which the edge of the paint is round
EDGE = (0.85, 1.1)  # half widths between which a plain stroke ends


@torch.no_grad()
def heights(
    strokes: Strokes, front_to_back: Tensor, size: Size, renderer: Drawer, blend: Compose
) -> Iterator[tuple[int, int, Tensor, np.ndarray]]:
    """Height of the paint from the top of the canvas to its bottom, in pixels of the picture; the bare canvas is 0.

    What comes is the first row of each band, how many rows it has, the numbers of its strokes, and heights (h, W),
    float32, of these rows and of the one before and after them, where there are such: all that their slopes need.

    Strokes are laid from the bottom to the top: h <- h (1 - CARRIED a) + a t, with the opacity a of a stroke at a pixel
    and the thickness t of its film there, at most ``FILM`` times a geometric mean of its width (which counts BROADER)
    and the typical one: a broader brush leaves thicker paint, but the first broad strokes do not outdo what is painted
    over them. A picture twice as large has the same slopes. A blend makes all this of strokes of opacity CARRIED a and
    "colour" t / CARRIED.

    Where renderers say how their strokes cover and shine, t is higher where their bristles left more paint; plain
    strokes get bristles, and ridges where a brush pushes paint aside, from textures drawn at random.

    Source: Hertzmann, "Fast paint texture" (2002): strokes with textures of opacity and height are laid over each other
    as colours are. Differs: covered paint still shows in the surface, and the thickness depends on the brush.
    """
    impasto, (height, width) = Impasto(renderer, typical_width(strokes)), size
    place, reached = front_to_back.argsort(), impasto.rows(strokes)
    bare = strokes.color.new_zeros(3)
    for top, rows, number in cuts(strokes, size, impasto):
        first, after = max(top - 1, 0), min(top + rows + 1, height)
        near = number if reached is None else within(reached, first, after - first)
        band = band_of(strokes, place, near, (first, after - first, width), bare, impasto, blend)
        yield top, rows, number, band[0].cpu().numpy()


def typical_width(strokes: Strokes) -> float:
    """Median width of strokes in pixels; 0 without any."""
    return 2 * float(half_width_of(strokes).median()) if len(strokes) else 0.0


@dataclass(frozen=True)
class Impasto:
    """Draws strokes whose colour is the height of their paint; ``typical`` is the median width of a stroke, pixels."""

    renderer: Drawer
    typical: float

    @property
    def at_once(self) -> int | None:
        """A quarter of what the renderer draws at once: the layers made of it need room as well."""
        return self.renderer.at_once and max(1, self.renderer.at_once // 4)

    def rows(self, strokes: Strokes) -> Tensor | None:
        return self.renderer.rows(strokes)

    def __call__(self, strokes: Strokes) -> Layers:
        strokes = drawable(strokes)
        layers = self.renderer(strokes)
        film = FILM * self.typical ** (1 - BROADER) * (2 * half_width_of(strokes)) ** BROADER
        if isinstance(layers, Profile):
            return _plain(layers, film, strokes.brush)
        if isinstance(layers, TexturedProfile):
            return _textured(layers, film)
        if isinstance(layers, Windows):
            return _windows(layers, film)
        return HeightLayers(layers.curve, layers.reach, layers.color, layers, film)


@dataclass(frozen=True)
class HeightLayers(Layers):
    """Layers of any other kind, whose colour is the height of their paint; ``film`` (N,) is how thick it is at most."""

    per_stroke = ()

    curve: Tensor
    reach: Tensor
    color: Tensor
    layers: Layers
    film: Tensor

    def sample(self, index: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        alpha, color = self.layers.sample(index, points)
        light = (color - self.color[index][:, :, None]).mean(-1)
        height = self.film[index][..., None] * thickness_of(alpha, light)
        return CARRIED * alpha, (height / CARRIED)[..., None].expand(*height.shape, 3)


def _as_layers(film: Tensor, opacity: Tensor) -> dict[str, Tensor]:
    """Colour and opacity with which a blend of full films computes heights."""
    return {"color": (film / CARRIED)[:, None].expand(-1, 3).contiguous(), "opacity": CARRIED * opacity}


def _plain(layers: Profile, film: Tensor, brush: Tensor) -> TexturedProfile:
    """Strokes without a texture, with that of a brush."""
    sheets = _plain_brush(layers.taper, film.device)
    half = (layers.half_width.square() + THIN**2).sqrt()
    texel = half * (2 * SPREAD / ROWS)  # of the size whose texels are about as large as pixels
    look = brush % VARIANTS * LEVELS + texel.log2().neg().floor().clamp(0, LEVELS - 1).long()
    shown = _as_layers(film, layers.opacity * layers.half_width / half)
    once = torch.ones_like(look)
    return TexturedProfile(layers.curve, half, look=look, repeats=once, flip=once, sheets=sheets, **shown)


def _textured(layers: TexturedProfile, film: Tensor) -> TexturedProfile:
    """Strokes with a texture, as high as it says."""
    return replace(layers, sheets=_raised(layers.sheets), **_as_layers(film, layers.opacity))


def _windows(layers: Windows, film: Tensor) -> Windows:
    """Drawn windows, whose colours are replaced by what their coverage and light say of the height."""
    images = []
    for image, color, full in zip(*(part.split(AT_ONCE) for part in (layers.images, layers.color, film)), strict=True):
        light = (image[:, :3] - color[:, :, None, None]).mean(1)
        height = thickness_of(image[:, 3], light) * (full / CARRIED)[:, None, None]
        images.append(torch.stack([height, height, height, image[:, 3]], dim=1))
    return replace(layers, images=torch.cat(images), opacity=CARRIED * layers.opacity)


def thickness_of(coverage: Tensor, light: Tensor) -> Tensor:
    """Films of paint where a stroke covers the canvas to ``coverage`` (0 to 1) and shines by ``light`` (-1 to 1).

    A height is -log(1 - coverage), as in the simulator (`engine.fluid`): a splat of height w leaves the share exp(-w)
    of the canvas bare. Light lies on the ridges.
    """
    bare = torch.log1p(-coverage * DENSE) / torch.log1p(torch.tensor(-DENSE)).to(coverage)
    return (bare * (1 + LIT * light)).clamp(0, 1)


@lru_cache(maxsize=1)  # a renderer's textures are the same at every call
def _raised(sheets: Sheets) -> Sheets:
    """Textures of opacity and, in place of the tone, thickness - 1: their own, or what opacity and tone tell of it."""
    opacity, tone = sheets.texels[:, 0], sheets.texels[:, 1]
    thickness = sheets.texels[:, 2] if sheets.texels.shape[1] > 2 else thickness_of(opacity, tone)
    texels = torch.stack([opacity, ((thickness - 1) * HALF).round() / HALF], dim=1)
    return replace(sheets, texels=texels, cells=None if sheets.cells is None else cells_of(texels, sheets.size))


@lru_cache(maxsize=4)
def _plain_brush(taper: float, device: torch.device) -> Sheets:
    """Textures for strokes that have none: VARIANTS brushes, each in LEVELS sizes, look = variant * LEVELS + level."""
    across, t, before, beyond = (part[1:-1] for part in coordinates_of(ROWS, COLUMNS))
    half = (1 - taper * (2 * t - 1) ** 2).clamp_min(0.05)
    fine, coarse = _streaks(1.0), _streaks(3.0)
    ragged = 1 + RAGGED * (1 + coarse).clamp_min(0)  # some bristles touch down later and lift off earlier
    from_curve = torch.hypot(across[:, None], (before + beyond) * ragged) / half  # 1 at the edge
    ridge = torch.exp(-(((from_curve - RIDGE_AT) / RIDGE_WIDE) ** 2)) * (1 + 0.5 * coarse).clamp_min(0)
    film = BODY * (1 + 0.5 * SPENT - SPENT * t) + FINE * fine + COARSE * coarse + RIDGE * ridge
    shoulder = 0.5 + smooth_rise((EDGE[1] - from_curve) / SHOULDER - 0.5)
    opacity = 0.5 + smooth_rise((EDGE[1] - from_curve) / (EDGE[1] - EDGE[0]) - 0.5).expand_as(film)
    textures = torch.stack([opacity, film.clamp(THINNEST, 1) * shoulder - 1], dim=1)
    return sheets_of(textures.to(device), LEVELS, Loop(0, 0), rounded=True)


def _streaks(spread: float) -> Tensor:
    """Noise (VARIANTS, ROWS, COLUMNS) of mean 0 and deviation 1: ``spread`` rows wide, and long."""
    generator = torch.Generator().manual_seed(round(1000 * spread))
    knots = torch.randn(VARIANTS, ROWS, KNOTS, generator=generator)
    knots = 0.8 * knots[..., :1] + 0.6 * knots  # mostly the same bristles all the way
    place = torch.arange(ROWS)
    blur = torch.exp(-0.5 * ((place[:, None] - place) / spread) ** 2)
    noise = functional.interpolate(blur @ knots, COLUMNS, mode="linear", align_corners=True)
    return (noise - noise.mean((1, 2), keepdim=True)) / noise.std((1, 2), keepdim=True)
