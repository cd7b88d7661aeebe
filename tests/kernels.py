"""What a blend makes of strokes, and how far it may be from every stroke at every pixel in float64."""

from dataclasses import replace

import torch
from scenes import straight
from torch import Tensor

from brushexp.plugins.blend.base import Canvas
from brushexp.plugins.blend.dense import Dense
from brushexp.strokes.catalogue import FIELDS

BACKGROUND = torch.tensor([0.2, 0.5, 0.9])
DENSE = Dense()
DEGENERATE = {
    "a point": straight((8.3, 8.1), (8.3, 8.1)),
    "almost a point": straight((8.3, 8.1), (8.32, 8.1)),
    "zero width": straight((2, 3), (14, 9), width=0.0),
    "off the canvas": straight((500, 500), (520, 510)),
    "far off the canvas": straight((-1e5, 3), (-1e5, 9)),
    "transparent": straight((2, 3), (14, 9), opacity=0.0),
    "opaque": straight((2, 3), (14, 9), opacity=1.0),
    "larger than the canvas": straight((-200, 8), (300, 9), width=90.0),
    "through the centres of pixels": straight((2.5, 8.5), (14.5, 8.5)),
    "control at the start": replace(straight((4, 8), (12, 9)), control=straight((4, 8), (12, 9)).start),
    "folded": replace(straight((4, 8), (9, 8)), control=torch.tensor([[1.9, 0.0]])),
    "almost folded": replace(straight((4, 8), (9, 8)), control=torch.tensor([[1.9, 0.01]])),
}


def paint(renderer, blend, strokes, size, *, order=None, target=None) -> Canvas:
    """Picture of strokes in the dtype they have."""
    order = torch.arange(len(strokes)) if order is None else order
    dtype = strokes.position.dtype
    return blend(renderer(strokes), order, size, BACKGROUND.to(dtype), None if target is None else target.to(dtype))


def paint_with_gradient(renderer, blend, strokes, size, weight, *, order=None) -> tuple[Tensor, dict[str, Tensor]]:
    """Picture, and the gradient of its weighted sum with respect to each field, in float64."""
    leaves = strokes.map(lambda value: value.detach().clone().requires_grad_())
    image = paint(renderer, blend, leaves, size, order=order).image
    (image * weight.to(image)).sum().backward()
    zero = {name: torch.zeros_like(value) for name, value in leaves.items()}
    return image.detach().double(), {n: (zero[n] if v.grad is None else v.grad).double() for n, v in leaves.items()}


def assert_agree(
    renderer, blend, strokes, size, fields=tuple(FIELDS), *, order=None, slack=1e-3, exactness=1e-4, dense=DENSE
):
    """Value to ``exactness``, gradient to ``slack`` of its size, against the reference in float64."""
    weight = torch.randn(3, *size, generator=torch.Generator().manual_seed(0))
    image, gradient = paint_with_gradient(renderer, blend, strokes, size, weight, order=order)
    exact, slope = paint_with_gradient(renderer, dense, strokes.map(lambda v: v.double()), size, weight, order=order)
    torch.testing.assert_close(image, exact, atol=exactness, rtol=0)
    for name in fields:
        error, scale = (gradient[name] - slope[name]).norm(), slope[name].norm()
        assert error <= slack * scale + 1e-5 * weight.norm(), f"{name}: off by {error:.2g}, its gradient is {scale:.2g}"
