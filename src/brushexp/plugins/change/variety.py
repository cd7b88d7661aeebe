"""Vary the colours of finished strokes, as if a painter mixed new paint for each stroke."""

import logging
import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import torch
from omegaconf import DictConfig
from torch import Tensor
from torch.nn import functional

from brushexp.bounds import between
from brushexp.pictures.color import to_lab, to_rgb
from brushexp.plugins.change.base import Change, PaintingState
from brushexp.registry import register
from brushexp.strokes.bezier import half_width_of
from brushexp.strokes.catalogue import Strokes

log = logging.getLogger(__name__)
LIGHTNESS_DEVIATION = 4.0  # standard deviation of L* at an amount of 1
COLOR_DEVIATION = 13.0  # standard deviation of a* and b* at an amount of 1
BY_LIGHT = 1.7  # largest shift due to light, in standard deviations of the random shift
CELLS = 33  # number of cells along the longer side that share a random shift and an average lightness
SHARED = 0.4  # share of the variance that nearby strokes have in common
MOST_SHARED = 1.8  # largest common shift, in standard deviations
RELIEF = 15.0  # contrast to the surroundings, in L*, at which the shift due to light is largest
WARM = np.array([0.42, 0.91])  # direction in a*, b* that makes greys warmer
RED = np.array([0.91, -0.42])  # direction in a*, b* that makes greys redder
MOST_TURN = 0.4  # largest shift in hue, relative to chroma
MOST_FADE = 0.25  # largest change in chroma, relative to chroma
CHROMATIC = 25.0  # chroma at or above which a colour is not treated as grey
BROAD = 0.6  # quantile of the widths at or above which strokes vary fully
SMALLEST_SHARE = 0.25  # factor on the deviation of the smallest strokes
DARK, DARKEST_SHARE = 50.0, 0.3  # L* below which colours vary less, and the smallest factor
PALE, PALE_SLOPE = 85.0, 0.05  # L* above which colours vary less, and the decrease per L*, for up to ten L*


@register("change", "variety")
@dataclass(kw_only=True)
class Variety(Change):
    """Varies the colour of each finished stroke ("broken colour"): warmer in the light and cooler in the shade.

    Goals such as psnr= refer to the picture before this change, which lowers the PSNR somewhat.

    Args:
        amount: variation from the best-fitting colour towards warm and cool, 0 to 1.
    """

    rank = -10  # the change precedes all other changes of finished strokes
    only_ends = True

    amount: Annotated[float, between(0, 1)] = 0.0

    def check(self, cfg: DictConfig, size: tuple[int, int]) -> None:
        if cfg.psnr is not None and self.amount:
            taken = f"variety={self.amount:g} lowers it afterwards; variety=0 keeps it"
            log.warning("psnr=%g is the goal of the steps, and %s", cfg.psnr, taken)

    def end(self, strokes: Strokes, front_to_back: Tensor, state: PaintingState) -> tuple[Strokes, Tensor]:
        if state.is_untouched:  # a catalogue's colours have already been varied
            return strokes, front_to_back
        return break_colors(strokes, state, self.amount), front_to_back


@torch.no_grad()
def break_colors(strokes: Strokes, state: PaintingState, amount: float) -> Strokes:
    """Vary the colours of N strokes in CIELAB by an ``amount``, 0 to 1, so that neighbouring strokes differ.

    Strokes that are lighter than their surroundings become warmer, and darker strokes become cooler. In addition,
    colours vary at random, partly in step with the colours of nearby strokes: greys become warmer or cooler, and hues
    shift to neighbouring hues. Small strokes, near-black and near-white strokes, and strokes in the focus vary less.

    Source: the impressionists' "broken colour", after Chevreul (1839); Hertzmann (1998) varies hue, saturation and
    value of each stroke. Unlike in both sources, the variation depends on lightness and position, and is added at the
    end, because steps would undo it.
    """
    if not amount or not len(strokes):
        return strokes
    lab = to_lab(strokes.color.double().cpu().numpy())
    places = _sample_places(strokes, state)
    own = math.sqrt(3) * (2 * torch.rand(3, len(strokes), generator=state.generator).double().numpy() - 1)
    aside = math.sqrt(1 - SHARED) * own[:2] + math.sqrt(SHARED) * places.chance
    deviation = amount * _share_by_width(strokes) / places.focus
    deviation *= _share_by_lightness(lab[:, 0])
    light = ((lab[:, 0] - places.lightness) / RELIEF).clip(-1, 1)
    warmer = COLOR_DEVIATION * deviation * (aside[0] + BY_LIGHT * light)
    redder = 0.5 * COLOR_DEVIATION * deviation * aside[1]

    chroma = np.hypot(lab[:, 1], lab[:, 2])
    grey = 1 - (chroma / CHROMATIC).clip(0, 1)  # greys may shift in any direction, hues only to neighbouring hues
    free = COLOR_DEVIATION * amount * grey
    purer = lab[:, 1:] / chroma[:, None].clip(1e-9)
    warmer_hue = np.stack([-purer[:, 1], purer[:, 0]], 1)
    warmer_hue *= np.where(warmer_hue @ WARM < 0, -1, 1)[:, None]
    most_turn, most_fade = MOST_TURN * chroma + free, MOST_FADE * chroma + free / 2
    turn, fade = warmer.clip(-most_turn, most_turn), redder.clip(-most_fade, most_fade)
    lab[:, 1:] += turn[:, None] * _unit_between(warmer_hue, WARM, grey)
    lab[:, 1:] += fade[:, None] * _unit_between(purer, RED, grey)
    lab[:, 0] += LIGHTNESS_DEVIATION * deviation * own[2]
    return replace(strokes, color=torch.from_numpy(to_rgb(lab)).to(strokes.color))


@dataclass(frozen=True)
class Places:
    """Properties of the picture at the positions of N strokes."""

    lightness: np.ndarray  # (N,) mean L* of the surroundings
    focus: np.ndarray  # (N,) weight of the focus, 1 or more
    chance: np.ndarray  # (2, N) random shifts that nearby strokes share, of standard deviation 1


def _sample_places(strokes: Strokes, state: PaintingState) -> Places:
    height, width = state.size
    rows, columns = (math.ceil(CELLS * side / max(height, width)) for side in state.size)
    focus = torch.ones(1, height, width) if state.focus is None else state.focus.detach().cpu()[None]
    cells = functional.adaptive_avg_pool2d(
        torch.cat([state.target.detach().cpu().float(), focus.float()]), (rows, columns)
    )
    cells = torch.cat([cells, torch.randn(2, rows, columns, generator=state.generator)])
    at = 2 * strokes.position.detach().cpu().float() / torch.tensor([width, height]) - 1
    sampled = functional.grid_sample(cells[None], at[None, None], padding_mode="border", align_corners=False)
    values: np.ndarray = sampled[0, :, 0].double().numpy()
    return Places(to_lab(values[:3].T)[:, 0], values[3].clip(1), values[4:].clip(-MOST_SHARED, MOST_SHARED))


def _share_by_width(strokes: Strokes) -> np.ndarray:
    """Compute the strength (N,) of the variation from the stroke widths: 1 for broad strokes, less for details."""
    width = half_width_of(strokes).double().cpu().numpy()
    return np.asarray((width / np.quantile(width, BROAD).clip(1e-9)).clip(SMALLEST_SHARE, 1))


def _share_by_lightness(lightness: np.ndarray) -> np.ndarray:
    """Compute the strength (N,) of the variation from L* (N,); it is lowest for near-black and near-white colours."""
    return np.asarray((lightness / DARK).clip(DARKEST_SHARE, 1) * (1 - PALE_SLOPE * (lightness - PALE).clip(0, 10)))


def _unit_between(first: np.ndarray, second: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Interpolate unit vectors (N, 2) between ``first`` (N, 2) and ``second`` (2,) with weights ``share`` (N,)."""
    mean = first + share[:, None] * (second - first)
    return mean / np.hypot(mean[:, 0], mean[:, 1])[:, None].clip(1e-9)
