"""Read from a mask the faces that the network misses: profiles, animals, painted faces and partly hidden faces."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from torch import Tensor

from brushexp.pictures.face import Face
from brushexp.pictures.faces.detection import find_faces

MARKED = 0.5  # grey value at or above which a pixel of the mask is marked
MARK_AREA = 1.5  # area of a mark in squared sides of its face, for a disc with a radius of 0.7 sides
SMALLEST_MARK = 64  # area in pixels of the smallest mark
AROUND = 0.5  # margin around a mark that is also searched, as a fraction of the mark's longer side
DOUBTFUL_SCORE = 0.6  # minimum confidence of a face at a marked place
ROUND = 0.7  # smallest area of a mark that becomes a face by itself, relative to the ellipse of its height and width
LONGEST = 1.6  # largest aspect ratio of such a mark


def marked_faces(picture: Tensor, mask: Tensor, known: Sequence[Face] = ()) -> list[Face]:
    """Find the faces marked by bright areas of a mask (H, W) for a picture (3, H, W), in addition to ``known`` faces.

    A mark that contains the centre of a known face adds no face. At every other mark, the network searches again with a
    lower score threshold. If it detects no face, a mark that is about as round as a face becomes a face without
    landmarks and with a score of 0, and any other mark is ignored.
    """
    from skimage.measure import label, regionprops  # noqa: PLC0415  (rarely needed)

    faces = []
    for place in regionprops(label(mask.numpy() >= MARKED)):
        mark = place.image
        top, left, bottom, right = place.bbox
        if place.area < SMALLEST_MARK or any(_lies_in(face, mark, (top, left)) for face in known):
            continue
        margin = round(AROUND * max(bottom - top, right - left))
        first, leftmost = max(0, top - margin), max(0, left - margin)
        near = picture[:, first : bottom + margin, leftmost : right + margin]
        inside = [_shift(face, (leftmost, first)) for face in find_faces(near, DOUBTFUL_SCORE)]
        inside = [face for face in inside if _lies_in(face, mark, (top, left))]
        if inside:
            faces.append(max(inside, key=lambda face: face.score))
        elif _is_round(mark):
            side = math.sqrt(place.area / MARK_AREA)
            faces.append(Face((left + right) / 2, (top + bottom) / 2, side, 0.0, np.empty((0, 2))))
    return faces


def _lies_in(face: Face, mark: np.ndarray, corner: tuple[int, int]) -> bool:
    """Check whether the centre of a face is inside a ``mark`` (h, w), whose ``corner`` is (top, left)."""
    y, x = math.floor(face.y) - corner[0], math.floor(face.x) - corner[1]
    return 0 <= y < mark.shape[0] and 0 <= x < mark.shape[1] and bool(mark[y, x])


def _shift(face: Face, shift: tuple[int, int]) -> Face:
    """Shift a face by (x, y) pixels."""
    x, y = shift
    return replace(face, x=face.x + x, y=face.y + y, landmarks=face.landmarks + np.array(shift))


def _is_round(mark: np.ndarray) -> bool:
    """Check whether a mark (h, w) is about as round as a face: nearly an ellipse, and not much longer than wide."""
    height, width = mark.shape
    is_compact = max(height, width) <= LONGEST * min(height, width)
    return is_compact and bool(mark.sum() >= ROUND * math.pi / 4 * height * width)
