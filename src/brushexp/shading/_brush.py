"""How thick the paint of one stroke lies: from its coverage, or, for plain strokes, from bristles drawn at random.

Thicknesses are in films: 1 is the thickest that a brush leaves. They travel in the place of a texture's light,
thickness - 1, because black paint (0) of that light has the colour thickness * colour.
"""

from functools import lru_cache

import torch
from torch import Tensor
from torch.nn import functional

from brushexp.compositing.layers import SPREAD
from brushexp.compositing.textures import cells_of, coordinates_of, extent_of, smoothed, texel_distances

DENSE = 0.97  # coverage of a full film
LIT = 0.8  # films by which paint is higher where it is white by light than where it has its own colour
OPACITIES, LIGHTS = 255, 127  # steps in textures
VARIANTS, LEVELS = 8, 5  # brushes of plain strokes; sizes, each half of the one before
ROWS, COLUMNS = 48, 32  # texels across (to SPREAD half widths on either side) and along
KNOTS = 6  # along a stroke, between which bristles waver
RAGGED = 0.2  # share by which the ends of bristles differ
THINNEST = 0.1  # films, between bristles
BODY, FINE, COARSE = 0.5, 0.15, 0.12  # films: of the middle, and of single bristles and tufts
RIDGE, RIDGE_AT, RIDGE_WIDE = 0.3, 0.76, 0.13  # films of what is pushed aside; where and how wide in half widths
SPENT = 0.25  # share of its paint that a brush has left at the end of a stroke
SHOULDER = 0.3  # half widths over which the edge of the paint is round
EDGE = (0.85, 1.1)  # half widths between which a plain stroke ends

Brush = tuple[Tensor, Tensor, Tensor]  # textures, extent and cells, as in `TexturedProfile`


def thickness_of(coverage: Tensor, light: Tensor) -> Tensor:
    """Films of paint where a stroke covers the canvas to ``coverage`` (0 to 1) and shines by ``light`` (-1 to 1).

    A splat of paint of height w leaves the share exp(-w) of the canvas bare, in the simulator too (`engine.fluid`), so
    that a height is -log(1 - coverage). Light lies on the ridges.
    """
    bare = torch.log1p(-coverage * DENSE) / torch.log1p(torch.tensor(-DENSE)).to(coverage)
    return (bare * (1 + LIT * light)).clamp(0, 1)


def height_textures(textures: Tensor) -> Brush:
    """Textures (M, 2, rows, columns) of opacity and light as textures of opacity and thickness."""
    opacity, light = textures.unbind(1)
    return _packed(opacity, thickness_of(opacity, light))


@lru_cache(maxsize=4)
def plain_brush(taper: float) -> Brush:
    """Textures for strokes that have none: VARIANTS brushes, each in LEVELS sizes, look = variant * LEVELS + level.

    Args:
        taper: how much thinner the ends are, see `Profile`.
    """
    across, t, before, beyond = coordinates_of(ROWS, COLUMNS)
    half = (1 - taper * (2 * t - 1) ** 2).clamp_min(0.05)
    fine, coarse = _streaks(1.0), _streaks(3.0)
    ragged = 1 + RAGGED * (1 + coarse).clamp_min(0)  # some bristles touch down later and lift off earlier
    from_curve = torch.hypot(across[:, None], (before + beyond) * ragged) / half  # 1 at the edge
    ridge = torch.exp(-(((from_curve - RIDGE_AT) / RIDGE_WIDE) ** 2)) * (1 + 0.5 * coarse).clamp_min(0)
    film = BODY * (1 + 0.5 * SPENT - SPENT * t) + FINE * fine + COARSE * coarse + RIDGE * ridge
    shoulder = _smooth((EDGE[1] - from_curve) / SHOULDER)
    opacity = _smooth((EDGE[1] - from_curve) / (EDGE[1] - EDGE[0])).expand_as(film)
    room = (texel_distances(ROWS, COLUMNS) < SPREAD - 2 * SPREAD / ROWS).float()
    thickness = film.clamp(THINNEST, 1) * shoulder
    levels = [smoothed(opacity * room, thickness, room, level) for level in range(LEVELS)]
    return _packed(*torch.stack(levels, dim=1).flatten(0, 1).unbind(1))


def level_of(half_width: Tensor) -> Tensor:
    """Which size (N,) of a plain brush has texels about as large as pixels, for half widths (N,) in pixels."""
    texel = half_width * (2 * SPREAD / ROWS)
    return texel.log2().neg().round().clamp(0, LEVELS - 1).long()


def _packed(opacity: Tensor, thickness: Tensor) -> Brush:
    """Textures for painting from opacity and films, both (M, rows, columns) in [0, 1], in whole steps."""
    steps = torch.stack([(opacity * OPACITIES).round(), ((thickness - 1) * LIGHTS).round()], dim=1)
    textures = steps / torch.tensor([OPACITIES, LIGHTS]).to(steps)[:, None, None]
    return textures, extent_of(textures[:, 0]), cells_of(steps)


def _streaks(spread: float) -> Tensor:
    """Noise (VARIANTS, rows + 2, rows + columns + 2) of mean 0 and deviation 1: ``spread`` rows wide, and long."""
    generator = torch.Generator().manual_seed(round(1000 * spread))
    rows, columns = ROWS + 2, ROWS + COLUMNS + 2
    knots = torch.randn(VARIANTS, rows, KNOTS, generator=generator)
    knots = 0.8 * knots[..., :1] + 0.6 * knots  # mostly the same bristles all the way
    place = torch.arange(rows)
    blur = torch.exp(-0.5 * ((place[:, None] - place) / spread) ** 2)
    noise = functional.interpolate(blur @ knots, columns, mode="linear", align_corners=True)
    return (noise - noise.mean((1, 2), keepdim=True)) / noise.std((1, 2), keepdim=True)


def _smooth(x: Tensor) -> Tensor:
    """Cubic step from 0 (x <= 0) to 1 (x >= 1)."""
    x = x.clamp(0, 1)
    return x * x * (3 - 2 * x)
