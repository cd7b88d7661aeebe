"""Make any number of paintings with known strokes, each determined by a seed, its number and its paint family.

In paintings without a family, strokes are drawn by the program's engines and renderers, or by a formula.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.pictures import load_picture
from brushexp_recovery.synthesis.ageing import crack, shine, smudge
from brushexp_recovery.synthesis.canvas import StrokeGeometry, compose, geometry_of
from brushexp_recovery.synthesis.choices import (
    choose_ground,
    choose_hand,
    choose_look,
    choose_mixing,
    choose_plain_look,
)
from brushexp_recovery.synthesis.families.family import find_families, paint_family
from brushexp_recovery.synthesis.hand import Hand, Random
from brushexp_recovery.synthesis.layout import lay_strokes
from brushexp_recovery.synthesis.marks import choose_marks, draw_marks
from brushexp_recovery.synthesis.windows import draw_strokes

Array = NDArray[Any]

PAINTING_SIDE = 512  # side of a painting in pixels
STROKES = (120, 2600)  # range of the number of strokes
FAMILY_SHARE = 0.5  # share of paintings of a family of paint, if there are families
FAMILY_STREAM = 61  # stream of random numbers that choose the family
FAMILY_STROKES = (25, 1500)  # range of the number of strokes for families, some of which are 100 pixels wide
PLAIN_SHARE = 0.55  # share of the other paintings by a plain hand
BARE_SHARE = 0.05  # share of paintings without strokes
MARKS_SHARE = 0.5  # share of looks that are marks by a formula if the hand is not plain
FIRST_PLAIN = 900_046  # paintings from this number on are plain
CRACKED_SHARE = 0.12  # share of the paintings that are not plain
MOST_FLUID = 400  # number of strokes above which the bristle simulator takes too long
PICTURES = (  # shipped with scikit-image and Matplotlib
    "astronaut",
    "brick",
    "chelsea",
    "coffee",
    "grace_hopper",
    "gravel",
    "hubble_deep_field",
    "ihc",
    "moon",
    "motorcycle_left",
    "retina",
    "rocket",
)


@dataclass(frozen=True)
class KnownPainting:
    """A painting with N known strokes."""

    image: Array  # (H, W, 3) uint8
    labels: Array  # (H, W) int16, visible stroke, numbered from the bottom; -1 is the ground
    geometry: Array  # (N, len(StrokeGeometry)) float32


@cache
def family_of(seed: int, number: int) -> str | None:
    """Return the paint family of painting ``number``, given the seed, or None if it has no family."""
    random = np.random.default_rng([seed, number, FAMILY_STREAM])
    if number >= FIRST_PLAIN or random.random() >= FAMILY_SHARE:
        return None
    return str(random.choice(sorted(find_families())))


def paint(seed: int, number: int, pictures: Sequence[str], family: str | None = None) -> KnownPainting:
    """Make painting ``number`` with the paint of ``family`` or, if None, with an engine, a renderer or a formula.

    Paintings from `FIRST_PLAIN` on are plain: they use the default hand and opaque strokes, and are not aged.
    """
    random = np.random.default_rng([seed, number])
    picture = cut_square(pictures[int(random.integers(len(pictures)))], random)
    if family is not None:
        count = int(np.exp(random.uniform(*np.log(FAMILY_STROKES))))
        painting = paint_family(family, picture, count, choose_ground(picture, False, random), random)
        image = crack(painting.image, random) if random.random() < CRACKED_SHARE else painting.image
        labels = painting.canvas.labels.astype(np.int16)
        return KnownPainting(as_bytes(image), labels, geometry_of(painting.windows, painting.canvas))
    n = int(np.exp(random.uniform(*np.log(STROKES))))
    is_plain = random.random() < PLAIN_SHARE or number >= FIRST_PLAIN
    if not is_plain and random.random() < 2 * BARE_SHARE:
        return make_bare(picture, random)
    look = choose_plain_look(random) if is_plain else choose_look(random)
    if look.name == "fluid":
        n = min(n, MOST_FLUID) if random.random() < 0.85 else n
    layout = lay_strokes(picture, n, Hand() if is_plain else choose_hand(random), random)
    if not is_plain and random.random() < MARKS_SHARE:
        coats = float(random.uniform(1, 3))
        windows = draw_marks(layout, choose_marks(random), (PAINTING_SIDE, PAINTING_SIDE), random)
    else:
        coats = look.coats
        windows = draw_strokes(layout, look, int(random.integers(2**32)))
    mixing = choose_mixing(n, coats, is_plain, random)
    canvas = compose(windows, layout, mixing, choose_ground(picture, is_plain, random))
    image = canvas.image if is_plain else age(canvas.image, canvas.height, random)
    return KnownPainting(as_bytes(image), canvas.labels.astype(np.int16), geometry_of(windows, canvas))


def age(image: Array, height: Array, random: Random) -> Array:
    """Smudge, light and crack a painting, each with a certain probability."""
    image = smudge(image, random) if random.random() < 0.35 else image
    image = shine(image, height, random) if random.random() < 0.45 else image
    return crack(image, random) if random.random() < CRACKED_SHARE else image


def make_bare(picture: Array, random: Random) -> KnownPainting:
    """Make a picture without strokes, either a photograph or a bare ground, which may be cracked."""
    image = picture if random.random() < 0.6 else choose_ground(picture, False, random)
    image = crack(image, random) if random.random() < 0.3 else image
    labels = np.full(picture.shape[:2], -1, np.int16)
    return KnownPainting(as_bytes(image), labels, np.zeros((0, len(StrokeGeometry)), np.float32))


def as_bytes(image: Array) -> Array:
    """Convert a picture in [0, 1] to uint8 by rounding."""
    return (image * 255).round().astype(np.uint8)


def cut_square(name: str, random: Random) -> Array:
    """Crop a random square from a picture, rotate and mirror it at random, and resize it to (S, S, 3) float32."""
    from skimage.transform import resize  # noqa: PLC0415

    whole = load_picture(name, None).permute(1, 2, 0).numpy()
    shorter = min(whole.shape[:2])
    side = int(shorter * random.uniform(0.5, 1.0))
    top, left = (int(random.integers(extent - side + 1)) for extent in whole.shape[:2])
    part = np.rot90(whole[top : top + side, left : left + side], int(random.integers(4)))
    part = part[:, ::-1] if random.random() < 0.5 else part
    return np.clip(resize(part, (PAINTING_SIDE, PAINTING_SIDE), anti_aliasing=True), 0, 1).astype(np.float32)
