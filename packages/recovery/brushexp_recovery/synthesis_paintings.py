"""Paintings with known strokes, as many and as different as wanted: each is decided by a seed and its number."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.pictures.load import load_picture
from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.synthesis import TURN, Hand, Random, lay_strokes
from brushexp_recovery.synthesis_ageing import crack, shine, smudge
from brushexp_recovery.synthesis_canvas import Mixing, compose, geometry_of
from brushexp_recovery.synthesis_looks import Look, draw_strokes
from brushexp_recovery.synthesis_marks import any_marks, draw_marks

Array = NDArray[Any]

SIDE = 512  # pixels of a painting
COUNTS = (120, 2600)  # strokes of a painting
PLAIN_SHARE = 0.55  # share of paintings by a plain hand
BARE = 0.05  # share of paintings without a stroke
MARKED = 0.5  # share of the looks that are marks by a formula, where the hand is not plain
PLAIN = 900_046  # paintings from this number on are plain
FEW = 400  # strokes beyond which the simulator of bristles takes too long
OCHRE = (0.66, 0.56, 0.42)
PICTURES = (  # that come with scikit-image and matplotlib
    *("astronaut", "brick", "chelsea", "coffee", "grace_hopper", "gravel", "hubble_deep_field", "ihc"),
    *("moon", "motorcycle_left", "retina", "rocket"),
)


@dataclass(frozen=True)
class Painted:
    """A painting whose strokes are known."""

    image: Array  # (H, W, 3) uint8
    labels: Array  # (H, W) int16, the stroke that is seen, numbered from the bottom; -1 is the ground
    geometry: Array  # (N, 6) float32 as `synthesis_canvas.geometry_of` says


def paint(seed: int, number: int, pictures: Sequence[str]) -> Painted:
    """Make painting ``number``: most as a plain hand paints, others of many kinds; from `PLAIN` on all plain."""
    random = np.random.default_rng([seed, number])
    picture = square_of(pictures[int(random.integers(len(pictures)))], random)
    n = int(np.exp(random.uniform(*np.log(COUNTS))))
    plain = random.random() < PLAIN_SHARE or number >= PLAIN
    if not plain and random.random() < 2 * BARE:
        return without_strokes(picture, random)
    look = plain_look(random) if plain else any_look(random)
    if look.name == "fluid":
        n = min(n, FEW) if random.random() < 0.85 else n
    laid = lay_strokes(picture, n, Hand() if plain else any_hand(random), random)
    if not plain and random.random() < MARKED:
        look = Look("marks", "marks", {}, float(random.uniform(1, 3)))
        drawn = draw_marks(laid, any_marks(random), (SIDE, SIDE), random)
    else:
        drawn = draw_strokes(laid, look, int(random.integers(2**32)))
    composed = compose(drawn, laid, mixing_of(n, look, plain, random), ground_of(picture, plain, random))
    image = composed.image
    if not plain:
        image = smudge(image, random) if random.random() < 0.35 else image
        image = shine(image, composed.height, random) if random.random() < 0.45 else image
        image = crack(image, random) if random.random() < 0.12 else image
    return Painted(as_bytes(image), composed.labels.astype(np.int16), geometry_of(drawn, composed))


def without_strokes(picture: Array, random: Random) -> Painted:
    """Make what is no stroke: a photograph, or bare ground, with cracks at times."""
    image = picture if random.random() < 0.6 else ground_of(picture, False, random)
    image = crack(image, random) if random.random() < 0.3 else image
    return Painted(as_bytes(image), np.full(picture.shape[:2], -1, np.int16), np.zeros((0, 6), np.float32))


def as_bytes(image: Array) -> Array:
    """Round a picture in [0, 1] to uint8."""
    return (image * 255).round().astype(np.uint8)


def square_of(name: str, random: Random) -> Array:
    """Cut a square out of a picture, (S, S, 3) float32, turned and mirrored; a small part of a large picture."""
    from skimage.transform import resize  # noqa: PLC0415

    whole = load_picture(name, None).permute(1, 2, 0).numpy()
    least = min(whole.shape[:2])
    side = int(least * random.uniform(0.5, 1.0))
    top, left = (int(random.integers(extent - side + 1)) for extent in whole.shape[:2])
    part = np.rot90(whole[top : top + side, left : left + side], int(random.integers(4)))
    part = part[:, ::-1] if random.random() < 0.5 else part
    return np.clip(resize(part, (SIDE, SIDE), anti_aliasing=True), 0, 1).astype(np.float32)


def plain_look(random: Random) -> Look:
    """Choose bristles of textures, or of the simulator."""
    if random.random() < 0.65:
        return Look("renderer", "textured", {})
    return Look("engine", "fluid", {"brushes": 8, "supersample": int(random.integers(1, 3))})


def any_look(random: Random) -> Look:
    """Choose any engine or renderer that takes little time, with any of its options that matter here."""
    coats = float(np.exp(random.uniform(np.log(1.5), np.log(6))))
    kind = random.choice(
        ["textured", "bristles", "fluid", "disc", "wash", "analytic"], p=[0.32, 0.2, 0.06, 0.12, 0.1, 0.2]
    )
    if kind == "textured":
        return Look("renderer", "textured", {}, coats)
    if kind == "bristles":  # drawn at random
        return Look("renderer", "textured", {"checkpoint": None, "variants": 16}, coats)
    if kind == "fluid":
        options = {"load": random.uniform(0.5, 1), "bristles": int(random.integers(40, 200)), "brushes": 8}
        return Look("engine", "fluid", options, coats)
    if kind == "disc":
        return Look("engine", "disc", {}, 1.0)
    if kind == "wash":
        options = {"film": random.uniform(0.5, 1), "rim": random.uniform(0.2, 0.6), "wander": random.uniform(0.05, 0.3)}
        return Look("engine", "wash", options, coats)
    return Look("renderer", "analytic", {"soft": float(random.uniform(0.5, 2))}, 1.0)


def any_hand(random: Random) -> Hand:
    """Choose how strokes are laid."""
    layers = [
        ((0.20, 1.0), (0.35, 0.62), (0.45, 0.40)),
        ((1.0, 1.0),),
        ((0.4, 1.0), (0.6, 0.6)),
        ((0.1, 1.0), (0.2, 0.7), (0.3, 0.5), (0.4, 0.3)),
    ]
    aspect = np.exp(random.uniform(np.log(1.6), np.log(22)))
    return Hand(
        layers=layers[int(random.integers(len(layers)))],
        cover=float(random.uniform(1.2, 4.5)),
        aspect=(float(aspect), float(random.uniform(0.1, 0.5))),
        limits=(1.3, 40.0),
        uneven=float(random.choice([0.0, random.uniform(0.05, 0.35)])),
        directions=int(random.choice([2, 4, 8, 16, 64])),
        shaky=float(random.uniform(1, 12)),
        color=float(random.choice([0.0, random.uniform(0.05, 0.5), random.uniform(0.2, 2.0)])),
        palette=int(random.choice([0, 0, 5, 8, 16])),
        hatch=float(random.choice([0.0, 0.0, 0.3, 0.6, 1.0])),
        turn=TURN * float(random.uniform(0.3, 3)),
        sway=float(random.choice([0.0, 0.0, 0.3, 0.8])),
        taper=float(random.choice([0.0, 0.2, 0.4])),
        even=bool(random.random() < 0.4),
        clip=float(random.choice([0.0, 0.0, random.uniform(0.03, 0.2)])),
    )


def mixing_of(n: int, look: Look, plain: bool, random: Random) -> Mixing:
    """Choose how paint mixes with paint."""
    if plain:
        return Mixing(look.coats, np.ones(n), np.zeros(n))
    least = random.choice([1.0, 0.85, 0.7])
    wet = random.uniform(0, 0.8, n) if random.random() < 0.3 else np.zeros(n)
    return Mixing(look.coats, random.uniform(least, 1, n), wet)


def ground_of(picture: Array, plain: bool, random: Random) -> Array:
    """Prime a canvas: any even colour, with some of the picture, and grain; now and then it is the whole picture."""
    if not plain and random.random() < 0.1:
        return picture
    usual = plain and random.random() < 0.4
    bare = np.array(OCHRE)
    if not usual:
        bare = random.choice([random.random(3), random.uniform(0.5, 1) * np.ones(3), bare])
    share = 0.25 if usual else random.choice([0.0, 0.25, 0.6])
    grain = gaussian_blur(random.normal(size=picture.shape[:2]), random.uniform(1, 4))
    grain = grain / max(grain.std(), 1e-6) * (0.015 if usual else random.uniform(0, 0.04))
    wash = gaussian_blur(picture, (40, 40, 0))
    return np.clip(((1 - share) * bare + share * wash) * (1 + grain[..., None]), 0, 1)
