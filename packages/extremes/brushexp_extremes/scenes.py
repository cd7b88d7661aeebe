"""Extreme scenes: strokes, a canvas and a target each, from empty to absurd.

Everything is random with a fixed seed, in float32, and within `strokes.catalogue.FIELDS`. To be imported when plugins
are loaded: there is a scene for each colour space.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn.functional import normalize

from brushexp.compositing.layers import Size
from brushexp.registry import plugins
from brushexp.strokes.catalogue import FARTHEST, Strokes

CANVAS = (24, 37)  # height and width, unless a scene is about them; not a multiple of a tile, and not square
SEVERAL = 16  # strokes of most scenes
BACKGROUND = (0.2, 0.5, 0.9)

Changes = dict[str, Tensor]  # field of strokes -> values


@dataclass(frozen=True)
class StressScene:
    """What is drawn and compared: strokes, against a target (3, H, W) in [0, 1] as large as the canvas.

    ``wanted`` are the strokes that the scene is about; ``strokes`` are fewer where so many would take too long.
    ``order`` (N,) are their numbers, the uppermost first; None for as they come. ``color`` is the space in which they
    mix.
    """

    strokes: Strokes
    target: Tensor
    wanted: int
    order: Tensor | None = None
    color: str = "rgb"

    @property
    def size(self) -> Size:
        """Height and width of the canvas."""
        _, height, width = self.target.shape
        return height, width


def random_strokes(n: int, size: Size, *, scale: tuple[float, float] = (8.0, 24.0)) -> Strokes:
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


def random_target(size: Size) -> Tensor:
    """(3, H, W), every pixel by itself."""
    return _uniform(1)(3, *size)


def _checkerboard(size: Size) -> Tensor:
    rows, columns = torch.arange(size[0])[:, None], torch.arange(size[1])
    return ((rows + columns) % 2).float().expand(3, *size)


def one_bright_pixel(size: Size) -> Tensor:
    """(3, H, W), 1 in its middle and 0 elsewhere."""
    target = torch.zeros(3, *size)
    target[:, size[0] // 2, size[1] // 2] = 1
    return target


@dataclass(frozen=True)
class Recipe:
    """Random strokes with windows of ``scale``, and what is extreme about them: ``change`` replaces some fields."""

    change: Callable[[Strokes], Changes] = lambda strokes: {}
    wanted: int = SEVERAL
    canvas: Size = CANVAS
    scale: tuple[float, float] = (8.0, 24.0)
    target: Callable[[Size], Tensor] = random_target
    color: str = "rgb"  # space in which they mix

    def scene(self, most: int) -> StressScene:
        """The scene with at most so many strokes: a network draws a thousand times more slowly than a formula."""
        strokes = random_strokes(min(most, self.wanted), self.canvas, scale=self.scale)
        changed, target = replace(strokes, **self.change(strokes)), self.target(self.canvas)
        return StressScene(changed, target, self.wanted, color=self.color)


def _on_one_pixel(strokes: Strokes) -> Changes:
    """Within a pixel of a canvas of 2 x 3, so faint that the lowest stroke is still seen."""
    n, draw = len(strokes), _uniform(2)
    return {"position": torch.tensor([1.0, 0.0]) + draw(n, 2), "opacity": min(1, 10 / n) * draw(n)}


def _coincident(strokes: Strokes) -> Changes:
    """The same stroke again and again, in other colours."""
    n, one = len(strokes), random_strokes(1, CANVAS, scale=(20.0, 24.0))
    same = {name: value.expand(n, *value.shape[1:]).clone() for name, value in one.items()}
    middle = torch.tensor([18.0, 12.0]).expand(n, 2).clone()
    return same | {"position": middle, "color": strokes.color, "opacity": 0.1 * strokes.opacity}


def _long(strokes: Strokes) -> Changes:
    """10,000 px long and as thick as usual, across the canvas."""
    way, side = 0.7 * normalize(strokes.end), 1e4 / 1.4
    return {
        "scale": torch.full_like(strokes.scale, side), "start": -way, "end": way,
        "control": 1e-2 * strokes.control, "width": 3 / side * (1 + strokes.opacity),
    }  # fmt: skip


def _thick(strokes: Strokes) -> Changes:
    """1,000 px thick, with their edges across the canvas."""
    aside = torch.tensor([0.0, 500.0]) * torch.where(strokes.opacity > 0.5, 1.0, -1.0)[:, None]
    ends = torch.tensor([0.5, 0.0]).expand_as(strokes.start)
    return {
        "position": strokes.position + aside, "start": -ends, "control": 0 * ends, "end": ends.clone(),
        "width": torch.full_like(strokes.width, 1000 / 8000),
    }  # fmt: skip


def _pure(strokes: Strokes) -> Changes:
    """Channels of 0 and 1 alone, where colour spaces are steepest."""
    return {"color": strokes.color.round()}


def _far_windows(strokes: Strokes) -> Changes:
    """On the canvas, but with the middle of their windows 1e6 px away, where float32 has steps of 1/16 px."""
    near = 8 + 0.7 * strokes.position - FARTHEST
    points = {name: (near + 8 * getattr(strokes, name)) / 1000 for name in ("start", "control", "end")}
    place, side = torch.full_like(strokes.start, FARTHEST), torch.full_like(strokes.scale, 2000.0)
    return points | {"position": place, "scale": side, "width": 16 / 2000 * strokes.width}


SPACES = [plugin.name for plugin in plugins("color") if plugin.name != "rgb"]  # which all other scenes mix in
TARGETS: dict[str, Callable[[Size], Tensor]] = {
    "target 0": lambda size: torch.zeros(3, *size),
    "target 1": lambda size: torch.ones(3, *size),
    "target: checkerboard of pixels": _checkerboard,
    "target: one bright pixel": one_bright_pixel,
}
SCENES: dict[str, Recipe] = {
    "ordinary": Recipe(),
    "no strokes": Recipe(wanted=0),
    "one stroke": Recipe(lambda strokes: {"position": 0 * strokes.position + torch.tensor([18.0, 12.0])}, 1,
                         scale=(20.0, 24.0)),
    "10,000 on one pixel": Recipe(_on_one_pixel, 10_000, (2, 3), (2.0, 6.0)),
    "200 coincident": Recipe(_coincident, 200),
    "all transparent": Recipe(lambda strokes: {"opacity": 0 * strokes.opacity}),
    "all opaque": Recipe(lambda strokes: {"opacity": torch.ones_like(strokes.opacity)}),
    "length 0": Recipe(lambda strokes: {"control": strokes.start, "end": strokes.start}),
    "length 10,000 px": Recipe(_long),
    "width 0": Recipe(lambda strokes: {"width": 0 * strokes.width}),
    "width 1,000 px": Recipe(_thick, scale=(8000.0, 8000.0)),
    "1e6 px off the canvas": Recipe(lambda strokes: {"position": torch.where(strokes.start > 0, FARTHEST, -FARTHEST)}),
    "windows 1e6 px away": Recipe(_far_windows),
    "canvas 1 x 1": Recipe(canvas=(1, 1)),
    "canvas 8192 x 8": Recipe(wanted=2, canvas=(8, 8192), scale=(100.0, 4000.0)),
    **{f"pure colours in {space}": Recipe(_pure, color=space) for space in SPACES},
    **{name: Recipe(target=target) for name, target in TARGETS.items()},
}  # fmt: skip


def _uniform(seed: int) -> Callable[..., Tensor]:
    """Numbers in [0, 1), always the same ones."""
    generator = torch.Generator().manual_seed(seed)
    return lambda *shape: torch.rand(*shape, generator=generator)
