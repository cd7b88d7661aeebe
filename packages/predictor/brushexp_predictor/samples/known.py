"""Make paintings with known strokes for calibration, each determined by a seed and a number.

``init=layers`` places strokes with random options; then each stroke is randomly rotated, lengthened, widened and
recoloured. In some paintings, all strokes have about the same direction. Strokes are drawn plain or with brush
textures.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts.members import InLayers
from brushexp.contracts.pictures import load_picture
from brushexp.contracts.runs import render
from brushexp.contracts.strokes import Strokes, rewindow
from brushexp_predictor.lay.pyramid import resize_picture
from brushexp_predictor.samples.kinds import measure_each

Random = np.random.Generator

PICTURES = (  # painted in turn; no shipped network was trained on them
    "astronaut", "coffee", "brick", "ihc", "camera", "hubble_deep_field", "grace_hopper", "chelsea", "gravel", "rocket",
    "motorcycle_left", "logo",
)  # fmt: skip
PAINTING_SIDE = 256  # longer side of a painting in pixels
STROKE_COUNTS = (100, 1200)  # minimum and maximum number of strokes
GUESS = 1.5  # maximum factor by which the number of strokes given to the sampler is wrong
ONE_WAY = 0.25  # share of paintings whose strokes run in one direction
TEXTURED = 0.5  # share of paintings with brush textures


@dataclass(frozen=True)
class Known:
    """A painting whose strokes are known."""

    picture: Tensor  # (3, H, W) in [0, 1]
    strokes: Strokes  # bottom to top
    told: int  # number of strokes given to the sampler

    @property
    def size(self) -> tuple[int, int]:
        return self.picture.shape[1], self.picture.shape[2]


def known_painting(seed: int, number: int, side: int) -> Known:
    """Make the painting with the given number; its longer side has ``side`` pixels."""
    random = np.random.default_rng([seed, number])
    target = part_of(PICTURES[number % len(PICTURES)], side, random)
    size = (target.shape[1], target.shape[2])
    share = size[0] * size[1] / PAINTING_SIDE**2
    n = max(8, round(share * math.exp(random.uniform(*np.log(STROKE_COUNTS)))))
    generator = torch.Generator().manual_seed(int(random.integers(2**31)))
    strokes = vary_strokes(random_hand(random)(target, n, generator), random)
    ground = target.mean((1, 2)) if random.random() < 0.5 else torch.from_numpy(random.uniform(0, 1, 3)).float()
    renderer = "textured" if random.random() < TEXTURED else "analytic"
    with torch.no_grad():
        picture = render(strokes, size, background=ground, renderer=renderer).clamp(0, 1)
    return Known(picture, strokes, max(1, round(n * math.exp(random.uniform(-1, 1) * math.log(GUESS)))))


def part_of(name: str, side: int, random: Random) -> Tensor:
    """Crop a random part of a picture, rotate it by 0 to 3 right angles, and resample it to at most ``side`` pixels."""
    whole = load_picture(name, None)
    cut = [max(1, int(extent * random.uniform(0.5, 1))) for extent in whole.shape[1:]]
    top, left = (int(random.integers(extent - part + 1)) for extent, part in zip(whole.shape[1:], cut, strict=True))
    part = whole[:, top : top + cut[0], left : left + cut[1]]
    part = torch.rot90(part, int(random.integers(4)), (1, 2))
    height, width = (max(1, round(side * extent / max(cut))) for extent in part.shape[1:])
    return resize_picture(part, (height, width)).clamp(0, 1)


def random_hand(random: Random) -> InLayers:
    """Choose random options for ``init=layers``."""
    return InLayers(
        layers=int(random.integers(1, 5)),
        ratio=float(random.uniform(0.4, 0.75)),
        cover=float(random.uniform(0.4, 0.9)),
        length=float(math.exp(random.uniform(math.log(1.2), math.log(5)))),
        width=float(random.uniform(0.5, 1.4)),
        edges=float(random.choice([0.1, 0.2, 1.0])),
        opacity=1.0,
        jitter=float(random.uniform(0.1, 0.5)),
    )


def vary_strokes(strokes: Strokes, random: Random) -> Strokes:
    """Randomly rotate, lengthen, widen and recolour each of N strokes."""
    n = len(strokes)
    turn = np.radians(random.uniform(0, 20)) * random.normal(size=n)
    if random.random() < ONE_WAY:
        own = np.radians(measure_each(strokes)["direction"])
        turn += random.uniform(0, np.pi) - own
    longer, wider = np.exp(random.uniform(0, 0.4, (2, 1)) * random.normal(size=(2, n)))
    cosine, sine = (torch.from_numpy(longer * part(turn)).float() for part in (np.cos, np.sin))
    tones = random.uniform(0, 0.06) * random.normal(size=(n, 1)) + random.uniform(0, 0.03) * random.normal(size=(n, 3))

    def rotate(point: Tensor) -> Tensor:
        return torch.stack([cosine * point[:, 0] - sine * point[:, 1], sine * point[:, 0] + cosine * point[:, 1]], 1)

    return rewindow(replace(
        strokes, start=rotate(strokes.start), control=rotate(strokes.control), end=rotate(strokes.end),
        width=strokes.width * torch.from_numpy(wider).float(),
        color=(strokes.color + torch.from_numpy(tones).float()).clamp(0, 1),
    ))  # fmt: skip
