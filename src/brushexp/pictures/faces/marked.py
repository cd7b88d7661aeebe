"""Faces that somebody marked in a mask, where the network found none: profiles, animals, painted and hidden faces."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from torch import Tensor

from brushexp.pictures.face import Face
from brushexp.pictures.faces.detection import find_faces

MARKED = 0.5  # grey value from which a pixel of the mask is marked
MARK_AREA = 1.5  # squared sides of a face that its mark covers: a disc with a radius of 0.7 sides
SMALLEST_MARK = 64  # pixels, area of the smallest mark
AROUND = 0.5  # sides of a mark that are searched beyond it
DOUBTFUL_SCORE = 0.6  # confidence from which a candidate in a marked place is a face
ROUND = 0.7  # share of an ellipse of its height and width that a mark must cover to be a face by itself
LONGEST = 1.6  # times as long as wide that such a mark may be


def marked_faces(picture: Tensor, mask: Tensor, found: Sequence[Face] = ()) -> list[Face]:
    """Read faces from the bright places of a mask (H, W) over a picture (3, H, W) in which faces were ``found``.

    A place that holds the middle of a found face marks that face, and adds none. Elsewhere the network is asked again,
    and believed at a low confidence. Where it sees nothing, a mark that is about as round as a face is one without
    landmarks, whose score is 0; other marks are no faces.
    """
    from skimage.measure import label, regionprops  # noqa: PLC0415  (rarely needed)

    faces = []
    for place in regionprops(label(mask.numpy() >= MARKED)):
        holds = place.image
        top, left, bottom, right = place.bbox
        if place.area < SMALLEST_MARK or any(_lies_in(face, holds, (top, left)) for face in found):
            continue
        margin = round(AROUND * max(bottom - top, right - left))
        first, leftmost = max(0, top - margin), max(0, left - margin)
        near = picture[:, first : bottom + margin, leftmost : right + margin]
        inside = [_moved(face, (leftmost, first)) for face in find_faces(near, DOUBTFUL_SCORE)]
        inside = [face for face in inside if _lies_in(face, holds, (top, left))]
        if inside:
            faces.append(max(inside, key=lambda face: face.score))
        elif _is_round(holds):
            side = math.sqrt(place.area / MARK_AREA)
            faces.append(Face((left + right) / 2, (top + bottom) / 2, side, 0.0, np.empty((0, 2))))
    return faces


def _lies_in(face: Face, holds: np.ndarray, corner: tuple[int, int]) -> bool:
    """Tell whether the middle of a face lies in a place ``holds`` (h, w), whose ``corner`` is (top, left)."""
    y, x = math.floor(face.y) - corner[0], math.floor(face.x) - corner[1]
    return 0 <= y < holds.shape[0] and 0 <= x < holds.shape[1] and bool(holds[y, x])


def _moved(face: Face, shift: tuple[int, int]) -> Face:
    """Shift a face by (x, y) in pixels."""
    x, y = shift
    return replace(face, x=face.x + x, y=face.y + y, landmarks=face.landmarks + np.array(shift))


def _is_round(holds: np.ndarray) -> bool:
    """Tell whether a place (h, w) is about as round as a face: an ellipse that is not much longer than wide."""
    height, width = holds.shape
    is_compact = max(height, width) <= LONGEST * min(height, width)
    return is_compact and bool(holds.sum() >= ROUND * math.pi / 4 * height * width)
