"""Make training pictures, determined by number and seed: recoloured crops of photographs, and random strokes."""

import logging
import math
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from brushexp.contracts import UserError
from brushexp.contracts.pictures import load_picture, pictures_of
from brushexp.contracts.runs import render
from brushexp.contracts.strokes import strokes_along
from brushexp_predictor.lay.pyramid import resize_picture

Array = NDArray[Any]
Random = np.random.Generator

SAMPLES = ("retina", "moon", "coins", "grass", "clock_motion", "cell", "page", "text", "color", "horse")  # scikit-image
PHOTOGRAPHS = ("china.jpg", "flower.jpg")  # scikit-learn
GENERATED = 0.5  # share of pictures made of random strokes
SMALLEST_CROP, LARGEST_CROP = 0.6, 3.0  # range of the side of a crop, in sides of the training picture
MIXED_CHANNELS, NEGATIVE, TONED = 0.5, 0.15, 0.5  # share of crops recoloured in each way
STROKES = (60, 2500)  # range of the number of strokes of a generated picture
PALETTE = 997  # every 997th pixel of the photographs gives a colour

log = logging.getLogger(__name__)


def load_subjects(names: Sequence[str] | None) -> dict[str, Tensor]:
    """Load pictures (3, H, W) from files and folders or, for None, those shipped with scikit-image and scikit-learn."""
    if names is None:
        return {Path(name).stem: load_picture(name, None) for name in (*SAMPLES, *_photographs())}
    if not names:
        raise UserError("data=[] has no picture to learn from; give some, or data=null for pictures of packages")
    return {Path(file).name: load_picture(file, None) for file in pictures_of(names)}


def _photographs() -> list[str]:
    spec = find_spec("sklearn")
    if spec is None or spec.origin is None:
        log.warning("scikit-learn, which has two training photographs, is not installed: pip install scikit-learn")
        return []
    return [str(Path(spec.origin).parent / "datasets" / "images" / name) for name in PHOTOGRAPHS]


class Subjects:
    """An endless sequence of square pictures, each determined by seed and number alone."""

    def __init__(self, photographs: Sequence[Tensor], seed: int) -> None:
        self.photographs, self.seed = list(photographs), seed
        areas = np.array([picture[0].numel() for picture in self.photographs]) ** 0.25
        self.chances = areas / areas.sum()
        self.palette = np.concatenate([picture.flatten(1).T.numpy()[::PALETTE] for picture in self.photographs])

    def __call__(self, number: int, side: int) -> Tensor:
        """Make the picture (3, side, side), in [0, 1], with the given number."""
        random = np.random.default_rng([self.seed, number])
        if random.random() < GENERATED:
            return self._of_strokes(side, random)
        return vary_colors(self._crop(side, random), random)

    def _crop(self, side: int, random: Random) -> Tensor:
        picture = self.photographs[random.choice(len(self.photographs), p=self.chances)]
        height, width = picture.shape[1:]
        cut = min(round(side * math.exp(random.uniform(*np.log([SMALLEST_CROP, LARGEST_CROP])))), height, width)
        top, left = random.integers(height - cut + 1), random.integers(width - cut + 1)
        crop = resize_picture(picture[:, top : top + cut, left : left + cut], (side, side))
        crop = torch.rot90(crop, int(random.integers(4)), (1, 2))
        return crop.flip(2) if random.random() < 0.5 else crop

    def _of_strokes(self, side: int, random: Random) -> Tensor:
        """Draw overlapping random strokes of all sizes, as in the dead leaves model (Lee, Mumford and Huang, 2001)."""
        n = round(math.exp(random.uniform(*np.log(STROKES))))
        half_width = 0.008 * side + (random.pareto(1.3, n) * 0.012 * side).clip(0, side / 3)
        angle = random.uniform(0, math.pi) + random.normal(0, random.choice([0.2, 0.6, 3.0]), n)
        half = half_width * random.uniform(0.3, 4, n)
        along = np.stack([np.cos(angle), np.sin(angle)], 1) * half[:, None]
        bend = np.stack([-along[:, 1], along[:, 0]], 1) * random.normal(0, 0.4, (n, 1))
        colors, ground = self._colors(n, random)
        places = random.uniform(-0.05 * side, 1.05 * side, (n, 2))
        order = np.argsort(-half_width * half + random.normal(0, random.choice([0, 50, 2000]), n))
        curves = np.stack([places - along, places + bend, places + along], 1)[order]
        strokes = strokes_along(
            torch.from_numpy(curves).float(),
            torch.from_numpy(2 * half_width[order]).float(),
            torch.from_numpy(colors[order]).float(),
            float(random.choice([1.0, 1.0, 1.0, 0.5])),
        )
        soft = float(random.choice([1.0, 1.5, 3.0]))
        background = (
            self._crop(side, random).mean((1, 2)) if random.random() < 0.5 else torch.from_numpy(ground).float()
        )
        return grain(apply_light(render(strokes, side, background=background, soft=soft), random), random)

    def _colors(self, n: int, random: Random) -> tuple[Array, Array]:
        """Sample colours (n, 3) near a few palette colours, and the colour of the ground."""
        if random.random() < 0.6:
            few = self.palette[random.integers(len(self.palette), size=random.integers(3, 20))]
        else:
            few = random.uniform(0, 1, (int(random.integers(2, 9)), 3))
        grey = random.uniform() ** 2
        few = few * (1 - grey) + few.mean(1, keepdims=True) * grey
        spread = random.normal(0, random.uniform(0.02, 0.15), (n, 1)) + random.normal(0, 0.03, (n, 3))
        return (few[random.integers(len(few), size=n)] + spread).clip(0, 1), few[0].clip(0, 1)


def vary_colors(picture: Tensor, random: Random) -> Tensor:
    """Randomly swap channels, invert colours, or change tones."""
    if random.random() < MIXED_CHANNELS:
        picture = picture[torch.from_numpy(random.permutation(3))]
    if random.random() < NEGATIVE:
        picture = 1 - picture
    if random.random() < TONED:
        toned = picture.clamp_min(1e-3) ** math.exp(random.normal(0, 0.35))
        picture = (toned - 0.5) * random.uniform(0.6, 1.3) + 0.5 + random.normal(0, 0.08)
    return picture.clamp(0, 1)


def apply_light(picture: Tensor, random: Random) -> Tensor:
    """Apply a random linear gradient of light across a picture."""
    across = torch.linspace(-0.5, 0.5, picture.shape[1])
    down, right = random.normal(0, 0.25, 2)
    return picture * (1 + down * across[:, None] + right * across)


def grain(picture: Tensor, random: Random) -> Tensor:
    """Add photographic noise to half of the pictures."""
    if random.random() < 0.5:
        channels = 1 if random.random() < 0.5 else 3
        noise = random.normal(0, random.uniform(0.005, 0.06), (channels, *picture.shape[1:]))
        picture = picture + torch.from_numpy(noise).float()
    return picture.clamp(0, 1)
