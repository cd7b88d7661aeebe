"""Extreme scenes: strokes, a canvas and a target each, from empty to absurd.

A scene is a plain function of the most strokes that are worth waiting for, because a network draws a thousand times
more slowly than a formula. Everything is random with a fixed seed, in float32, and within `strokes.catalogue.FIELDS`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from brushexp.strokes.catalogue import FAR, Strokes

CANVAS = (24, 37)  # height and width, unless a scene is about them; not a multiple of a tile, and not square
MANY, SEVERAL = 50_000, 16  # strokes
BACKGROUND = (0.2, 0.5, 0.9)


@dataclass(frozen=True)
class Scene:
    """What is drawn and compared.

    Attributes:
        strokes: N strokes.
        target: (3, H, W) in [0, 1]; its size is that of the canvas.
        wanted: strokes that the scene is about; ``strokes`` are fewer where so many would take too long.
        order: (N,) their numbers, the uppermost first; None for as they come.
    """

    strokes: Strokes
    target: Tensor
    wanted: int
    order: Tensor | None = None

    @property
    def front_to_back(self) -> Tensor:
        """``order``, whatever it is."""
        return torch.arange(len(self.strokes)) if self.order is None else self.order

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the canvas."""
        return int(self.target.shape[1]), int(self.target.shape[2])


def random_strokes(n: int, size: tuple[int, int], *, scale: tuple[float, float] = (8.0, 24.0)) -> Strokes:
    """``n`` gently bent strokes all over a canvas of ``size`` (H, W), with windows of ``scale`` pixels."""
    draw = _uniform(0)
    angle = 2 * math.pi * draw(n)
    way = (0.3 + 0.4 * draw(n))[:, None] * torch.stack([angle.cos(), angle.sin()], dim=1)
    return Strokes(
        position=draw(n, 2) * torch.tensor([size[1], size[0]]),
        scale=scale[0] + (scale[1] - scale[0]) * draw(n),
        start=-way,
        control=0.1 * (draw(n, 2) - 0.5),
        end=way,
        width=0.05 + 0.15 * draw(n),
        color=draw(n, 3),
        opacity=0.1 + 0.8 * draw(n),
    )


def random_target(size: tuple[int, int]) -> Tensor:
    """(3, H, W), every pixel by itself."""
    return _uniform(1)(3, *size)


def ordinary(most: int) -> Scene:
    """Nothing extreme, for comparison."""
    return _scene(random_strokes(min(most, SEVERAL), CANVAS), SEVERAL)


def no_strokes(most: int) -> Scene:
    """A bare canvas."""
    return _scene(random_strokes(0, CANVAS), 0)


def one_stroke(most: int) -> Scene:
    """A single one in the middle."""
    strokes = random_strokes(1, CANVAS, scale=(20.0, 24.0))
    return _scene(replace(strokes, position=torch.tensor([[18.0, 12.0]])), 1)


def many_on_one_pixel(most: int) -> Scene:
    """50,000 small strokes within a pixel of a canvas of 2 x 3, so faint that the lowest is still seen."""
    n = min(most, MANY)
    strokes, draw = random_strokes(n, (1, 1), scale=(2.0, 6.0)), _uniform(2)
    place = torch.tensor([1.0, 0.0]) + draw(n, 2)
    return _scene(replace(strokes, position=place, opacity=min(1, 10 / n) * draw(n)), MANY, (2, 3))


def coincident(most: int) -> Scene:
    """200 times the same stroke, in other colours."""
    n = min(most, 200)
    strokes = random_strokes(n, CANVAS)
    one = random_strokes(1, CANVAS, scale=(20.0, 24.0)).map(lambda value: value.expand(n, *value.shape[1:]).clone())
    one = replace(one, position=torch.tensor([18.0, 12.0]).expand(n, 2).clone())
    return _scene(replace(one, color=strokes.color, opacity=0.1 * strokes.opacity), 200)


def transparent(most: int) -> Scene:
    """All of opacity 0."""
    strokes = random_strokes(min(most, SEVERAL), CANVAS)
    return _scene(replace(strokes, opacity=torch.zeros_like(strokes.opacity)), SEVERAL)


def opaque(most: int) -> Scene:
    """All of opacity 1."""
    strokes = random_strokes(min(most, SEVERAL), CANVAS)
    return _scene(replace(strokes, opacity=torch.ones_like(strokes.opacity)), SEVERAL)


def length_0(most: int) -> Scene:
    """Curves that are points."""
    strokes = random_strokes(min(most, SEVERAL), CANVAS)
    return _scene(replace(strokes, control=strokes.start, end=strokes.start), SEVERAL)


def length_10000(most: int) -> Scene:
    """10,000 px long and as thick as usual, across the canvas."""
    strokes, side = random_strokes(min(most, SEVERAL), CANVAS), 1e4 / 1.4
    way = 0.7 * torch.nn.functional.normalize(strokes.end)
    return _scene(
        replace(
            strokes, scale=torch.full_like(strokes.scale, side), start=-way, end=way,
            control=1e-2 * strokes.control, width=3 / side * (1 + strokes.opacity),
        ),
        SEVERAL,
    )  # fmt: skip


def width_0(most: int) -> Scene:
    """Of no thickness."""
    strokes = random_strokes(min(most, SEVERAL), CANVAS)
    return _scene(replace(strokes, width=torch.zeros_like(strokes.width)), SEVERAL)


def width_1000(most: int) -> Scene:
    """1,000 px thick, with their edges across the canvas."""
    strokes = random_strokes(min(most, SEVERAL), CANVAS, scale=(8000.0, 8000.0))
    aside = torch.tensor([0.0, 500.0]) * torch.where(strokes.opacity > 0.5, 1.0, -1.0)[:, None]
    ends = torch.tensor([0.5, 0.0]).expand_as(strokes.start)
    return _scene(
        replace(
            strokes, position=strokes.position + aside, start=-ends, control=0 * ends, end=ends.clone(),
            width=torch.full_like(strokes.width, 1000 / 8000),
        ),
        SEVERAL,
    )  # fmt: skip


def far_away(most: int) -> Scene:
    """1e6 px beside the canvas."""
    strokes = random_strokes(min(most, SEVERAL), CANVAS)
    return _scene(replace(strokes, position=torch.where(strokes.start > 0, FAR, -FAR)), SEVERAL)


def far_centre(most: int) -> Scene:
    """On the canvas, but with the middle of their windows 1e6 px away, where float32 has steps of 1/16 px."""
    strokes = random_strokes(min(most, SEVERAL), CANVAS)
    start, control, end = (
        (8 + 0.7 * strokes.position + 8 * value - FAR) / 1000 for value in (strokes.start, strokes.control, strokes.end)
    )
    return _scene(
        replace(
            strokes, position=torch.full_like(start, FAR), scale=torch.full_like(strokes.scale, 2000.0),
            start=start, control=control, end=end, width=16 / 2000 * strokes.width,
        ),
        SEVERAL,
    )  # fmt: skip


def canvas_1(most: int) -> Scene:
    """A canvas of one pixel."""
    return _scene(random_strokes(min(most, SEVERAL), (1, 1)), SEVERAL, (1, 1))


def canvas_wide(most: int) -> Scene:
    """A canvas 8192 px wide and 64 px high."""
    return _scene(random_strokes(min(most, 2), (64, 8192), scale=(100.0, 4000.0)), 2, (64, 8192))


def target_black(most: int) -> Scene:
    """Target 0 everywhere."""
    return replace(ordinary(most), target=torch.zeros(3, *CANVAS))


def target_white(most: int) -> Scene:
    """Target 1 everywhere."""
    return replace(ordinary(most), target=torch.ones(3, *CANVAS))


def target_checkerboard(most: int) -> Scene:
    """Black and white pixels by turns."""
    rows, columns = torch.arange(CANVAS[0])[:, None], torch.arange(CANVAS[1])
    return replace(ordinary(most), target=((rows + columns) % 2).float().expand(3, *CANVAS).clone())


def target_one_pixel(most: int) -> Scene:
    """Black but for one white pixel."""
    target = torch.zeros(3, *CANVAS)
    target[:, CANVAS[0] // 2, CANVAS[1] // 2] = 1
    return replace(ordinary(most), target=target)


TARGETS: dict[str, Callable[[int], Scene]] = {
    "target 0": target_black,
    "target 1": target_white,
    "target: checkerboard of pixels": target_checkerboard,
    "target: one bright pixel": target_one_pixel,
}
SCENES: dict[str, Callable[[int], Scene]] = {
    "ordinary": ordinary,
    "no strokes": no_strokes,
    "one stroke": one_stroke,
    "50,000 on one pixel": many_on_one_pixel,
    "200 coincident": coincident,
    "all transparent": transparent,
    "all opaque": opaque,
    "length 0": length_0,
    "length 10,000 px": length_10000,
    "width 0": width_0,
    "width 1,000 px": width_1000,
    "1e6 px off the canvas": far_away,
    "windows 1e6 px away": far_centre,
    "canvas 1 x 1": canvas_1,
    "canvas 8192 x 64": canvas_wide,
    **TARGETS,
}


def _scene(strokes: Strokes, wanted: int, size: tuple[int, int] = CANVAS) -> Scene:
    return Scene(strokes, random_target(size), wanted)


def _uniform(seed: int) -> Callable[..., Tensor]:
    """Numbers in [0, 1), always the same ones."""
    generator = torch.Generator().manual_seed(seed)
    return lambda *shape: torch.rand(*shape, generator=generator)
