"""Textures along and across a stroke: their layout, their reduced versions, and their packing for the kernel.

The rows of a texture are stacked across the stroke, from ``SPREAD`` half widths on one side to ``SPREAD`` half widths
on the other. Its columns are the cap before the start of the curve, its beginning, a piece that long strokes repeat
(`Loop`), its end, and the cap beyond the end; the spacing of columns is ``TEXEL_ASPECT`` times that of rows. The
texture is surrounded by a ring of texels, transparent where its neighbours are, so that a lookup outside may be clamped
to the ring with zero slope.
"""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from brushexp.compositing.layers import SPREAD

TEXEL_ASPECT = 2  # texels are this many times as long as wide, because bristles run along the stroke
FAINTEST_OPACITY_STEPS = 5  # smallest number of opacity steps; fainter texels become 0
BYTE, HALF = 255, 127  # steps of opacity, and of tone on either side of 0


@dataclass(frozen=True)
class Loop:
    """The columns of a texture, not counting its ring, that repeat on a long stroke; a length of 0 means no loop."""

    begin: int
    length: int


@dataclass(frozen=True, eq=False)
class Sheets:
    """M textures of several sizes, stored consecutively, row by row, including their rings of texels."""

    texels: Tensor  # (T, C) opacity in [0, 1], tone in [-1, 1], and, where known, height in films, in [0, 1]
    first: Tensor  # (M,) int64, index of the first texel of each
    size: Tensor  # (M, 2) int64, rows and columns without the ring
    loop: Tensor  # (M, 2) first column of the repeated piece, and its number of columns
    extent: Tensor  # (M,) half widths beyond which a texture is transparent
    cells: Tensor | None = None  # (T,) int64, see `cells_of`; None while textures are being trained

    def __deepcopy__(self, memo: dict[int, object]) -> "Sheets":
        return self  # sheets never change, so copies of a renderer share them


def coordinates_of(rows: int, columns: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Compute the coordinates of a texture's texels, including its ring.

    Returns the coordinates across the curve (rows + 2,), and t and the coordinates before and beyond the curve, each
    (columns + 2,). All but t are in half widths; coordinates before the start are negative.
    """
    step, cap = 2 * SPREAD / rows, cap_of(rows)
    across = step * (torch.arange(rows + 2) - 0.5 - rows / 2)
    u, body = torch.arange(columns + 2) - 0.5 - cap, columns - 2 * cap
    length = TEXEL_ASPECT * step  # length of a texel, half widths
    return across, (u / body).clamp(0, 1), length * u.clamp_max(0), length * (u - body).clamp_min(0)


def cap_of(rows: int) -> float:
    """Compute the number of columns in a cap of a texture."""
    return rows / (2 * TEXEL_ASPECT)


def texel_distances(rows: int, columns: int) -> Tensor:
    """Compute the distance (rows + 2, columns + 2) of each texel from the curve, in half widths."""
    across, _, before, beyond = coordinates_of(rows, columns)
    return torch.hypot(across[:, None], before + beyond)


def sheets_of(textures: Tensor, levels: int, loop: Loop, *, rounded: bool) -> Sheets:
    """Reduce V textures (V, C, rows, columns) to ``levels`` sizes, each half the previous one: M = V * levels.

    A texel of a smaller texture is the mean of four (mipmaps: Williams, 1983), weighted by opacity for all channels but
    opacity itself. If ``rounded``, values are quantised to 8 bits, and cells for the kernel are included.
    """
    variants, _, rows, columns = textures.shape
    sheets = [_add_ring(_halve(textures, level)) for level in range(levels)]
    if rounded:
        sheets = [_round_steps(sheet) for sheet in sheets]
    size = torch.tensor([(rows >> level, columns >> level) for level in range(levels)]).repeat(variants, 1)
    size = size.reshape(-1, 2)  # also without textures
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
    """Add the ring of texels, and make texels that reach the border of the texture transparent."""
    opacity, rest = functional.pad(textures, (1, 1, 1, 1), mode="replicate").split([1, textures.shape[1] - 1], dim=1)
    rows, columns = textures.shape[2:]
    may_cover = texel_distances(rows, columns) < SPREAD - 2 * SPREAD / rows
    return torch.cat([opacity * may_cover.to(opacity), rest], dim=1)


def _round_steps(sheet: Tensor) -> Tensor:
    """Quantise a sheet and set the faintest opacities to 0, because the cost of a stroke grows with its reach."""
    steps = torch.full((sheet.shape[1], 1, 1), float(BYTE)).to(sheet)
    steps[1] = HALF
    opacity, rest = ((sheet * steps).round() / steps).split([1, sheet.shape[1] - 1], dim=1)
    return torch.cat([opacity * (opacity >= FAINTEST_OPACITY_STEPS / BYTE), rest], dim=1)


def extent_of(opacity: Tensor) -> Tensor:
    """Compute the distance (M,) from the curve, in half widths, beyond which each texture's opacity is 0."""
    distance = texel_distances(opacity.shape[1] - 2, opacity.shape[2] - 2).to(opacity)
    farthest = functional.max_pool2d(distance[None], 3, 1, 1)  # interpolation extends a texel to its neighbours
    return torch.where(opacity > 0, farthest, 0.0).amax((1, 2)) * (1 + 1e-5)


def cells_of(texels: Tensor, size: Tensor) -> Tensor:
    """Pack the four corners of the cell to the lower right of each texel into a word, so that a lookup takes one load.

    ``texels`` (T, C) and ``size`` (M, 2) are as in `Sheets`, with values quantised to 8 bits. A word is an int64:
    its lower half holds the opacity of the upper left, upper right, lower left and lower right corners, lowest byte
    first, and its upper half holds their tone + 128. The words of texels in the last row or column of a sheet are not
    used.
    """
    whole = torch.stack([texels[:, 0] * BYTE, texels[:, 1] * HALF + 128], dim=1).round().to(torch.uint8)
    sides = (size.unique(dim=0).flip(0) + 2).tolist()  # sizes of the sheets of one texture, the largest first
    counts = [rows * columns for rows, columns in sides]
    words = []
    for part, (rows, columns) in zip(whole.reshape(-1, sum(counts), 2).split(counts, dim=1), sides, strict=True):
        sheet = functional.pad(part.unflatten(1, (rows, columns)), (0, 0, 0, 1, 0, 1))
        corners = [sheet[:, y : y + rows, x : x + columns] for y in (0, 1) for x in (0, 1)]
        words.append(torch.stack(corners, dim=-1).flatten(3).view(torch.int64).flatten(1))
    return torch.cat(words, dim=1).flatten()
