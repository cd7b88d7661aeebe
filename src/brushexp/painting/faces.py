"""Create strokes for faces: small ones for eyes and mouths, and some of those that abstraction removed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from brushexp.pictures.abstraction import FEWER
from brushexp.pictures.face import Face
from brushexp.pictures.faces.spots import Spot
from brushexp.plugins.init.base import Initializer
from brushexp.plugins.init.layers import InLayers
from brushexp.strokes.bezier import half_width_of
from brushexp.strokes.catalogue import Strokes

EYE_RADIUS = 0.17  # sides of a face
MOUTH_RADIUS = 0.22  # sides of a face
UNKNOWN_RADIUS = 0.6  # sides of a face, radius of the drawn part if eyes and mouth are unknown
FLOOR = 120  # minimum number of small strokes for an eye or a mouth
FLOOR_OF_FACE = 6 * FLOOR  # minimum number of small strokes for a face whose eyes and mouth are unknown
FLOOR_OF_SPOT = 30  # minimum number of small strokes for a spot, which may be the eye of an animal or anything dark
RADII_PER_WIDTH = 6.0  # radius of a feature over the width of its broadest stroke
SPOT_RADII_PER_WIDTH = 4.5  # the same for a spot
BROAD = 2.0  # width of a stroke that hides an eye or a mouth, over the largest width of a small stroke
THINNEST_STROKE = 1.5  # width in pixels of the smallest strokes for a feature
TYPED_SHARE = 0.5  # largest share of a typed number of strokes for features
MOST_ON_A_FACE = 400  # largest number of strokes that a face keeps while abstraction removes strokes elsewhere
FACE_REACH = 0.85  # sides of a face, largest distance of these strokes from its middle
IN_LAYERS = InLayers(layers=2, ratio=0.5, cover=0.5, length=2.2, width=0.9, edges=0.08, shadows=1.0, opacity=1.0)


@dataclass(frozen=True)
class Feature:
    """A circular area, in pixels, that needs at least ``floor`` small strokes: an eye, a mouth or a whole face.

    A small stroke is narrower than ``radius`` divided by ``fineness``. A feature is certain if it belongs to a face.
    """

    x: float
    y: float
    radius: float
    most: int = FLOOR
    fineness: float = RADII_PER_WIDTH
    is_certain: bool = True

    @property
    def floor(self) -> int:
        """Minimum number of small strokes: ``most``, or fewer if the area is only a few pixels wide."""
        return min(self.most, round(math.pi * (self.radius / THINNEST_STROKE) ** 2))

    def holds(self, position: Tensor) -> Tensor:
        """Return whether each position (N, 2) is within the feature, as (N,) bool."""
        return (position - position.new_tensor([self.x, self.y])).norm(dim=1) < self.radius


def features_of(faces: Sequence[Face], spots: Sequence[Spot] = ()) -> list[Feature]:
    """List the eyes and mouth of each face (or the whole face if it has no landmarks), followed by the spots."""
    features = []
    for face in faces:
        if not len(face.landmarks):
            fineness = RADII_PER_WIDTH * math.sqrt(FLOOR_OF_FACE / FLOOR)
            features.append(Feature(face.x, face.y, UNKNOWN_RADIUS * face.side, FLOOR_OF_FACE, fineness))
            continue
        features += [Feature(x, y, EYE_RADIUS * face.side) for x, y in face.eyes.tolist()]
        x, y = face.mouth.tolist()
        features.append(Feature(x, y, MOUTH_RADIUS * face.side))
    uncertain = [
        Feature(spot.x, spot.y, spot.radius, FLOOR_OF_SPOT, SPOT_RADII_PER_WIDTH, is_certain=False) for spot in spots
    ]
    return features + uncertain


def places_of(features: Sequence[Feature], size: tuple[int, int]) -> Tensor | None:
    """Mark the areas of features on a canvas of ``size`` (H, W), as (H, W) bool; return None if there are none."""
    if not features:
        return None
    down, across = (torch.arange(side) + 0.5 for side in size)
    near = [torch.hypot(down[:, None] - one.y, across - one.x) < one.radius for one in features]
    return torch.stack(near).any(0)


def draw_features(
    target: Tensor,
    features: Sequence[Feature],
    strokes: Strokes,
    generator: torch.Generator,
    limit: float = math.inf,
) -> Strokes:
    """Create small strokes for features of a target (3, H, W) that have fewer small strokes than their floor.

    At most ``limit`` strokes, to be placed on top of all others, are divided among the features in proportion to their
    floors.
    """
    width = 2 * half_width_of(strokes)
    missing = [feature for feature in features if count_small(feature, strokes.position, width) < feature.floor]
    share = min(1.0, limit / max(1, sum(feature.floor for feature in missing)))
    drawn = [draw_feature(target, one, math.floor(share * one.floor), generator) for one in missing]
    return Strokes.join(*drawn) if drawn else strokes[:0]


def count_small(feature: Feature, position: Tensor, width: Tensor) -> int:
    """Count the small strokes in a feature that are not hidden: those above its topmost broad stroke.

    ``position`` (N, 2) and ``width`` (N,) of N strokes are in pixels, bottom stroke first. A broad stroke is wider than
    `BROAD` times the largest width of a small stroke.
    """
    small = max(feature.radius / feature.fineness, THINNEST_STROKE)
    inside = width[feature.holds(position)]
    broad = (inside > BROAD * small).nonzero()
    on_top = inside[int(broad.max()) + 1 :] if len(broad) else inside
    return int((on_top < small).sum())


def draw_feature(target: Tensor, feature: Feature, n: int, generator: torch.Generator) -> Strokes:
    """Create at most ``n`` small strokes within a feature of a target (3, H, W)."""
    height, width = target.shape[1:]
    left, right = (round(min(max(feature.x + way * feature.radius, 0), width)) for way in (-1, 1))
    top, bottom = (round(min(max(feature.y + way * feature.radius, 0), height)) for way in (-1, 1))
    near = target[:, top:bottom, left:right].contiguous()
    n = min(n, near[0].numel())
    if not n:
        return Strokes.none()
    strokes = IN_LAYERS(near, n, generator).moved(shift=(left, top))
    return strokes[feature.holds(strokes.position)]


def face_strokes(
    initializer: Initializer, target: Tensor, face: Face, n: int, abstraction: float, generator: torch.Generator
) -> Strokes:
    """Recreate up to `MOST_ON_A_FACE` of the strokes that ``abstraction`` has removed from a face.

    The whole picture has ``n`` strokes after abstraction.
    """
    reach = FACE_REACH * face.side
    top, left = max(0, round(face.y - reach)), max(0, round(face.x - reach))
    near = target[:, top : round(face.y + reach), left : round(face.x + reach)].contiguous()
    count = min(MOST_ON_A_FACE, round(n * (FEWER**abstraction - 1) * near.numel() / target.numel()))
    if not count:
        return Strokes.none()
    strokes = initializer.nearer()(near, count, generator).moved(shift=(left, top))
    return strokes[(strokes.position - torch.tensor([face.x, face.y])).norm(dim=1) < reach]
