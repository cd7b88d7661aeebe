"""Make crops of paintings that are zoomed, rotated, recoloured and weathered, with true attributes at each pixel."""

from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from brushexp_recovery.model.channels import CENTRE_UNIT, StrokeAttribute
from brushexp_recovery.model.unet import TRAINED_WIDTH
from brushexp_recovery.synthesis.ageing import weather
from brushexp_recovery.synthesis.canvas import StrokeGeometry
from brushexp_recovery.synthesis.hand import Random
from brushexp_recovery.synthesis.paintings import KnownPainting

Array = NDArray[Any]

CROP_SIDE = 160  # side in pixels
ZOOMS = (0.15, 3.0)  # smallest and largest zoom, which bring strokes of 100 pixels to the width used in training
WIDTH_SPREAD = 0.35  # spread of the logarithm of widths around the training width
WIDE_SHARE = 0.25  # share of the crops whose widths are spread evenly over a wide range
WIDE_RANGE = (-1.4, 1.0)  # range of the logarithm of their widths
WEATHERED_SHARE = 0.6  # share of weathered crops, half at the photograph's scale and half at the network's
STRENGTH = (0.6, 1.5)  # range of the strength of weathering
LEAST_VISIBLE = 0.3  # visible share of a stroke, above which its width counts
CENTRE_COLUMNS = [StrokeGeometry.CENTRE_X, StrokeGeometry.CENTRE_Y]
SIZE_COLUMNS = [StrokeGeometry.LOG_WIDTH, StrokeGeometry.LOG_LENGTH]


class Crop(NamedTuple):
    """A crop of a painting, with its ground truth."""

    image: Array  # (3, S, S) float32 in [0, 1]
    labels: Array  # (S, S) int64, numbered from the bottom; -1 is the ground
    attributes: Array  # (len(StrokeAttribute), S, S) float32, of the stroke at each pixel, as in the network's maps


class Crops(NamedTuple):
    """A batch of crops, with their ground truth."""

    image: Tensor  # (B, 3, S, S) in [0, 1]
    labels: Tensor  # (B, S, S) int64, numbered from the bottom; -1 is the ground
    attributes: Tensor  # (B, len(StrokeAttribute), S, S)


def typical_width(painting: KnownPainting) -> float:
    """Compute the median width, in pixels, of the strokes that are sufficiently visible."""
    log_width, visible = painting.geometry[:, StrokeGeometry.LOG_WIDTH], painting.geometry[:, StrokeGeometry.VISIBLE]
    seen = log_width[visible > LEAST_VISIBLE]
    return float(np.exp(np.median(seen))) if len(seen) else TRAINED_WIDTH


def cut_crop(painting: KnownPainting, random: Random, side: int = CROP_SIDE) -> Crop:
    """Crop a painting at random, and resize the crop, usually so that its strokes are about `TRAINED_WIDTH` wide."""
    height, width = painting.labels.shape
    part = min(round(side / _choose_zoom(painting, random)), height, width)
    zoom = side / part
    top, left = random.integers(height - part + 1), random.integers(width - part + 1)
    place = slice(top, top + part), slice(left, left + part)
    image = recolor(painting.image[place].astype(np.float32) / 255, random)
    is_weathered = random.random() < WEATHERED_SHARE
    is_photographed = is_weathered and random.random() < 0.5
    image = weather(image, random, random.uniform(*STRENGTH)) if is_photographed else image
    picture = Image.fromarray((image * 255).round().astype(np.uint8))
    picture = picture.resize((side, side), Image.Resampling.BICUBIC if zoom > 1 else Image.Resampling.LANCZOS)
    nearest = ((np.arange(side) + 0.5) / zoom).astype(int).clip(0, part - 1)
    labels = painting.labels[place][np.ix_(nearest, nearest)].astype(np.int64)
    geometry = painting.geometry.copy()
    geometry[:, CENTRE_COLUMNS] = (geometry[:, CENTRE_COLUMNS] - [left, top]) * zoom
    geometry[:, SIZE_COLUMNS] += np.log(zoom)
    image = np.asarray(picture, np.float32) / 255
    if is_weathered and not is_photographed:
        image = weather(image, random, random.uniform(*STRENGTH))
    return turn_and_mirror(image, labels, geometry, random)


def _choose_zoom(painting: KnownPainting, random: Random) -> float:
    """Choose a random scale for a crop, usually around the scale used in training."""
    is_wide = random.random() < WIDE_SHARE
    spread = random.uniform(*WIDE_RANGE) if is_wide else random.normal(0, WIDTH_SPREAD)
    return float(np.clip(TRAINED_WIDTH * np.exp(spread) / typical_width(painting), *ZOOMS))


def recolor(image: Array, random: Random) -> Array:
    """Randomly permute the colour channels, and change brightness and contrast."""
    image = image[..., random.permutation(3)] if random.random() < 0.5 else image
    if random.random() < 0.7:
        gain, lift = random.uniform(0.75, 1.15, 3).astype(np.float32), random.uniform(-0.05, 0.08)
        image = np.clip(image ** np.float32(np.exp(random.uniform(-0.3, 0.3))) * gain + np.float32(lift), 0, 1)
    return image


def turn_and_mirror(image: Array, labels: Array, geometry: Array, random: Random) -> Crop:
    """Randomly rotate a square by quarter turns and mirror it, and compute the attribute maps of its strokes.

    ``image`` is (S, S, 3), ``labels`` (S, S), and ``geometry`` (N, len(StrokeGeometry)) in pixels of the square.
    """
    side, quarters = len(labels), int(random.integers(4))
    x, y = geometry[:, StrokeGeometry.CENTRE_X], geometry[:, StrokeGeometry.CENTRE_Y]
    angle = geometry[:, StrokeGeometry.ANGLE]
    for _ in range(quarters):  # anticlockwise on the screen
        x, y, angle = y, side - x, angle - np.pi / 2
    image, labels = np.rot90(image, quarters), np.rot90(labels, quarters)
    if random.random() < 0.5:
        image, labels, x, angle = image[:, ::-1], labels[:, ::-1], side - x, -angle
    table = np.empty((len(StrokeAttribute), len(geometry)), np.float32)
    table[StrokeAttribute.CENTRE_X] = x
    table[StrokeAttribute.CENTRE_Y] = y
    table[StrokeAttribute.COSINE] = np.cos(2 * angle)
    table[StrokeAttribute.SINE] = np.sin(2 * angle)
    table[StrokeAttribute.LOG_WIDTH] = geometry[:, StrokeGeometry.LOG_WIDTH]
    table[StrokeAttribute.LOG_LENGTH] = geometry[:, StrokeGeometry.LOG_LENGTH]
    table[StrokeAttribute.VISIBLE] = geometry[:, StrokeGeometry.VISIBLE]
    return Crop(image.transpose(2, 0, 1).astype(np.float32), labels, _map_attributes(table, labels))


def _map_attributes(table: Array, labels: Array) -> Array:
    """Look up each pixel's stroke attributes (7, S, S) in a table (7, N); centres become offsets from the pixel."""
    rows, columns = np.mgrid[: labels.shape[0], : labels.shape[1]].astype(np.float32) + 0.5
    maps = table[:, np.maximum(labels, 0)] if table.size else np.zeros((len(table), *labels.shape), np.float32)
    maps[StrokeAttribute.CENTRE_X] = (maps[StrokeAttribute.CENTRE_X] - columns) / CENTRE_UNIT
    maps[StrokeAttribute.CENTRE_Y] = (maps[StrokeAttribute.CENTRE_Y] - rows) / CENTRE_UNIT
    return maps.astype(np.float32)


def batch_of(crops: list[Crop]) -> Crops:
    """Stack crops into a batch."""
    return Crops(*(torch.from_numpy(np.stack(parts)) for parts in zip(*crops, strict=True)))
