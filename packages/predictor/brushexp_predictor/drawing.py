"""How strokes are drawn while a network lays them."""

import torch
from torch import Tensor

from brushexp.plugins.blend.base import Compositor
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.color.rgb import Rgb
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.strokes.catalogue import Strokes

PLAIN, BLEND = Analytic(), Compositor(Tiled(), Rgb())


def draw_plain(strokes: Strokes, size: tuple[int, int], background: Tensor) -> Tensor:
    """Draw strokes, the lowest first, as a picture (3, H, W), by the closed-form renderer."""
    front_to_back = torch.arange(len(strokes) - 1, -1, -1, device=strokes.position.device)
    return BLEND(PLAIN(strokes), front_to_back, size, background).image
