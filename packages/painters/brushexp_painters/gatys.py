"""The ``gatys`` painter: style transfer that optimises pixels."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import torch

from brushexp.contracts import FILE, above, at_least, build_named, one_of, register
from brushexp.contracts.families import PaintedView, Painter, PaintRequest, PaintState
from brushexp.contracts.pictures import NETWORKS
from brushexp.contracts.strokes import Strokes
from brushexp.contracts.tasks import PICTURE
from brushexp_painters._laying import PORTIONS, strokes_from_arrays


@register("painter", "gatys")
@dataclass(kw_only=True)
class Gatys(Painter):
    """Style transfer on a lattice of dots, whose colours are optimised to match features of the picture and of a style.

    Source: Gatys et al., 2016 (Image Style Transfer Using Convolutional Neural Networks). Gradient descent changes the
    colours of pixels to match the picture's features and the Gram matrices of the style's features.

    Unlike in the paper, each pixel is a dot with the soft edge of ``renderer``, so that canvas, catalogue and exports
    contain it; `pixels_per_stroke=1` makes one dot per pixel, and other values make larger dots, one per cell. The
    descent starts from the picture instead of noise, because the small bundled network does not recover colours from
    noise (`backbone=vgg16 weights=...` is closer to the paper), and uses Adam instead of L-BFGS. Without a style, the
    picture hardly changes.

    Args:
        style: painting whose style is transferred; null = the picture's own statistics.
        start: picture from which the descent starts: picture or noise.
        steps: number of Adam steps.
        lr: learning rate of the colours.
        content: weight of the loss on the picture's features.
        style_weight: weight of the loss on Gram matrices.
        backbone: feature network.
        weights: file with the network's weights; null = the weights in its package.
    """

    kind = "gradients, of features"
    author = "Gatys et al."
    differentiates = True

    style: Annotated[str | None, PICTURE] = None
    start: Annotated[str, one_of("picture", "noise")] = "picture"
    steps: Annotated[int, at_least(1)] = 100
    lr: Annotated[float, above(0, 1)] = 0.05
    content: Annotated[float, at_least(0)] = 1.0
    style_weight: Annotated[float, at_least(0)] = 3.0
    backbone: Annotated[str, one_of(*NETWORKS)] = "effl0"
    weights: Annotated[str | None, FILE] = None

    def __call__(self, request: PaintRequest) -> Iterator[PaintState]:
        dots = lattice_dots(request)
        if self.start == "noise":
            dots = replace(dots, color=torch.rand(dots.color.shape, generator=request.generator).to(dots.color))
        network = {"backbone": self.backbone, "weights": self.weights}
        content = build_named("loss", "perceptual", network).to(request.target.device)
        style = build_named("loss", "style", network | {"image": self.style}).to(request.target.device)
        color = dots.color.requires_grad_()
        optimizer = torch.optim.Adam([color], lr=self.lr)
        for step in range(1, self.steps + 1):
            view = PaintedView(request.draw(dots), request.target, dots)
            loss = self.content * 0.0015 * content(view) + self.style_weight / 3 * style(view)
            (color.grad,) = torch.autograd.grad(loss, color)
            optimizer.step()
            color.detach().clamp_(0, 1)
            if step * PORTIONS // self.steps > (step - 1) * PORTIONS // self.steps:
                yield PaintState(dots.map(lambda value: value.detach().clone()), step, self.steps)


def lattice_dots(request: PaintRequest) -> Strokes:
    """Make up to ``request.n`` dots on a lattice, each in the mean colour of its cell, in random order."""
    height, width = request.size
    rows = min(height, max(1, round(height / request.pitch)))
    columns = min(width, max(1, request.n // rows))
    rows = min(rows, request.n)
    cell_height, cell_width = height / rows, width / columns
    x, y = np.meshgrid((np.arange(columns) + 0.5) * cell_width, (np.arange(rows) + 0.5) * cell_height)
    middle = np.stack([x.ravel(), y.ravel()], 1)
    curves = np.repeat(middle[:, None], 3, 1)
    color = torch.nn.functional.adaptive_avg_pool2d(request.target.cpu(), (rows, columns)).flatten(1).T.numpy()
    strokes = strokes_from_arrays(curves, np.full(len(curves), np.hypot(cell_width, cell_height)), color, 1.0)
    order = torch.randperm(len(strokes), generator=request.generator)
    return strokes[order].map(lambda value: value.to(request.target))
