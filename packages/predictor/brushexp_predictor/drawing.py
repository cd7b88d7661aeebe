"""How strokes are drawn while a network lays them."""

import torch
from torch import Tensor

from brushexp.plugins.blend.base import Compositor
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.color.rgb import Rgb
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.renderer.textured import Textured
from brushexp.strokes.catalogue import Strokes
from brushexp_predictor.decoding import Form

BLEND = Compositor(Tiled(), Rgb())
PLAIN, BRUSHED = Analytic(), Textured().requires_grad_(False)


def renderer_of(form: Form) -> Renderer:
    """Return the renderer through which a network of that form learns, and by which it sees its canvas."""
    return BRUSHED if form.brushed else PLAIN


def draw(form: Form, strokes: Strokes, size: tuple[int, int], background: Tensor) -> Tensor:
    """Draw strokes, the lowest first, as a picture (3, H, W)."""
    front_to_back = torch.arange(len(strokes) - 1, -1, -1, device=strokes.position.device)
    return BLEND(renderer_of(form)(strokes), front_to_back, size, background).image
