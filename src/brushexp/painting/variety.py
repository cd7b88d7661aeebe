"""Break the colours of finished strokes: the paint of each is mixed anew, as a painter's is."""

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from brushexp.painting.picture import Picture
from brushexp.pictures.color import to_lab, to_rgb
from brushexp.strokes.bezier import half_width_of
from brushexp.strokes.catalogue import Catalogue, Strokes

LIGHTNESS, CHROMA = 4.0, 13.0  # CIELAB: deviation of lightness, and of colour, at a variety of 1
BY_LIGHT = 1.7  # how far colours go by their light, in deviations by chance
CELLS = 33  # of the longer side, over which colours go the same way, and light is compared
SHARED = 0.4  # share of the variance that the strokes of a place have in common
RELIEF = 15.0  # L* above what is around it from which paint is as warm, or below from which as cool, as it becomes
WARM, RED = np.array([0.42, 0.91]), np.array([0.91, -0.42])  # directions of a*, b* in which greys go
TURN, FADE = 0.4, 0.25  # of its chroma: how far a colour goes round the hues, and becomes purer or greyer
CHROMATIC = 25.0  # chroma from which on a colour has none of a grey
BROAD = 0.6  # quantile of widths from which on strokes vary fully; details vary least, by LEAST
LEAST = 0.25
DARK, PALE = 50.0, 85.0  # L*: darker colours than the first vary less, and so do lighter ones than the second


def break_colors(
    catalogue: Catalogue, strokes: Strokes, picture: Picture, variety: float, generator: torch.Generator
) -> None:
    """Break the colours of the ``strokes`` of a catalogue, of which the picture is then to be drawn anew."""
    colors = broken_colors(strokes, picture, variety, generator)
    if colors is not strokes.color:
        catalogue.replace(replace(strokes, color=colors))
        picture.forget()


@torch.no_grad()
def broken_colors(strokes: Strokes, picture: Picture, variety: float, generator: torch.Generator) -> Tensor:
    """Compute colours (N, 3) of strokes that differ from their neighbours by ``variety``, 0 to 1, in CIELAB.

    What is lighter than its surroundings becomes warmer, what is darker cooler, and beside that colours go to either
    side at random, partly alike at one place: greys to warm and cool, hues to their neighbours. Small strokes, what is
    nearly black or white, and what the picture's focus weighs more, differ less.

    Source: "broken colour" as impressionists had it, after Chevreul (1839); Hertzmann (1998) varies hue, saturation and
    value of each stroke. Differs: by the light, by place, and at the end, since steps would take it back.
    """
    if not variety or not len(strokes):
        return strokes.color
    lab = to_lab(strokes.color.double().cpu().numpy())
    around, shared, focus = _of_places(strokes, picture, generator)
    own = math.sqrt(3) * (2 * torch.rand(3, len(strokes), generator=generator).double().numpy() - 1)
    aside = math.sqrt(1 - SHARED) * own[:2] + math.sqrt(SHARED) * shared
    width = half_width_of(strokes).double().cpu().numpy()
    much = variety * (width / np.quantile(width, BROAD).clip(1e-9)).clip(LEAST, 1) / focus
    much *= (lab[:, 0] / DARK).clip(0.3, 1) * (1 - 0.05 * (lab[:, 0] - PALE).clip(0, 10))
    light = ((lab[:, 0] - around) / RELIEF).clip(-1, 1)
    warmer, redder = CHROMA * much * (aside[0] + BY_LIGHT * light), 0.5 * CHROMA * much * aside[1]
    chroma = np.hypot(lab[:, 1], lab[:, 2])
    grey = 1 - (chroma / CHROMATIC).clip(0, 1)
    out = lab[:, 1:] / chroma[:, None].clip(1e-9)
    along = np.stack([-out[:, 1], out[:, 0]], 1)
    along *= np.where(along @ WARM < 0, -1, 1)[:, None]
    free = CHROMA * variety * grey
    lab[:, 1:] += warmer.clip(-TURN * chroma - free, TURN * chroma + free)[:, None] * _between(along, WARM, grey)
    lab[:, 1:] += redder.clip(-FADE * chroma - free / 2, FADE * chroma + free / 2)[:, None] * _between(out, RED, grey)
    lab[:, 0] += LIGHTNESS * much * own[2]
    return torch.from_numpy(to_rgb(lab)).to(strokes.color)


def _of_places(strokes: Strokes, picture: Picture, generator: torch.Generator) -> tuple[np.ndarray, ...]:
    """Look up at the places of strokes: lightness around (N,), shared chance (2, N), and focus (N,), 1 or more."""
    height, width = picture.size
    rows, columns = (math.ceil(CELLS * side / max(height, width)) for side in picture.size)
    focus = torch.ones(1, height, width) if picture.focus is None else picture.focus.detach().cpu()[None]
    cells = functional.adaptive_avg_pool2d(
        torch.cat([picture.target.detach().cpu().float(), focus.float()]), (rows, columns)
    )
    cells = torch.cat([cells, torch.randn(2, rows, columns, generator=generator)])
    at = 2 * strokes.position.detach().cpu().float() / torch.tensor([width, height]) - 1
    sampled = functional.grid_sample(cells[None], at[None, None], padding_mode="border", align_corners=False)
    values: np.ndarray = sampled[0, :, 0].double().numpy()
    return to_lab(values[:3].T)[:, 0], values[4:].clip(-1.8, 1.8), values[3].clip(1)


def _between(one: np.ndarray, other: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return unit vectors (N, 2) from ``one`` (N, 2) to ``other`` (2,), by a ``share`` (N,) of the way."""
    mean = one + share[:, None] * (other - one)
    return mean / np.hypot(mean[:, 0], mean[:, 1])[:, None].clip(1e-9)
