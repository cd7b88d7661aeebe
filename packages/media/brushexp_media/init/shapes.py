"""Fill shapes in a picture, such as the darkest accents, with the broadest strokes that fit."""

import numpy as np

from brushexp.contracts.pictures import along_edges, structure_tensor
from brushexp_media.picture.lines import TIMES, follow_flow, points_of

Array = np.ndarray
TRIED = 16  # positions tried per requested stroke
OVERLAP, SMALLEST_REACH = 0.92, 0.6  # share of half its width, and pixels, within which a stroke leaves nothing bare
THINNER = 0.75  # thinning of the ends of strokes, as in look=ink
NARROWER, LONG = 0.65, 9.0  # least room along a stroke, and its length, relative to half its width


def remove_specks(mask: Array, least: float) -> Array:
    """Remove parts with fewer than ``least`` pixels from a mask (H, W), and fill holes with fewer pixels."""
    from scipy.ndimage import label  # noqa: PLC0415  (slow to import)

    for inside in (True, False):
        parts, _ = label(mask == inside)
        small = np.bincount(parts.ravel()) < least
        small[0] = False
        mask = np.where(small[parts], not inside, mask)
    return mask


def fill_shape(mask: Array, n: int, broadest: float, random: np.random.Generator) -> tuple[Array, Array]:
    """Fill a mask (H, W) with at most ``n`` strokes, broad ones first; return curves (m, 3, 2) and half widths (m,).

    No stroke is broader than ``broadest`` pixels; each starts where earlier strokes left the mask bare.
    """
    from scipy.ndimage import distance_transform_edt  # noqa: PLC0415  (slow to import)

    rows, columns = np.nonzero(mask)
    if not n or not len(rows):
        return np.zeros((0, 3, 2)), np.zeros(0)
    room = distance_transform_edt(np.pad(mask, 1, mode="edge"))[1:-1, 1:-1]
    flow = along_edges(structure_tensor(room[None], 1.5))
    room = room.clip(0, broadest / 2)
    chosen = random.permutation(len(rows))[: TRIED * n]
    chosen = chosen[np.argsort(-room[rows[chosen], columns[chosen]], kind="stable")]
    places, half = np.stack([columns, rows], 1)[chosen] + 0.5, room[rows[chosen], columns[chosen]]
    curve = follow_flow(places, flow, 0.5 * LONG * half, room, NARROWER * half)
    bare: Array = mask.copy()
    kept: list[int] = []
    for number in range(len(curve)):
        if len(kept) == n:
            break
        column, row = places[number].astype(int)
        if bare[row, column]:
            kept.append(number)
            _cover(bare, curve[number], half[number])
    return curve[kept], half[kept]


def _cover(bare: Array, curve: Array, half: float) -> None:
    """Clear the pixels of a mask (H, W) that a stroke along a curve (3, 2) covers; the stroke's ends are thinner."""
    points = points_of(curve[None])[:, 0]
    reach = np.maximum(OVERLAP * half * (1 - THINNER * (2 * TIMES - 1) ** 2), SMALLEST_REACH)
    (left, top), (right, bottom) = (points.min(0) - half).clip(0).astype(int), (points.max(0) + half + 1).astype(int)
    box = bare[top:bottom, left:right]
    y, x = (np.arange(side) + 0.5 for side in box.shape)
    square = (x[:, None] + left - points[:, 0]) ** 2 + (y[:, None, None] + top - points[:, 1]) ** 2
    box &= (square >= reach**2).all(-1)
