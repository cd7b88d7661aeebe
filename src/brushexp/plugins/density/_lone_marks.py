"""Find isolated marks, which differ from their surroundings and do not belong to a line or group of marks."""

import numpy as np
import torch
from torch import Tensor

from brushexp.pictures.structure import sample_at
from brushexp.strokes.bezier import half_width_of, point_at, shape_of
from brushexp.strokes.catalogue import Strokes

Array = np.ndarray
INSIDE, BESIDE = 7, 5  # number of sample points along a stroke, and along each of its sides
BEYOND = (1.3, 1.5)  # distance of sample points around a stroke from its curve: half widths, plus pixels
OUT = 0.05  # smallest contrast of a stroke that stands out, 0 to 1
ALIKE = 0.5  # fraction of the contrast within which a point has the colour of the stroke
TOUCHING = 0.4  # largest share of surrounding points in the stroke's colour if it stands out
BROADEST = 2.5  # typical widths; broader strokes are not spots or ticks
SEEN = 0.4  # smallest visible share of a stroke
REACH = 2.5  # largest distance between marks of a group, in typical widths
ONE_COLOR = 0.15  # largest difference of a channel between marks of a group, 0 to 1
CROWD = 5  # smallest number of marks in a line, foliage or hatching


def find_lone_marks(strokes: Strokes, image: Tensor, target: Tensor, least: float) -> Tensor:
    """Mark the strokes (N,) that are isolated in a picture (3, H, W) and not justified by the ``target`` (3, H, W).

    A stroke's contrast is the median difference between its colour and the pixels around it. A stroke is conspicuous if
    it is visible, neither broad nor at the edge of the picture, and if less than 40 % of the pixels around it are
    similar to it, with a difference below half of the contrast. It is isolated if it belongs to a group of fewer than
    five conspicuous strokes, such as a spot or a tick. The target justifies a stroke if it also differs from its
    surroundings at that position, by at least ``least`` (0 to 1) in the same direction in colour space.
    """
    painting, aim = (picture.detach().cpu().double().numpy() for picture in (image, target))
    curve = (strokes.position[:, None] + shape_of(strokes)).detach().cpu().double()
    half = half_width_of(strokes).detach().cpu().double()
    color = strokes.color.detach().cpu().double().numpy()
    inside, ring = _points(curve, INSIDE), _ring(curve, half)
    seen, around = _sample(painting, inside), _sample(painting, ring)
    apart = np.abs(around - color).max(2)
    contrast = np.median(apart, axis=0)
    is_seen = (np.abs(seen - color).max(2) < ALIKE * contrast).mean(0) > SEEN
    is_small = (half <= BROADEST * half.median()).numpy()  # broad strokes cover the ground
    height, width = painting.shape[1:]
    is_within = ((ring >= 0) & (ring < (width, height))).all((0, 2))  # nothing is known beyond the edges
    stands_out = is_small & is_within & is_seen & (contrast > OUT) & ((apart < ALIKE * contrast).mean(0) < TOUCHING)
    direction = color - np.median(around, axis=0)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True).clip(1e-9)
    cause = _sample(aim, inside).mean(0) - np.median(_sample(aim, ring), axis=0)
    lone = np.zeros(len(color), bool)
    number = np.flatnonzero(stands_out)
    if len(number):
        reach = REACH * 2 * float(half.median())
        lone[number] = _size_of_groups(inside[:, number], color[number], reach) < CROWD
    return torch.from_numpy(lone & ((cause * direction).sum(1) < least)).to(strokes.position.device)


def _points(curve: Tensor, count: int) -> Array:
    """Compute ``count`` points (count, N, 2) along curves (N, 3, 2)."""
    points: Array = np.stack([point_at(curve, t).numpy() for t in torch.linspace(0, 1, count, dtype=curve.dtype)])
    return points


def _ring(curve: Tensor, half: Tensor) -> Array:
    """Compute points (P, N, 2) just outside the strokes, along their sides and beyond their ends."""
    middle = _points(curve, BESIDE)
    tangent = np.gradient(middle, axis=0)
    tangent /= np.linalg.norm(tangent, axis=2, keepdims=True).clip(1e-9)
    away = (BEYOND[0] * half + BEYOND[1]).numpy()[:, None]
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], -1)
    ends = [middle[:1] - away * tangent[:1], middle[-1:] + away * tangent[-1:]]
    return np.concatenate([middle + away * normal, middle - away * normal, *ends])


def _sample(picture: Array, places: Array) -> Array:
    """Look up the colours (P, N, 3) of a picture (3, H, W) at points (P, N, 2)."""
    x, y = places.reshape(-1, 2).T
    return sample_at(picture, x, y).T.reshape(*places.shape[:2], 3)


def _size_of_groups(points: Array, color: Array, reach: float) -> Array:
    """Compute the size (n,) of the group to which each of n marks belongs.

    Two marks belong to the same group if some of their points (P, n, 2) are within ``reach`` pixels of each other and
    their colours (n, 3) are similar.
    """
    from scipy.sparse import coo_array  # noqa: PLC0415  (slow to import)
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415
    from scipy.spatial import KDTree  # noqa: PLC0415

    n = points.shape[1]
    pairs = KDTree(points.reshape(-1, 2)).query_pairs(reach, output_type="ndarray") % n
    pairs = pairs[np.abs(color[pairs[:, 0]] - color[pairs[:, 1]]).max(1) < ONE_COLOR]
    links = coo_array((np.ones(len(pairs), bool), tuple(pairs.T)), shape=(n, n))
    _, group = connected_components(links, directed=False)
    sizes: Array = np.bincount(group)[group]
    return sizes
