"""Compute the height of a painting's paint.

The thickness of a stroke follows from its coverage or, for plain strokes, from random bristles. Its unit is the film: 1
is the thickest layer of paint that a brush leaves. Textures hold thickness - 1 in place of the tone: a negative tone
mixes the colour with that share of black (0), which yields thickness * colour.
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
from brushexp.pictures.load import BRIGHTNESS
from brushexp.strokes.bezier import half_width_of
from brushexp.strokes.catalogue import Strokes, drawable

FILM = 0.1  # thickest paint of a stroke of typical width, relative to its width
BROADER = 0.25  # exponent of a film's growth with the width of its stroke; larger values make relief uneven
CARRIED = 0.75  # share of the paint below that an opaque stroke removes or levels
THIN = 0.5  # pixels; strokes thinner than about twice this are drawn at that thickness, but lower
AT_ONCE = 256  # number of windows computed in one batch
DENSE = 0.97  # coverage of a full film
LEAN = 0.12  # thickness of the darkest paint, in films, because painters keep darks thin and lights thick
LEAN_UNTIL, BODY_FROM = 0.12, 0.6  # largest luma of the thinnest paint, and smallest luma of full films
FILLED = 0.25  # thickness of paint, in films, that reduces the relief of the ground to about a third
LIT = 0.8  # extra height, in films, of paint that shines white over paint in its own colour
VARIANTS, LEVELS = 8, 5  # brushes of plain strokes; sizes, each half of the previous one
ROWS, COLUMNS = 48, 64  # texels of their textures, across and along
KNOTS = 6  # number of knots along a stroke between which bristles waver
RAGGED = 0.2  # relative variation of the ends of bristles
THINNEST = 0.1  # films; smallest thickness between bristles
BODY, FINE, COARSE = 0.5, 0.15, 0.12  # films: the middle, single bristles, and tufts
RIDGE, RIDGE_AT, RIDGE_WIDE = 0.3, 0.76, 0.13  # height of displaced paint, films; its position and width, half widths
SPENT = 0.25  # fraction of its paint that a brush has left at the end of a stroke
SHOULDER = 0.3  # half widths over which the edge of the paint is rounded
EDGE_RANGE = (0.85, 1.1)  # half widths between which a plain stroke ends


@torch.no_grad()
def heights(
    strokes: Strokes, front_to_back: Tensor, size: Size, renderer: Drawer, blend: Compose
) -> Iterator[tuple[int, int, Tensor, np.ndarray]]:
    """Compute the height of the paint band by band, from top to bottom, in pixels; the bare canvas has height 0.

    Yields the first row of each band, its number of rows, the indices of its strokes, and the heights (h, W), float32.
    The heights include the rows just above and below the band, where they exist, because slopes need them.

    Strokes are composited from bottom to top: h <- h (1 - CARRIED a) + a t, where a is the opacity of a stroke at a
    pixel and t is the thickness of its film there. t is at most FILM times a geometric mean of the stroke's width (with
    weight BROADER) and the typical width: a broader brush leaves thicker paint, but the first broad strokes do not
    dominate the paint above them. Slopes do not change if the picture is enlarged. A blend computes h from strokes of
    opacity CARRIED a and "colour" t / CARRIED.

    If the renderer provides coverage and light, t is greater where bristles left more paint. Plain strokes get bristles
    from random textures, with ridges where a brush displaces paint.

    Source: Hertzmann, "Fast paint texture" (2002): textures of opacity and height are composited like colours. Differs
    from the source: covered paint still shows in the surface, and the thickness depends on the brush.
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
    """Compute the median width of strokes in pixels; it is 0 if there are none."""
    return 2 * float(half_width_of(strokes).median()) if len(strokes) else 0.0


@dataclass(frozen=True)
class Impasto:
    """A renderer that draws the height of paint as colour; ``typical`` is the median stroke width in pixels."""

    renderer: Drawer
    typical: float

    @property
    def at_once(self) -> int | None:
        return self.renderer.at_once and max(1, self.renderer.at_once // 4)  # the new layers need memory as well

    def rows(self, strokes: Strokes) -> Tensor | None:
        return self.renderer.rows(strokes)

    def __call__(self, strokes: Strokes) -> Layers:
        strokes = drawable(strokes)
        layers = self.renderer(strokes)
        film = FILM * self.typical ** (1 - BROADER) * (2 * half_width_of(strokes)) ** BROADER
        film = film * body_of(strokes.color)
        if isinstance(layers, Profile):
            return _add_bristles(layers, film, strokes.brush)
        if isinstance(layers, TexturedProfile):
            return replace(layers, sheets=_raise_sheets(layers.sheets), **_as_layers(film, layers.opacity))
        if isinstance(layers, Windows):
            return _raise_windows(layers, film)
        return HeightLayers(layers.curve, layers.reach, layers.color, layers, film)


def body_of(color: Tensor) -> Tensor:
    """Compute the thickness (N,), in films, of paint with colours (N, 3): from LEAN for darks to 1 for lights.

    Thickness therefore depends only on lightness, and ridges coincide with changes in tone.
    """
    luma = color @ color.new_tensor(BRIGHTNESS)
    share = ((luma - LEAN_UNTIL) / (BODY_FROM - LEAN_UNTIL)).clamp(0, 1)
    return LEAN + (1 - LEAN) * share


def surface_height(paint: np.ndarray, ground: np.ndarray, typical: float) -> np.ndarray:
    """Add the height of ``paint`` to that of the ``ground``, both (h, W) in pixels; thick paint levels the ground.

    ``typical`` is the median stroke width in pixels.
    """
    film = max(FILM * typical, 1e-6)
    height: np.ndarray = paint + ground * np.exp(-paint / (FILLED * film))
    return height


@dataclass(frozen=True)
class HeightLayers(Layers):
    """Layers that wrap layers of any other type and replace their colour with height, at most ``film`` (N,)."""

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
    return {"color": (film / CARRIED)[:, None].expand(-1, 3).contiguous(), "opacity": CARRIED * opacity}


def _add_bristles(layers: Profile, film: Tensor, brush: Tensor) -> TexturedProfile:
    sheets = _bristle_sheets(layers.taper, film.device)
    half = (layers.half_width.square() + THIN**2).sqrt()
    texel = half * (2 * SPREAD / ROWS)  # size of a texel of the finest texture, in pixels
    look = brush % VARIANTS * LEVELS + texel.log2().neg().floor().clamp(0, LEVELS - 1).long()
    parts = _as_layers(film, layers.opacity * layers.half_width / half)
    once = torch.ones_like(look)
    return TexturedProfile(layers.curve, half, look=look, repeats=once, flip=once, sheets=sheets, **parts)


def _raise_windows(layers: Windows, film: Tensor) -> Windows:
    """Replace the colours of drawn windows with the height that follows from their coverage and light."""
    images = []
    for image, color, full in zip(*(part.split(AT_ONCE) for part in (layers.images, layers.color, film)), strict=True):
        light = (image[:, :3] - color[:, :, None, None]).mean(1)
        height = thickness_of(image[:, 3], light) * (full / CARRIED)[:, None, None]
        images.append(torch.stack([height, height, height, image[:, 3]], dim=1))
    return replace(layers, images=torch.cat(images), opacity=CARRIED * layers.opacity)


def thickness_of(coverage: Tensor, light: Tensor) -> Tensor:
    """Compute the thickness of a stroke's paint, in films, from its ``coverage`` (0 to 1) and ``light`` (-1 to 1).

    Height is proportional to -log(1 - DENSE coverage), as in the simulator (`engine.fluid`), where a splat of height w
    leaves the fraction exp(-w) of the canvas bare. Light adds height, because it falls on the ridges.
    """
    bare = torch.log1p(-coverage * DENSE) / torch.log1p(torch.tensor(-DENSE)).to(coverage)
    return (bare * (1 + LIT * light)).clamp(0, 1)


@lru_cache(maxsize=1)  # the textures of a renderer are the same at every call
def _raise_sheets(sheets: Sheets) -> Sheets:
    """Replace the tone of textures with thickness - 1; thickness is stored or follows from opacity and tone."""
    opacity, tone = sheets.texels[:, 0], sheets.texels[:, 1]
    thickness = sheets.texels[:, 2] if sheets.texels.shape[1] > 2 else thickness_of(opacity, tone)
    texels = torch.stack([opacity, ((thickness - 1) * HALF).round() / HALF], dim=1)
    return replace(sheets, texels=texels, cells=None if sheets.cells is None else cells_of(texels, sheets.size))


@lru_cache(maxsize=4)
def _bristle_sheets(taper: float, device: torch.device) -> Sheets:
    """Draw textures for plain strokes: VARIANTS brushes in LEVELS sizes, numbered variant * LEVELS + level."""
    across, t, before, beyond = (part[1:-1] for part in coordinates_of(ROWS, COLUMNS))
    half = (1 - taper * (2 * t - 1) ** 2).clamp_min(0.05)
    fine, coarse = _streaks(1.0), _streaks(3.0)
    ragged = 1 + RAGGED * (1 + coarse).clamp_min(0)  # some bristles touch down later, or lift off earlier
    from_curve = torch.hypot(across[:, None], (before + beyond) * ragged) / half  # 1 at the edge
    ridge = torch.exp(-(((from_curve - RIDGE_AT) / RIDGE_WIDE) ** 2)) * (1 + 0.5 * coarse).clamp_min(0)
    film = BODY * (1 + 0.5 * SPENT - SPENT * t) + FINE * fine + COARSE * coarse + RIDGE * ridge
    shoulder = 0.5 + smooth_rise((EDGE_RANGE[1] - from_curve) / SHOULDER - 0.5)
    opacity = 0.5 + smooth_rise((EDGE_RANGE[1] - from_curve) / (EDGE_RANGE[1] - EDGE_RANGE[0]) - 0.5).expand_as(film)
    textures = torch.stack([opacity, film.clamp(THINNEST, 1) * shoulder - 1], dim=1)
    return sheets_of(textures.to(device), LEVELS, Loop(0, 0), rounded=True)


def _streaks(spread: float) -> Tensor:
    """Draw elongated noise (VARIANTS, ROWS, COLUMNS), ``spread`` rows wide, with mean 0 and standard deviation 1."""
    generator = torch.Generator().manual_seed(round(1000 * spread))
    knots = torch.randn(VARIANTS, ROWS, KNOTS, generator=generator)
    knots = 0.8 * knots[..., :1] + 0.6 * knots  # mostly the same bristles along the whole stroke
    place = torch.arange(ROWS)
    blur = torch.exp(-0.5 * ((place[:, None] - place) / spread) ** 2)
    noise = functional.interpolate(blur @ knots, COLUMNS, mode="linear", align_corners=True)
    return (noise - noise.mean((1, 2), keepdim=True)) / noise.std((1, 2), keepdim=True)
