"""Draw strokes while a network lays them."""

import torch
from torch import Tensor

from brushexp.plugins.blend.base import Compositor
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.color.rgb import Rgb
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.textured import Textured
from brushexp.strokes.catalogue import Strokes
from brushexp_predictor.decoding import Form

BLEND = Compositor(Tiled(), Rgb())
PLAIN, BRUSHED = Analytic(), Textured().requires_grad_(False)


def draw(form: Form, strokes: Strokes, size: tuple[int, int], background: Tensor) -> Tensor:
    """Draw strokes, the lowest first, as a picture (3, H, W), through the renderer that networks of a form learn by."""
    renderer = BRUSHED if form.brushed else PLAIN
    front_to_back = torch.arange(len(strokes) - 1, -1, -1, device=strokes.position.device)
    return BLEND(renderer(strokes), front_to_back, size, background).image
