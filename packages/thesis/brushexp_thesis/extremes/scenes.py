"""Define extreme scenes, each with strokes, a canvas and a target. Import this module after all plugins are loaded.

All strokes are random with a fixed seed, in float32, and within the ranges of `strokes.catalogue.FIELDS`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import normalize

from brushexp.contracts import plugins
from brushexp.contracts.layers import Size
from brushexp.contracts.strokes import FARTHEST_POSITION, Strokes

# Height and width of canvases, which are not square and not multiples of a tile.
CANVAS, SMALL = (24, 37), (16, 25)
MIDDLE = (18.0, 12.0)  # x and y of the canvas's middle
USUAL_RATE = 0.02

Fields = dict[str, Tensor]  # fields of strokes by name


def _uniform(seed: int) -> Callable[..., Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return lambda *shape: torch.rand(*shape, generator=generator)


def random_strokes(n: int, size: Size, *, scale: tuple[float, float] = (8.0, 24.0)) -> Strokes:
    """Sample ``n`` slightly curved strokes on a canvas of ``size`` (H, W), with windows of ``scale`` pixels."""
    draw = _uniform(0)
    angle = 2 * math.pi * draw(n)
    end = (0.3 + 0.4 * draw(n))[:, None] * torch.stack([angle.cos(), angle.sin()], dim=1)
    return Strokes(
        position=draw(n, 2) * torch.tensor([size[1], size[0]]),
        scale=scale[0] + (scale[1] - scale[0]) * draw(n),
        start=-end,
        control=0.1 * (draw(n, 2) - 0.5),
        end=end,
        width=0.05 + 0.15 * draw(n),
        color=draw(n, 3),
        opacity=0.1 + 0.8 * draw(n),
    )


def random_target(size: Size) -> Tensor:
    """Sample a target (3, H, W) whose pixels are independent."""
    return _uniform(1)(3, *size)


def one_bright_pixel(size: Size) -> Tensor:
    """Return a target (3, H, W) that is 1 at its middle pixel and 0 elsewhere."""
    target = torch.zeros(3, *size)
    target[:, size[0] // 2, size[1] // 2] = 1
    return target


@dataclass(frozen=True)
class Scene:
    """Random strokes on a canvas, with window sizes in the range ``scale`` and some fields replaced by ``change``."""

    change: Callable[[Strokes], Fields] = lambda strokes: {}
    n: int = 16
    canvas: Size = CANVAS
    scale: tuple[float, float] = (8.0, 24.0)
    target: Callable[[Size], Tensor] = random_target
    color: str = "rgb"  # colour space in which strokes mix
    steps: int = 0  # number of Adam steps; 0 draws one picture
    rate: float = USUAL_RATE
    parts: Mapping[str, tuple[str, dict[str, Any]]] = field(default_factory=dict)  # other components: family -> plugin
    growth: int = 1  # factor by which the number of strokes may grow
    focus: Callable[[Size], Tensor] | None = None  # (H, W), weights of pixels with mean 1

    def strokes(self, most: int) -> Strokes:
        """Return the strokes, at most ``most`` of them: a network draws a thousand times more slowly than a formula."""
        strokes = random_strokes(min(most, self.n), self.canvas, scale=self.scale)
        return replace(strokes, **self.change(strokes))


def _within_one_pixel(strokes: Strokes) -> Fields:
    """Place all strokes within one pixel of a 2 x 3 canvas, with opacities so low that the bottom one stays visible."""
    n, draw = len(strokes), _uniform(2)
    return {"position": torch.tensor([1.0, 0.0]) + draw(n, 2), "opacity": min(1, 10 / n) * draw(n)}


def _coincident(strokes: Strokes) -> Fields:
    """Make all strokes coincide, in different colours."""
    n, one = len(strokes), random_strokes(1, CANVAS, scale=(20.0, 24.0))
    same = {name: value.expand(n, *value.shape[1:]).clone() for name, value in one.items()}
    middle = torch.tensor(MIDDLE).expand(n, 2).clone()
    return same | {"position": middle, "color": strokes.color, "opacity": 0.1 * strokes.opacity}


def _long(strokes: Strokes) -> Fields:
    """Return strokes of ordinary thickness that are 10,000 px long and cross the canvas."""
    end, side = 0.7 * normalize(strokes.end), 1e4 / 1.4
    bend, width = 1e-2 * strokes.control, 3 / side * (1 + strokes.opacity)
    return {"scale": torch.full_like(width, side), "start": -end, "end": end, "control": bend, "width": width}


def _thick(strokes: Strokes) -> Fields:
    """Return strokes that are 1,000 px thick and whose edges cross the canvas."""
    aside = torch.tensor([0.0, 500.0]) * torch.where(strokes.opacity > 0.5, 1.0, -1.0)[:, None]
    end = torch.tensor([0.5, 0.0]).repeat(len(strokes), 1)
    width = torch.full_like(strokes.width, 1000 / 8000)
    return {"position": strokes.position + aside, "start": -end, "control": 0 * end, "end": end, "width": width}


def _far_off(strokes: Strokes) -> dict[str, Tensor]:
    return {"position": torch.where(strokes.start > 0, FARTHEST_POSITION, -FARTHEST_POSITION)}


def _far_windows(strokes: Strokes) -> Fields:
    """Move the windows of strokes 1e6 px away while the strokes themselves stay on the canvas.

    At that distance, float32 has a resolution of 1/16 px.
    """
    near = 8 + 0.7 * strokes.position - FARTHEST_POSITION
    points = {name: (near + 8 * getattr(strokes, name)) / 1000 for name in ("start", "control", "end")}
    position, scale = torch.full_like(strokes.start, FARTHEST_POSITION), torch.full_like(strokes.scale, 2000.0)
    return points | {"position": position, "scale": scale, "width": 16 / 2000 * strokes.width}


SPACES = [plugin.name for plugin in plugins("color") if plugin.name != "rgb"]  # all other scenes mix in rgb
TARGETS: dict[str, Callable[[Size], Tensor]] = {
    "target 0": lambda size: torch.zeros(3, *size),
    "target 1": lambda size: torch.ones(3, *size),
    "target: checkerboard of pixels": lambda size: (torch.ones(3, *size).cumsum(1) + torch.arange(size[1]) - 1) % 2,
    "target: one bright pixel": one_bright_pixel,
}
ONE_PICTURE = {
    "ordinary": Scene(),
    "no strokes": Scene(n=0),
    "one stroke": Scene(lambda s: {"position": torch.tensor([MIDDLE])[: len(s)]}, 1, scale=(20.0, 24.0)),
    "10,000 on one pixel": Scene(_within_one_pixel, 10_000, (2, 3), (2.0, 6.0)),
    "200 coincident": Scene(_coincident, 200),
    "all transparent": Scene(lambda s: {"opacity": 0 * s.opacity}),
    "all opaque": Scene(lambda s: {"opacity": torch.ones_like(s.opacity)}),
    "length 0": Scene(lambda s: {"control": s.start, "end": s.start}),
    "length 10,000 px": Scene(_long),
    "width 0": Scene(lambda s: {"width": 0 * s.width}),
    "width 1,000 px": Scene(_thick, scale=(8000.0, 8000.0)),
    "1e6 px off the canvas": Scene(_far_off),
    "windows 1e6 px away": Scene(_far_windows),
    "canvas 1 x 1": Scene(canvas=(1, 1)),
    "canvas 8192 x 8": Scene(n=2, canvas=(8, 8192), scale=(100.0, 4000.0)),
    **{f"pure colours in {space}": Scene(lambda s: {"color": s.color.round()}, color=space) for space in SPACES},
    **{name: Scene(target=target) for name, target in TARGETS.items()},
}
_steps = partial(Scene, n=8, canvas=SMALL, steps=30)
MANY_STEPS = {
    "learning rate x 100": _steps(steps=60, rate=100 * USUAL_RATE),
    "1,000 steps": _steps(steps=1000),
    "parts of the canvas": _steps(parts={"sampler": ("patches", {"n_active": 2, "n_ring": 1, "patch": 9})}),
    "strokes that come and go": _steps(parts={"density": ("adaptive", {"rounds": 3, "moved": 0.5})}, growth=4),
    "focus on one pixel": _steps(focus=lambda size: one_bright_pixel(size)[0] * size[0] * size[1]),
    **{f"mixing in {space}": _steps(target=TARGETS["target 0"], color=space) for space in SPACES},
    **{name: _steps(target=target) for name, target in TARGETS.items()},
}
KINDS = {"one picture": ONE_PICTURE, "many steps": MANY_STEPS}
