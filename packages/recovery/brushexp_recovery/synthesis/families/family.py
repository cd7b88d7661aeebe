"""Define the base class for paint families, and find all families."""

import importlib
import pkgutil
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts.layers import Light, normals_of, shade_picture
from brushexp_recovery.raster.blur import gaussian_blur
from brushexp_recovery.synthesis import families
from brushexp_recovery.synthesis.canvas import Canvas, Mixing, compose, opaque_mixing
from brushexp_recovery.synthesis.hand import Hand, Random
from brushexp_recovery.synthesis.layout import StrokeLayout, lay_strokes
from brushexp_recovery.synthesis.sheets import Sheet, draw_sheets
from brushexp_recovery.synthesis.windows import StrokeWindows

Array = NDArray[Any]

WEAVE_PERIOD = (2.8, 14.0)  # range of the distance between threads in pixels
WEAVE_SHARE = 0.6  # share of paintings that show the threads of their canvas
FILLED = 2.0  # height of paint that hides the threads
UNEVEN_SHARE = 0.4  # share of paintings that are lit unevenly
UNEVEN = 0.3  # maximum relative change of the light within a picture


class PaintFamily(ABC):
    """The paint of one painting, sampled from a wide prior: how strokes are placed, drawn, mixed and lit.

    Each subclass is in a separate file of this folder; the family is named after the file.
    """

    depth = (0.2, 2.0)  # range of the relief's depth, relative to the renderer's
    lit_share = 0.6  # share of paintings whose relief is lit

    def __init__(self, random: Random) -> None:
        """Choose the properties of the paint at random."""
        self.random = random

    @abstractmethod
    def choose_hand(self) -> Hand:
        """Choose the painter's hand, which determines how strokes are placed."""

    @abstractmethod
    def draw(self, length: float) -> Sheet:
        """Draw a straight stroke whose ``length`` is given in stroke widths."""

    def mix(self, count: int) -> Mixing:
        """Choose how the paint of ``count`` strokes mixes with the paint below."""
        return opaque_mixing(count, 1.0)

    def light(self, canvas: Canvas) -> Array:
        """Light the relief of paint and canvas; return the picture (H, W, 3)."""
        random, height = self.random, canvas.height
        if random.random() < WEAVE_SHARE:
            threads = draw_weave(height.shape, random)
            height = height + random.uniform(0.05, 0.5) * threads * np.exp(-FILLED * height)
        image = canvas.image
        if random.random() < self.lit_share:
            bumps = gaussian_blur(height, random.uniform(0.3, 1.0)) * random.uniform(*self.depth)
            light = Light(random.uniform(0, 360), random.uniform(15, 70), 1.0, random.uniform(0, 0.7))
            image = shade_picture(image.transpose(2, 0, 1), normals_of(bumps), light).transpose(1, 2, 0)
        if random.random() < UNEVEN_SHARE:
            image = light_unevenly(image, random)
        return np.clip(image, 0, 1)


@dataclass(frozen=True)
class FamilyPainting:
    """A painting made with the paint of a family, with all data needed to compute its ground truth."""

    image: Array  # (H, W, 3) in [0, 1]
    layout: StrokeLayout
    windows: StrokeWindows
    canvas: Canvas


@cache
def find_families() -> dict[str, type[PaintFamily]]:
    """Find the families of paint by name; every file in this folder except this one defines a family."""
    found = {}
    for module in pkgutil.iter_modules(families.__path__):
        members = vars(importlib.import_module(f"{families.__name__}.{module.name}")).values()
        for member in members:
            if isinstance(member, type) and issubclass(member, PaintFamily) and member is not PaintFamily:
                found[module.name] = member
    return found


def paint_family(name: str, picture: Array, count: int, ground: Array, random: Random) -> FamilyPainting:
    """Paint a picture (H, W, 3) with ``count`` strokes of a family over a ``ground`` (H, W, 3)."""
    family = find_families()[name](random)
    layout = lay_strokes(picture, count, family.choose_hand(), random)
    windows = draw_sheets(layout, family.draw)
    canvas = compose(windows, layout, family.mix(count), ground)
    return FamilyPainting(family.light(canvas).astype(np.float32), layout, windows, canvas)


def draw_weave(size: tuple[int, ...], random: Random) -> Array:
    """Draw the relief (H, W) of a plain-weave canvas, in which the threads of two directions alternate."""
    rows, columns = np.mgrid[: size[0], : size[1]].astype(np.float32)
    period_x, period_y = random.uniform(*WEAVE_PERIOD) * random.uniform(0.9, 1.1, 2)
    wander = [gaussian_blur(random.normal(size=size), 6) * random.uniform(0, 6) for _ in range(2)]
    x, y = (columns + wander[0]) * np.pi / period_x, (rows + wander[1]) * np.pi / period_y
    over = np.sin(x) * np.sin(y) > 0
    relief: Array = np.where(over, np.abs(np.sin(x)), np.abs(np.sin(y)))
    return relief


def light_unevenly(image: Array, random: Random) -> Array:
    """Simulate uneven light on a picture (H, W, 3): brightness varies across it and with distance from the centre."""
    height, width = image.shape[:2]
    rows, columns = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    angle, bend = random.uniform(0, 2 * np.pi), random.uniform(-0.5, 0.5)
    slope = rows * np.sin(angle) + columns * np.cos(angle)
    gain = 1 + random.uniform(0, UNEVEN) * (slope + bend * (rows**2 + columns**2)) / 2
    return image * gain[..., None]
