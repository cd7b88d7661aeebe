"""Find the plugin that produced the first NaN or Inf in a step whose result is not finite."""

from typing import Any

import torch
from torch import Tensor

from brushexp.compositing.layers import Layers
from brushexp.plugins.loss.base import PaintedView
from brushexp.registry.blame import name_member
from brushexp.strokes.catalogue import Strokes


@torch.enable_grad()
def find_non_finite(painter: Any, strokes: Strokes, wrong: str | None) -> str:
    """Repeat the last step with its N ``strokes``; describe the first non-finite result, and name the plugin at fault.

    ``wrong`` is the name of the loss that was not finite in the last step, or None.
    """
    picture, losses = painter.picture, painter.components.losses
    renderer, blend = name_member("renderer", picture.renderer), name_member("blend", picture.blend.blend)
    moving = strokes.map(lambda value: value.detach().clone().requires_grad_())
    layers = picture.renderer(moving)
    if (number := find_non_finite_stroke(layers, len(strokes))) is not None:
        return f"{renderer} draws stroke {number} with numbers that are not finite"
    above = torch.arange(len(strokes), device=strokes.width.device).flip(0)
    image = picture.blend(layers, above, picture.size, picture.background).image
    if not image.isfinite().all():
        return f"{blend} makes a picture that is not finite"
    if wrong is not None:
        return f"{name_member('loss', losses[wrong], wrong)} is {float(painter.terms[wrong])}"
    for name, loss in losses.items():
        view = PaintedView(image.detach().requires_grad_(), picture.target, moving, focus=picture.focus)
        if not has_finite_gradient(loss(view), [view.image, moving.position]):
            return f"the gradient of {name_member('loss', loss, name)} is not finite"
    for who, inputs in ((blend, tensors_of(layers)), (renderer, [value for _, value in moving.items()])):
        if not has_finite_gradient(image.sum(), inputs):
            return f"the gradient of {who} is not finite"
    return "the gradient is not finite"


def find_non_finite_stroke(layers: Layers, count: int) -> int | None:
    """Return the index of the first stroke with a non-finite field or sample along its curve; None if there is none."""
    index = torch.arange(count, device=layers.curve.device)
    samples = layers.sample(index[:, None], layers.curve) if layers.curve.isfinite().all() else ()
    fields = [value for value in tensors_of(layers) if len(value) == count]
    for value in (*fields, *samples):
        broken = ~value.detach().reshape(len(value), -1).isfinite().all(1)
        if broken.any():
            return int(broken.nonzero()[0])
    return None


def tensors_of(layers: Layers) -> list[Tensor]:
    """List the floating-point tensors among the fields of layers."""
    return [value for value in vars(layers).values() if isinstance(value, Tensor) and value.is_floating_point()]


def has_finite_gradient(value: Tensor, inputs: list[Tensor]) -> bool:
    """Check whether the gradient of a value is finite with respect to all inputs on which it depends."""
    inputs = [one for one in inputs if one.requires_grad]
    slopes = torch.autograd.grad(value, inputs, allow_unused=True, retain_graph=True) if value.requires_grad else ()
    return all(slope is None or bool(slope.isfinite().all()) for slope in slopes)
