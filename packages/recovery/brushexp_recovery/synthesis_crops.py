"""Crops of paintings, zoomed, turned, lit and weathered, with what the network is to say of each pixel."""

from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from brushexp_recovery.network import UNIT, USUAL
from brushexp_recovery.synthesis import Random
from brushexp_recovery.synthesis_ageing import weather
from brushexp_recovery.synthesis_paintings import Painted

Array = NDArray[Any]

CROP = 160  # pixels
ZOOMS = (0.4, 3.0)
SPREAD, WIDE = 0.35, (-1.4, 1.0)  # of the logarithm of widths around the usual one; and of one crop in four
WEATHERED = 0.6  # share of the crops: half of them as the painting is photographed, half as the network sees it
STRENGTH = (0.6, 1.5)  # of weathering


class Crops(NamedTuple):
    """A batch of crops."""

    image: Tensor  # (B, 3, S, S) in [0, 1]
    labels: Tensor  # (B, S, S) int64, numbered from the bottom; -1 is the ground
    geometry: Tensor  # (B, 7, S, S) centre x and y, cosine, sine, log width, log length, share


def typical_width(painted: Painted) -> float:
    """Find the width in pixels of the stroke in the middle of all that are seen."""
    seen = painted.geometry[painted.geometry[:, 5] > 0.3]
    return float(np.exp(np.median(seen[:, 3]))) if len(seen) else USUAL


def crop(painted: Painted, random: Random, side: int = CROP) -> tuple[Array, Array, Array]:
    """Cut a crop out of a painting, at about the scale at which pictures are shown to the network."""
    spread = random.uniform(*WIDE) if random.random() < 0.25 else random.normal(0, SPREAD)
    height, width = painted.labels.shape
    zoom = np.clip(USUAL * np.exp(spread) / typical_width(painted), *ZOOMS)
    part = min(round(side / zoom), height, width)
    zoom, top, left = side / part, random.integers(height - part + 1), random.integers(width - part + 1)
    cut = recoloured(painted.image[top : top + part, left : left + part].astype(np.float32) / 255, random)
    aged = random.random() < WEATHERED
    before = aged and random.random() < 0.5
    cut = weather(cut, random, random.uniform(*STRENGTH)) if before else cut
    image = Image.fromarray((cut * 255).round().astype(np.uint8))
    image = image.resize((side, side), Image.Resampling.BICUBIC if zoom > 1 else Image.Resampling.LANCZOS)
    nearest = ((np.arange(side) + 0.5) / zoom).astype(int).clip(0, part - 1)
    labels = painted.labels[top : top + part, left : left + part][np.ix_(nearest, nearest)].astype(np.int64)
    geometry = painted.geometry.copy()
    geometry[:, :2] = (geometry[:, :2] - [left, top]) * zoom
    geometry[:, 3:5] += np.log(zoom)
    pixels = np.asarray(image, np.float32) / 255
    if aged and not before:
        pixels = weather(pixels, random, random.uniform(*STRENGTH))
    return turned(pixels, labels, geometry, random)


def recoloured(image: Array, random: Random) -> Array:
    """Exchange channels, and change light and contrast."""
    image = image[..., random.permutation(3)] if random.random() < 0.5 else image
    if random.random() < 0.7:
        gain, lift = random.uniform(0.75, 1.15, 3).astype(np.float32), random.uniform(-0.05, 0.08)
        image = np.clip(image ** np.float32(np.exp(random.uniform(-0.3, 0.3))) * gain + np.float32(lift), 0, 1)
    return image


def turned(image: Array, labels: Array, geometry: Array, random: Random) -> tuple[Array, Array, Array]:
    """Turn a crop by quarters and mirror it, and write the maps (7, S, S) of its geometry."""
    side, quarters = len(labels), int(random.integers(4))
    x, y, angle, *rest = geometry.T
    for _ in range(quarters):  # anticlockwise on the screen
        x, y, angle = y, side - x, angle - np.pi / 2
    image, labels = np.rot90(image, quarters), np.rot90(labels, quarters)
    if random.random() < 0.5:
        image, labels, x, angle = image[:, ::-1], labels[:, ::-1], side - x, -angle
    rows, columns = np.mgrid[:side, :side].astype(np.float32) + 0.5
    table = np.stack([x, y, np.cos(2 * angle), np.sin(2 * angle), *rest]).astype(np.float32)
    maps = table[:, np.maximum(labels, 0)] if table.size else np.zeros((7, side, side), np.float32)
    maps[0], maps[1] = (maps[0] - columns) / UNIT, (maps[1] - rows) / UNIT
    return image.transpose(2, 0, 1).astype(np.float32), labels, maps.astype(np.float32)


def batch_of(crops: list[tuple[Array, Array, Array]]) -> Crops:
    """Put crops together."""
    return Crops(*(torch.from_numpy(np.stack(parts)) for parts in zip(*crops, strict=True)))
