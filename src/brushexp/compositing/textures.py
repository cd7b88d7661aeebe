"""Textures along and across a stroke: where their texels lie, how they are made smaller, and how a kernel has them.

The rows of a texture go across the stroke, from ``SPREAD`` half widths on one side to as many on the other. Its columns
are the cap before the start of the curve, its beginning, a piece that a long stroke repeats (`Loop`), its end, and the
cap beyond; they are ``LONG`` times as far apart as the rows. Around all this lies a ring of texels, transparent like
those next to it, so that a lookup outside may be clamped to it, with no slope.
"""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from brushexp.compositing.layers import SPREAD

TEXEL_ASPECT = 2  # texels along a stroke are so many times as long as they are wide: bristles run along it
FAINTEST_OPACITY_STEPS = 5  # least steps of opacity; fainter ones become 0
BYTE, HALF = 255, 127  # steps of opacity, and of tone to either side of 0


@dataclass(frozen=True)
class Loop:
    """The columns of a texture, without its ring, that a long stroke repeats; 0 of them are none."""

    begin: int
    length: int


@dataclass(frozen=True, eq=False)
class Sheets:
    """M textures of several sizes, as lines of texels with their rings, one after the other."""

    texels: Tensor  # (T, C) opacity in [0, 1], tone in [-1, 1], and, where it is known, height in films, in [0, 1]
    first: Tensor  # (M,) int64, where each begins
    size: Tensor  # (M, 2) int64, rows and columns without the ring
    loop: Tensor  # (M, 2) columns at which the repeated piece begins, and how many it has
    extent: Tensor  # (M,) half widths beyond which it is transparent
    cells: Tensor | None = None  # (T,) int64, see `cells_of`; None while textures are being trained

    def __deepcopy__(self, memo: dict[int, object]) -> "Sheets":
        return self  # nothing changes them, and copies of a renderer share them


def coordinates_of(rows: int, columns: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Locate texels of a texture and its ring: across (rows + 2,), and t, before, and beyond the curve (columns + 2,).

    All but t are in half widths; those before the start are negative.
    """
    step, cap = 2 * SPREAD / rows, cap_of(rows)
    across = step * (torch.arange(rows + 2) - 0.5 - rows / 2)
    u, body = torch.arange(columns + 2) - 0.5 - cap, columns - 2 * cap
    length = TEXEL_ASPECT * step  # of a texel, half widths
    return across, (u / body).clamp(0, 1), length * u.clamp_max(0), length * (u - body).clamp_min(0)


def cap_of(rows: int) -> float:
    """Count the columns of a cap."""
    return rows / (2 * TEXEL_ASPECT)


def texel_distances(rows: int, columns: int) -> Tensor:
    """Measure half widths (rows + 2, columns + 2) from the curve to each texel."""
    across, _, before, beyond = coordinates_of(rows, columns)
    return torch.hypot(across[:, None], before + beyond)


def sheets_of(textures: Tensor, levels: int, loop: Loop, *, rounded: bool) -> Sheets:
    """Reduce textures (V, C, rows, columns) to ``levels`` sizes, every one half the one before: M = V * levels.

    A texel of the smaller ones is the mean of four (mip maps: Williams, 1983); what is not opacity counts by it. If
    ``rounded``, they are in whole steps of 8 bits, and there are cells for the kernel.
    """
    variants, _, rows, columns = textures.shape
    sheets = [_add_ring(_halve(textures, level)) for level in range(levels)]
    if rounded:
        sheets = [_round_steps(sheet) for sheet in sheets]
    size = torch.tensor([(rows >> level, columns >> level) for level in range(levels)]).repeat(variants, 1)
    size = size.reshape(-1, 2)  # of no texture, too
    counts, scale = (size + 2).prod(1), 0.5 ** torch.arange(levels)[:, None]
    size = size.to(textures.device)
    texels = torch.cat([sheet.flatten(2).movedim(1, 2) for sheet in sheets], dim=1).flatten(0, 1)
    return Sheets(
        texels=texels,
        first=(counts.cumsum(0) - counts).to(textures.device),
        size=size,
        loop=(torch.tensor([[loop.begin, loop.length]]) * scale).repeat(variants, 1).to(textures.device),
        extent=torch.stack([extent_of(sheet[:, 0].detach()) for sheet in sheets], dim=1).flatten(),
        cells=cells_of(texels, size) if rounded and variants else None,
    )


def _halve(textures: Tensor, times: int) -> Tensor:
    if times == 0:
        return textures
    opacity, rest = textures[:, :1], textures[:, 1:]
    covered, counted = (functional.avg_pool2d(part, 2**times) for part in (opacity, opacity * rest))
    return torch.cat([covered, counted / covered.clamp_min(1e-6)], dim=1)


def _add_ring(textures: Tensor) -> Tensor:
    """Add the ring, transparent as the corners are."""
    opacity, rest = functional.pad(textures, (1, 1, 1, 1), mode="replicate").split([1, textures.shape[1] - 1], dim=1)
    rows, columns = textures.shape[2:]
    may_cover = texel_distances(rows, columns) < SPREAD - 2 * SPREAD / rows
    return torch.cat([opacity * may_cover.to(opacity), rest], dim=1)


def _round_steps(sheet: Tensor) -> Tensor:
    """Round to whole steps, without the faintest opacities: a stroke's reach is what it costs."""
    steps = torch.full((sheet.shape[1], 1, 1), float(BYTE)).to(sheet)
    steps[1] = HALF
    opacity, rest = ((sheet * steps).round() / steps).split([1, sheet.shape[1] - 1], dim=1)
    return torch.cat([opacity * (opacity >= FAINTEST_OPACITY_STEPS / BYTE), rest], dim=1)


def extent_of(opacity: Tensor) -> Tensor:
    """Measure the half widths (M,) from the curve beyond which opacities (M, rows + 2, columns + 2) are 0."""
    distance = texel_distances(opacity.shape[1] - 2, opacity.shape[2] - 2).to(opacity)
    farthest = functional.max_pool2d(distance[None], 3, 1, 1)  # a texel reaches as far as the next one
    return torch.where(opacity > 0, farthest, 0.0).amax((1, 2)) * (1 + 1e-5)


def cells_of(texels: Tensor, size: Tensor) -> Tensor:
    """Pack the corners of the cell below and to the right of each texel as one word, so that a lookup is one load.

    ``texels`` (T, C) and ``size`` (M, 2) are those of `Sheets`, in whole steps of 8 bits. A word is int64: it has in
    the lower half opacity, in the upper one tone + 128, of the corners above left, above right, below left and below
    right, the lowest byte first. A texel of the last row or column of a sheet begins no cell.
    """
    whole = torch.stack([texels[:, 0] * BYTE, texels[:, 1] * HALF + 128], dim=1).round().to(torch.uint8)
    sides = (size.unique(dim=0).flip(0) + 2).tolist()  # of the sheets of one texture, the largest first
    counts = [rows * columns for rows, columns in sides]
    words = []
    for part, (rows, columns) in zip(whole.reshape(-1, sum(counts), 2).split(counts, dim=1), sides, strict=True):
        sheet = functional.pad(part.unflatten(1, (rows, columns)), (0, 0, 0, 1, 0, 1))
        corners = [sheet[:, y : y + rows, x : x + columns] for y in (0, 1) for x in (0, 1)]
        words.append(torch.stack(corners, dim=-1).flatten(3).view(torch.int64).flatten(1))
    return torch.cat(words, dim=1).flatten()
