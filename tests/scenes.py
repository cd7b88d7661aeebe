"""Random strokes for tests."""

import torch

from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import PatchRenderer, window_pictures
from brushexp.strokes.catalogue import Strokes


class Windowed(PatchRenderer):
    """A patch renderer without a network: analytic strokes, drawn in their windows."""

    window = 16

    def __init__(self, *, soft: float = 1.5) -> None:
        super().__init__()
        self.brush = Analytic(soft=soft)
        self.drawn = 0

    def draw(self, parameters: torch.Tensor) -> torch.Tensor:
        self.drawn += len(parameters)
        return window_pictures(self.brush, parameters, self.window)


def random_strokes(n, size, *, seed=0, bend=0.3, width=(0.02, 0.3), dtype=torch.float32) -> Strokes:
    """``n`` strokes on and around a canvas of ``size`` (H, W); ``bend`` is how far controls stray from the middle."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape):
        return torch.rand(*shape, generator=generator)

    start, end = uniform(n, 2) * 2 - 1, uniform(n, 2) * 2 - 1
    strokes = Strokes(
        position=(uniform(n, 2) * 1.4 - 0.2) * torch.tensor([size[1], size[0]]),
        scale=5 + 25 * uniform(n),
        start=start,
        control=(start + end) / 2 + bend * torch.randn(n, 2, generator=generator),
        end=end,
        width=width[0] + (width[1] - width[0]) * uniform(n),
        color=uniform(n, 3),
        opacity=uniform(n),
    )
    return strokes.map(lambda value: value.to(dtype))


def leaves(strokes: Strokes, dtype: torch.dtype = torch.float32) -> Strokes:
    """Copies that collect gradients."""
    return strokes.map(lambda value: value.detach().to(dtype).clone().requires_grad_())


def straight(start, end, *, width=4.0, color=(1.0, 0.0, 0.0), opacity=1.0) -> Strokes:
    """One straight stroke given in pixels."""
    points = torch.tensor([start, end], dtype=torch.float32)
    centre = points.mean(0)
    scale = max(float((points - centre).abs().max()) * 2, 8.0)
    ends = (points - centre) * 2 / scale
    points = {"start": ends[:1], "control": torch.zeros(1, 2), "end": ends[1:]}
    numbers = {"scale": scale, "width": width / scale, "color": color, "opacity": opacity}
    return Strokes(position=centre[None], **points, **{name: torch.tensor([v]) for name, v in numbers.items()})
