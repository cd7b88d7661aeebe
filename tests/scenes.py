"""Strokes for tests, and a patch renderer that draws them without a network."""

from dataclasses import replace

import torch
from brushexp_testing.families import some_strokes as random_strokes  # noqa: F401
from brushexp_testing.families import with_gradients as leaves  # noqa: F401

from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import PatchRenderer, window_pictures
from brushexp.strokes.catalogue import Strokes


class Windowed(PatchRenderer):
    """A patch renderer that draws analytic strokes in windows instead of calling a network."""

    window = 16

    def __init__(self, *, soft: float = 1.5) -> None:
        super().__init__()
        self.brush = Analytic(soft=soft)
        self.drawn = 0

    def draw(self, parameters: torch.Tensor) -> torch.Tensor:
        self.drawn += len(parameters)
        return window_pictures(self.brush, parameters, self.window)


def straight(start, end, *, width=4.0, color=(1.0, 0.0, 0.0), opacity=1.0) -> Strokes:
    """Make one straight stroke, with its ends and width in pixels."""
    points = torch.tensor([start, end], dtype=torch.float32)
    centre = points.mean(0)
    scale = max(float((points - centre).abs().max()) * 2, 8.0)
    ends = (points - centre) * 2 / scale
    points = {"start": ends[:1], "control": torch.zeros(1, 2), "end": ends[1:]}
    numbers = {"scale": scale, "width": width / scale, "color": color, "opacity": opacity}
    return Strokes(position=centre[None], **points, **{name: torch.tensor([v]) for name, v in numbers.items()})


def with_shapes(strokes: Strokes, seed: int = 0) -> Strokes:
    """Give strokes random softness, widening and colour drift."""
    draws = torch.rand(5, len(strokes), generator=torch.Generator().manual_seed(seed)).to(strokes.position)
    return replace(strokes, softness=0.5 * draws[0], widening=2 * draws[1] - 1, drift=draws[2:].T - 0.5)
