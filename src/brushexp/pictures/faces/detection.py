"""Detect faces of various sizes and tilts in a picture."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from brushexp.pictures.face import Face
from brushexp.pictures.faces.network import Candidates, open_network
from brushexp.pictures.load import downsample

LARGEST_SIDE = 1024  # pixels on the longer side of the first search; later searches halve it
HALVED_SIDE = 512  # pixels on the longer side at or above which a picture is also searched at half its size
ENLARGED = 2  # enlargement of smaller pictures, in which small faces get higher scores
TILTS = (0.0, -math.pi / 4, math.pi / 4)  # radians of the turns; the network finds heads tilted up to 30 degrees
LEAST_SCORE = 0.8  # minimum confidence of a face that is detected twice: docs/decisions/027-faces.md
CERTAIN_SCORE = 0.88  # minimum confidence of a face that is detected once
SEEN_AGAIN_SCORE = 0.5  # minimum confidence of the second detection, at another size or tilt
ROUNDING = 1e-6  # pixels by which a canvas may be too small
SMALLEST_SIDE = 8  # pixels on the shorter side of the smallest picture that can contain a face
HEAD_SCORE = 0.38  # minimum confidence of an animal's head that is detected `HEAD_SEEN` times
HEAD_SEEN_SCORE = 0.2  # minimum confidence of these detections
HEAD_SEEN = 3  # minimum number of sizes and tilts at which a head is detected
HEADS_APART = 1.0  # distance of two heads above which they are different, in sides of the larger one
FACES_APART = 0.5  # distance of two faces above which they are different, in sides of the larger one


def find_faces(picture: Tensor, least: float = LEAST_SCORE) -> list[Face]:
    """Detect the faces in a picture (3, H, W), sRGB in [0, 1], in order of decreasing confidence.

    It detects frontal faces and profiles of about 16 pixels or more, even if they are tilted by 45 degrees or more. The
    picture is searched at several sizes, upright and rotated in both directions. A face must be detected at least twice
    unless its score is very high; ``least`` is the minimum score of any face. Of several candidates for a face, the
    best is kept.
    """
    return faces_among(search(picture, min(least, SEEN_AGAIN_SCORE)), least)


def find_faces_and_heads(picture: Tensor) -> tuple[list[Face], list[Face]]:
    """Detect the faces in a picture as `find_faces` does; if there are none, detect the heads of animals.

    The network detects animal heads with low confidence, and its landmarks miss the eyes. However, it detects the same
    head at several sizes and tilts, which rarely happens with false detections.
    """
    looks = search(picture, HEAD_SEEN_SCORE)
    faces = faces_among(looks, LEAST_SCORE)
    return faces, [] if faces else heads_among(looks)


def search(picture: Tensor, least: float) -> list[list[Face]]:
    """Search a picture (3, H, W) at several sizes and tilts; return lists of candidates with scores >= ``least``."""
    if min(picture.shape[1:]) < SMALLEST_SIDE:
        return []
    longer = max(picture.shape[1:])
    smaller = downsample(picture.detach().cpu().float().clamp(0, 1), LARGEST_SIDE)
    if longer < HALVED_SIDE:
        size = [ENLARGED * side for side in smaller.shape[1:]]
        smaller = functional.interpolate(smaller[None], size, mode="bilinear", align_corners=False)[0]
    looks: list[list[Face]] = []
    while True:
        side = max(smaller.shape[1:])
        looks += [distinct(_search(smaller, longer / side, tilt, least)) for tilt in TILTS]
        if side < HALVED_SIDE:
            return looks
        smaller = downsample(smaller, side // 2)


def faces_among(looks: Sequence[Sequence[Face]], least: float) -> list[Face]:
    """Select the faces among the candidates from several searches, highest scores first."""
    found, again = [], min(least, SEEN_AGAIN_SCORE)
    for look in looks:
        others = [face for other in looks if other is not look for face in other if face.score >= again]
        likely = [face for face in look if face.score >= least]
        found += [
            face for face in likely if face.score >= CERTAIN_SCORE or any(is_at_one_place(face, o) for o in others)
        ]
    return distinct(found)


def heads_among(looks: Sequence[Sequence[Face]]) -> list[Face]:
    """Select the animal heads among the candidates from several searches, highest scores first."""
    heads: list[Face] = []
    for head in distinct([face for look in looks for face in look]):
        times = sum(any(is_at_one_place(head, other) for other in look) for look in looks)
        is_apart = all(math.hypot(head.x - a.x, head.y - a.y) > HEADS_APART * max(head.side, a.side) for a in heads)
        if head.score >= HEAD_SCORE and times >= HEAD_SEEN and is_apart:
            heads.append(head)
    return heads


def distinct(faces: list[Face]) -> list[Face]:
    """Keep the face with the highest score at each position by greedy suppression; return the highest scores first."""
    kept: list[Face] = []
    for face in sorted(faces, key=lambda face: -face.score):
        if not any(is_at_one_place(face, other) for other in kept):
            kept.append(face)
    return kept


def is_at_one_place(one: Face, other: Face) -> bool:
    """Check whether two detections are so close together that they must show the same face."""
    return math.hypot(one.x - other.x, one.y - other.y) <= FACES_APART * max(one.side, other.side)


@torch.no_grad()
def _search(picture: Tensor, zoom: float, tilt: float, least: float) -> list[Face]:
    """Rotate a picture (3, h, w) by ``tilt`` radians, and search it for faces.

    The faces are given in pixels of the upright picture, enlarged by ``zoom``.
    """
    candidates: Candidates = open_network()(rotate(picture, tilt))
    height, width = picture.shape[1:]
    found = []
    for number in (candidates.score >= least).nonzero()[:, 0].tolist():
        middle = candidates.middle[number]
        places = rotate_back(torch.cat([middle[None], candidates.landmarks[number]]), tilt, (height, width))
        (x, y), landmarks = (zoom * places[0]).tolist(), (zoom * places[1:]).double().numpy()
        if 0 <= x <= zoom * width and 0 <= y <= zoom * height:
            side = zoom * math.sqrt(float(candidates.size[number].prod()))
            found.append(Face(x, y, side, float(candidates.score[number]), landmarks))
    return found


def rotate(picture: Tensor, tilt: float) -> Tensor:
    """Rotate a picture (3, H, W) clockwise by ``tilt`` radians onto a black canvas large enough for all of it."""
    if not tilt:
        return picture
    height, width = picture.shape[1:]
    down, across = _canvas_of((height, width), tilt)
    y, x = torch.meshgrid(torch.arange(down) + 0.5, torch.arange(across) + 0.5, indexing="ij")
    places = rotate_back(torch.stack([x, y], -1).reshape(-1, 2), tilt, (height, width))
    grid = (2 * places / torch.tensor([width, height]) - 1).reshape(1, down, across, 2)
    return functional.grid_sample(picture[None], grid, align_corners=False)[0]


def rotate_back(places: Tensor, tilt: float, size: tuple[int, int]) -> Tensor:
    """Map points (N, 2: x, y) in the result of `rotate` back to the original picture of ``size`` (H, W)."""
    if not tilt:
        return places
    height, width = size
    down, across = _canvas_of(size, tilt)
    x, y = (places - torch.tensor([across / 2, down / 2])).unbind(1)
    c, s = math.cos(tilt), math.sin(tilt)
    return torch.stack([c * x + s * y + width / 2, c * y - s * x + height / 2], 1)


def _canvas_of(size: tuple[int, int], tilt: float) -> tuple[int, int]:
    """Compute the height and width of the smallest canvas that holds a rotated picture of ``size`` (H, W)."""
    height, width = size
    c, s = abs(math.cos(tilt)), abs(math.sin(tilt))
    return math.ceil(c * height + s * width - ROUNDING), math.ceil(c * width + s * height - ROUNDING)
