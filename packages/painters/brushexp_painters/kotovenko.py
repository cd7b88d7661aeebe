"""The ``kotovenko`` painter: the parametrisation and losses of the paper that was published after the thesis."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import torch
from torch import Tensor

from brushexp.contracts import above, at_least, build_named, register
from brushexp.contracts.families import PaintedView, Painter, PaintRequest, PaintState
from brushexp.contracts.strokes import Catalogue
from brushexp.contracts.tasks import PICTURE
from brushexp_painters._laying import PORTIONS


@register("painter", "kotovenko")
@dataclass(kw_only=True)
class Kotovenko(Painter):
    """Strokes initialised by superpixels; shapes follow the picture's features, and colours only the style.

    Source: Kotovenko et al., 2021 (Rethinking Style Transfer: From Pixels to Parameterized Brushstrokes,
    arXiv:2103.17185), and its published code. The method optimises location, start, end, control, width and colour of
    each stroke, but neither depth nor opacity. SLIC initialises the strokes. The losses are content, Gram matrices,
    curvature and direction. Adam takes 100 steps, with separate learning rates for shapes, which minimise all losses,
    and for colours, which minimise only the style loss.

    Unlike in the paper, where each pixel belongs to the nearest stroke, strokes cover each other, with larger strokes
    below. Features come from the small bundled network; the weights keep the paper's ratios between the terms. The
    paper's second stage, which optimises pixels, is `painter=gatys`. Without a style, pixels are compared instead of
    features, and the colours also follow the pixels.

    Args:
        style: painting whose style is transferred; null = none.
        steps: number of Adam steps.
        lr: learning rate of the shape, in pixels per step.
        lr_color: learning rate of the colours.
        content: weight of the picture's features or, without a style, of its pixels.
        style_weight: weight of the Gram matrices.
        curvature: weight of the curvature loss.
        direction: weight of the difference in direction between neighbours.
    """

    kind = "gradients, of features and pixels"
    author = "Kotovenko et al."
    differentiates = True

    style: Annotated[str | None, PICTURE] = None
    steps: Annotated[int, at_least(1)] = 100
    lr: Annotated[float, above(0, 100)] = 0.1
    lr_color: Annotated[float, above(0, 1)] = 0.01
    content: Annotated[float, at_least(0)] = 1.0
    style_weight: Annotated[float, at_least(0)] = 3.0
    curvature: Annotated[float, at_least(0)] = 0.004
    direction: Annotated[float, at_least(0)] = 0.0008

    def __call__(self, request: PaintRequest) -> Iterator[PaintState]:
        slic = build_named("init", "slic", {})
        strokes = slic(request.target.cpu(), request.n, request.generator)
        area = strokes.width * (strokes.width + (strokes.end - strokes.start).norm(dim=1))
        strokes = strokes[area.argsort(descending=True)].map(lambda value: value.to(request.target))
        strokes = replace(strokes, opacity=torch.ones_like(strokes.opacity))
        pixel = 2 / float(strokes.scale[0])  # in half-windows, which `slic` makes equal for all strokes
        units = dict.fromkeys(("position", "start", "control", "end"), pixel) | {"width": pixel / 2, "color": 1.0}
        catalogue = Catalogue(strokes, units)
        shape = [value for name, value in catalogue.named_parameters() if name in units and name != "color"]
        colors = [value for name, value in catalogue.named_parameters() if name == "color"]
        optimizers = torch.optim.Adam(shape, lr=self.lr), torch.optim.Adam(colors, lr=self.lr_color)
        losses = self._losses(request.target.device)
        for step in range(1, self.steps + 1):
            strokes = catalogue()
            view = PaintedView(request.draw(strokes), request.target, strokes)
            terms = {name: weight * loss(view) for name, (weight, loss) in losses.items()}
            total = torch.stack(list(terms.values())).sum()
            for values, loss in ((colors, terms["style"] if self.style else total), (shape, total)):
                for value, gradient in zip(values, torch.autograd.grad(loss, values, retain_graph=True), strict=True):
                    value.grad = gradient
            for optimizer in optimizers:
                optimizer.step()
            catalogue.keep_in_range()
            if step * PORTIONS // self.steps > (step - 1) * PORTIONS // self.steps:
                yield PaintState(catalogue().map(Tensor.detach), step, self.steps)

    def _losses(self, device: torch.device) -> dict[str, tuple[float, torch.nn.Module]]:
        options = {"style": {"image": self.style}}
        weights = {"curvature": self.curvature, "direction": self.direction}
        if self.style is None:
            weights |= {"mse": self.content}
        else:
            weights |= {"perceptual": self.content * 0.0015, "style": self.style_weight / 3}
        return {
            name: (weight, build_named("loss", name, options.get(name, {})).to(device))
            for name, weight in weights.items()
        }
