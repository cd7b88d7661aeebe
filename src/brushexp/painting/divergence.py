"""Find the plugin that produced the first NaN or Inf, after a step without a finite result."""

import inspect
from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor

from brushexp.compositing.layers import Layers
from brushexp.plugin_errors import OURS
from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.registry import plugins
from brushexp.strokes.catalogue import Strokes


@torch.enable_grad()
def first_broken(painter: Any, strokes: Strokes, wrong: str | None) -> str:
    """What is not finite, with family and name of the plugin that made it.

    The last step of a `Painter` is taken again, part by part, with the ``strokes`` (N,) that moved in it; the loss
    ``wrong``, if any, gave no number then. What is finite now is told as far as it was seen then.
    """
    picture, losses = painter.picture, painter.components.losses
    renderer, blend = named("renderer", picture.renderer), named("blend", picture.blend.blend)
    moving = strokes.map(lambda value: value.detach().clone().requires_grad_())
    layers = picture.renderer(moving)
    if (number := broken_layer(layers, len(strokes))) is not None:
        return f"{renderer} makes stroke {number} of numbers that are not finite"
    above = torch.arange(len(strokes), device=strokes.width.device).flip(0)
    image = picture.blend(layers, above, picture.size, picture.background).image
    if not image.isfinite().all():
        return f"{blend} makes a picture that is not finite"
    if wrong is not None:
        return f"{named('loss', losses[wrong], wrong)} is {float(painter.terms[wrong])}"
    for name, loss in losses.items():
        if not gradient_is_finite(loss, PaintedView(image.detach(), picture.target, moving, focus=picture.focus)):
            return f"the gradient of {named('loss', loss, name)} is not finite"
    for who, inputs in ((blend, tensors_of(layers)), (renderer, [value for _, value in moving.items()])):
        if not all_finite(slopes(image.sum(), inputs)):
            return f"the gradient of {who} is not finite"
    return "the gradient is not finite"


def named(family: str, made: object, name: str = "") -> str:
    """An object of a family as messages name it: ``loss=mse``, of a user's plugin with its file."""
    plugin = next((one for one in plugins(family) if one.cls is type(made)), None)
    ours = plugin is None or plugin.cls.__module__.startswith(OURS)
    source = "" if ours else f" ({inspect.getsourcefile(type(made))})"
    return f"{family}={name or (plugin.name if plugin else type(made).__name__)}{source}"


def broken_layer(layers: Layers, count: int) -> int | None:
    """Number of the first of N strokes that is not finite in its tensors, or in what it shows along its curve."""
    index = torch.arange(count, device=layers.curve.device)
    shown = layers.sample(index[:, None], layers.curve) if layers.curve.isfinite().all() else ()
    fields = [value for value in tensors_of(layers) if len(value) == count]
    for value in (*fields, *shown):
        broken = ~value.detach().reshape(len(value), -1).isfinite().all(1)
        if broken.any():
            return int(broken.nonzero()[0])
    return None


def gradient_is_finite(loss: Loss, painting: PaintedView) -> bool:
    """Whether a loss has a finite gradient in the picture and the strokes of a ``painting`` of the whole canvas."""
    painting.image.requires_grad_()
    value = loss(painting)
    return not value.requires_grad or all_finite(slopes(value, [painting.image, painting.strokes.position]))


def tensors_of(layers: Layers) -> list[Tensor]:
    """The tensors of real numbers that layers are made of."""
    return [value for value in vars(layers).values() if isinstance(value, Tensor) and value.is_floating_point()]


def slopes(value: Tensor, inputs: list[Tensor]) -> Iterable[Tensor | None]:
    """Gradients of a value in those inputs on which it depends."""
    wanted = [one for one in inputs if one.requires_grad]
    return torch.autograd.grad(value, wanted, allow_unused=True, retain_graph=True) if value.requires_grad else ()


def all_finite(values: Iterable[Tensor | None]) -> bool:
    """Whether all numbers are; None stands for a gradient that is 0."""
    return all(value is None or bool(value.isfinite().all()) for value in values)
