"""Engine plugin in a single file: ``task=simulate engine=marker``."""

from typing import Annotated

import torch
from torch import Tensor

from brushexp.contracts import above, between, register
from brushexp.contracts.families import Engine, Simulated
from brushexp.contracts.strokes import closest_parameter, point_at, strokes_of


@register("engine", "marker")
class Marker(Engine):
    """Simulates a felt-tip pen: even ink with a soft rim.

    Args:
        window: side of a picture in pixels.
        rim: width of the soft rim in pixels.
    """

    def __init__(
        self, *, window: Annotated[int, between(8, 512)] = 64, rim: Annotated[float, above(0, 8)] = 1.0
    ) -> None:
        self.window = window
        self.rim = rim

    @torch.no_grad()
    def __call__(self, parameters: Tensor, *, seed: int, first: int = 0) -> Simulated:
        strokes = strokes_of(parameters.double().clamp(-10, 10))  # all finite values are drawn
        curve = torch.stack([strokes.start, strokes.control, strokes.end], dim=1)  # (n, 3, 2) half-windows
        middle = 2 * (torch.arange(self.window) + 0.5) / self.window - 1  # centres of pixels in half-windows
        y, x = torch.meshgrid(middle, middle, indexing="ij")
        points = torch.stack([x, y], dim=-1).reshape(1, -1, 2).double()
        t = closest_parameter(curve[:, None], points)  # (n, S * S)
        distance = (point_at(curve[:, None], t) - points).norm(dim=-1)
        half = strokes.width[:, None].clamp_min(0)  # half a width in windows is the width in half-windows
        alpha = (0.5 + 0.5 * self.window * (half - distance) / self.rim).clamp(0, 1)
        alpha = alpha.reshape(-1, 1, self.window, self.window).float()
        color = strokes.color.clamp(0, 1).float()[:, :, None, None].expand(-1, -1, self.window, self.window)
        return Simulated(images=torch.cat([color, alpha], dim=1), heights=alpha[:, 0])
