"""Draw strokes individually in separate windows, with any engine or renderer of the program."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from brushexp.contracts import build_named, plugins
from brushexp.contracts.families import Renderer
from brushexp.contracts.strokes import Strokes, clamp_to_prior, curve_of, parameters_of, rewindow, strokes_along
from brushexp_recovery.synthesis.layout import StrokeLayout

Array = NDArray[Any]

SIDES = (32, 48, 64, 96, 128, 192, 256, 384)  # sides in pixels of windows for renderers; engines have one size
SMALLEST_ENGINE_SIDE, LARGEST_ENGINE_SIDE = 48, 104  # range of the side of an engine's windows in pixels
SHEET_STROKES = 256  # number of strokes that a renderer draws at once
CLOSED_GAP = 3  # maximum width in pixels of gaps between bristles that belong to the stroke's region


class Texel(IntEnum):
    """Channels of a window's texels."""

    RED = 0  # multiplied by alpha
    GREEN = 1
    BLUE = 2
    ALPHA = 3
    CLOSED = 4  # alpha with closed gaps
    HEIGHT = 5  # height of the paint; 1 is full


@dataclass(frozen=True)
class BrushLook:
    """The way in which strokes are drawn: a plugin of the ``engine`` or ``renderer`` family, with its options."""

    family: str
    name: str
    options: Mapping[str, Any]
    coats: float = 4.0  # number of coats of paint, which give an alpha of 1 - (1 - alpha)^coats


@dataclass(frozen=True)
class StrokeWindows:
    """N strokes in separate windows, with their positions on a canvas."""

    texels: Array  # (T, len(Texel)) float32, window after window
    first: Array  # (N,) first texel of each window
    side: Array  # (N,) side of each window in texels
    position: Array  # (N, 2) centres of the windows in pixels
    scale: Array  # (N,) sides of the windows in pixels
    curve: Array  # (N, 3, 2) actually drawn curves in pixels
    width: Array  # (N,)


def first_texels(side: Array) -> Array:
    """Return the indices (N,) of the first texels of consecutive windows with sides (N,)."""
    return np.concatenate([[0], np.cumsum(side**2)[:-1]])


def place_windows(layout: StrokeLayout, reach: Array) -> tuple[Array, Array]:
    """Place square windows at whole pixels around strokes.

    The windows extend at least ``reach`` (N,) pixels beyond the control points. Returns their upper left corners (N, 2)
    and sides (N,).
    """
    low, high = layout.curve.min(1) - reach[:, None], layout.curve.max(1) + reach[:, None]
    side = np.ceil((high - low).max(1)).astype(int)
    return np.floor(0.5 * (low + high) - 0.5 * side[:, None]), side


def close_gaps(window: Array, gap: int) -> Array:
    """Copy the alpha of texels (S, S, len(Texel)) to `CLOSED`, and close gaps of up to ``gap`` pixels there.

    Returns the texels as (S * S, len(Texel)).
    """
    from scipy.ndimage import grey_closing  # noqa: PLC0415

    window[..., Texel.CLOSED] = grey_closing(window[..., Texel.ALPHA], size=gap)
    return window.reshape(-1, len(Texel))


def join_windows(texels: Sequence[Array], side: Array, position: Array, layout: StrokeLayout) -> StrokeWindows:
    """Concatenate the texels of windows with sides (N,) and centres ``position`` (N, 2), one texel per pixel."""
    return StrokeWindows(
        texels=np.concatenate(texels).astype(np.float32, copy=False),
        first=first_texels(side),
        side=side,
        position=position,
        scale=side.astype(float),
        curve=layout.curve,
        width=layout.width,
    )


def draw_strokes(layout: StrokeLayout, look: BrushLook, seed: int) -> StrokeWindows:
    """Draw strokes in windows; strokes outside the range that a plugin can draw are clamped to that range."""
    parts = (layout.curve, layout.width, layout.color)
    curve, width, color = (torch.as_tensor(part, dtype=torch.float32) for part in parts)
    window = torch.maximum((curve.amax(1) - curve.amin(1)).amax(1) / 0.7, width / 0.2)
    strokes = rewindow(strokes_along(curve, width, color, 1.0, window=window))
    if look.family == "engine" or getattr(find_plugin(look).cls, "strokes", "all") != "all":
        strokes = clamp_to_prior(strokes)
    pictures = engine_pictures(strokes, look, seed) if look.family == "engine" else renderer_pictures(strokes, look)
    side = np.array([picture.shape[-1] for picture in pictures])
    return StrokeWindows(
        texels=np.concatenate([_texels(picture) for picture in pictures]),
        first=first_texels(side),
        side=side,
        position=strokes.position.numpy(),
        scale=strokes.scale.numpy(),
        curve=curve_of(strokes).numpy(),
        width=(strokes.width * strokes.scale).numpy(),
    )


def find_plugin(look: BrushLook) -> Any:
    """Find the plugin that draws strokes with a given look."""
    return next(plugin for plugin in plugins(look.family) if plugin.name == look.name)


def engine_pictures(strokes: Strokes, look: BrushLook, seed: int) -> list[Tensor]:
    """Draw pictures (4, S, S) of the strokes with an engine, in windows about as large as the median stroke."""
    window = int(np.clip(float(strokes.scale.median()), SMALLEST_ENGINE_SIDE, LARGEST_ENGINE_SIDE)) // 8 * 8
    engine = build_named(look.family, look.name, {"window": window, **look.options})
    return list(engine(parameters_of(strokes), seed=seed).images)


@torch.no_grad()
def renderer_pictures(strokes: Strokes, look: BrushLook) -> list[Tensor]:
    """Draw pictures (4, S, S) of the strokes with a renderer, each in the smallest of the `SIDES` that fits it."""
    renderer = build_named(look.family, look.name, {**look.options}).requires_grad_(False)
    sides = torch.tensor(SIDES)
    group = torch.bucketize(strokes.scale, sides[:-1])
    pictures: list[Tensor] = [torch.empty(0)] * len(strokes)
    for number in group.unique().tolist():
        for rows in (group == number).nonzero()[:, 0].split(SHEET_STROKES):
            for row, picture in zip(rows.tolist(), _draw_sheet(renderer, strokes[rows], SIDES[number]), strict=True):
                pictures[row] = picture
    return pictures


def _draw_sheet(renderer: Renderer, strokes: Strokes, side: int) -> Tensor:
    """Draw strokes in the cells of a sheet, on black and on white to find their alpha; return pictures (n, 4, S, S)."""
    n, across = len(strokes), int(np.ceil(np.sqrt(len(strokes))))
    place = torch.stack([torch.arange(n) % across, torch.arange(n) // across], 1)
    layers = renderer(replace(strokes, position=(place + 0.5) * side, scale=torch.full_like(strokes.scale, side)))
    blend, size = build_named("blend", "tiled", {}), (-(-n // across) * side, across * side)
    black, white = (blend(layers, torch.arange(n), size, torch.full((3,), shade)).image for shade in (0.0, 1.0))
    alpha = 1 - (white - black).mean(0, keepdim=True).clamp(0, 1)
    sheet = torch.cat([black / alpha.clamp_min(1e-4), alpha])
    squares = sheet.reshape(4, -1, side, across, side).permute(1, 3, 0, 2, 4).flatten(0, 1)
    return squares[:n]


def _texels(picture: Tensor) -> Array:
    """Convert an RGBA picture (4, S, S) to texels (S * S, len(Texel))."""
    color, alpha = picture[:3].clamp(0, 1), picture[3:].clamp(0, 1)
    grown = torch.nn.functional.max_pool2d(alpha[None], CLOSED_GAP, 1, CLOSED_GAP // 2)
    closed = -torch.nn.functional.max_pool2d(-grown, CLOSED_GAP, 1, CLOSED_GAP // 2)[0]
    return torch.cat([color * alpha, alpha, closed, alpha]).flatten(1).T.contiguous().numpy()
