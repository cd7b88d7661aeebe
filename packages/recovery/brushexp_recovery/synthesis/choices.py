"""Choose looks, painters' hands, paint mixing and grounds at random."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.synthesis.canvas import Mixing, opaque_mixing
from brushexp_recovery.synthesis.hand import TURN, Hand, Layer, Random
from brushexp_recovery.synthesis.windows import BrushLook

Array = NDArray[Any]

OCHRE = (0.66, 0.56, 0.42)  # sRGB
WASH_BLUR = 40  # standard deviation in pixels of the blur that turns a subject into a wash
LAYERS = (
    (Layer(0.20, 1.0), Layer(0.35, 0.62), Layer(0.45, 0.40)),
    (Layer(1.0, 1.0),),
    (Layer(0.4, 1.0), Layer(0.6, 0.6)),
    (Layer(0.1, 1.0), Layer(0.2, 0.7), Layer(0.3, 0.5), Layer(0.4, 0.3)),
)
LOOKS = {"textured": 0.32, "bristles": 0.2, "fluid": 0.06, "disc": 0.12, "wash": 0.1, "analytic": 0.2}  # probabilities


def choose_plain_look(random: Random) -> BrushLook:
    """Choose at random between two kinds of bristle strokes: the textured renderer's and the bristle simulator's."""
    if random.random() < 0.65:
        return BrushLook("renderer", "textured", {})
    return BrushLook("engine", "fluid", {"brushes": 8, "supersample": int(random.integers(1, 3))})


def choose_look(random: Random) -> BrushLook:
    """Choose one of the fast engines and renderers at random, with random options."""
    coats = float(np.exp(random.uniform(np.log(1.5), np.log(6))))
    kind = random.choice(list(LOOKS), p=list(LOOKS.values()))
    if kind == "textured":
        return BrushLook("renderer", "textured", {}, coats)
    if kind == "bristles":  # random options
        return BrushLook("renderer", "textured", {"checkpoint": None, "variants": 16}, coats)
    if kind == "fluid":
        options = {"load": random.uniform(0.5, 1), "bristles": int(random.integers(40, 200)), "brushes": 8}
        return BrushLook("engine", "fluid", options, coats)
    if kind == "disc":
        return BrushLook("engine", "disc", {}, 1.0)
    if kind == "wash":
        options = {"film": random.uniform(0.5, 1), "rim": random.uniform(0.2, 0.6), "wander": random.uniform(0.05, 0.3)}
        return BrushLook("engine", "wash", options, coats)
    return BrushLook("renderer", "analytic", {"soft": float(random.uniform(0.5, 2))}, 1.0)


def choose_hand(random: Random) -> Hand:
    """Choose a painter's hand, which determines how strokes are placed."""
    aspect = np.exp(random.uniform(np.log(1.6), np.log(22)))
    return Hand(
        layers=LAYERS[int(random.integers(len(LAYERS)))],
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


def choose_mixing(n: int, coats: float, is_plain: bool, random: Random) -> Mixing:
    """Choose at random how the paint of ``n`` strokes mixes with the paint below."""
    if is_plain:
        return opaque_mixing(n, coats)
    least = random.choice([1.0, 0.85, 0.7])
    wet = random.uniform(0, 0.8, n) if random.random() < 0.3 else np.zeros(n)
    return Mixing(coats, random.uniform(least, 1, n), wet, drag=np.zeros(n))


def choose_ground(picture: Array, is_plain: bool, random: Random) -> Array:
    """Prime a canvas with an even colour, grain and a faint wash of the picture; sometimes use the picture itself."""
    if not is_plain and random.random() < 0.1:
        return picture
    usual = is_plain and random.random() < 0.4
    bare = np.array(OCHRE)
    if not usual:
        bare = random.choice([random.random(3), random.uniform(0.5, 1) * np.ones(3), bare])
    share = 0.25 if usual else random.choice([0.0, 0.25, 0.6])
    grain = gaussian_blur(random.normal(size=picture.shape[:2]), random.uniform(1, 4))
    grain = grain / max(grain.std(), 1e-6) * (0.015 if usual else random.uniform(0, 0.04))
    wash = gaussian_blur(picture, (WASH_BLUR, WASH_BLUR, 0))
    return np.clip(((1 - share) * bare + share * wash) * (1 + grain[..., None]), 0, 1)
