"""Helpers that compare blends with the dense blend in float64."""

from dataclasses import replace

import torch
from hypothesis import strategies as st
from scenes import random_strokes, straight, with_shapes
from torch import Tensor

from brushexp.plugins.blend.base import Canvas
from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.textured import Textured
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
    "from nothing": replace(straight((2, 3), (14, 9)), widening=torch.ones(1)),
    "to nothing": replace(straight((2, 3), (14, 9)), widening=-torch.ones(1)),
    "a point of two colours": replace(straight((8.3, 8.1), (8.3, 8.1)), drift=torch.tensor([[-0.5, 0.1, 0.5]])),
    "softer than the canvas": replace(straight((2, 3), (14, 9)), softness=torch.tensor([1e3])),
}

SCENES = st.fixed_dictionaries(
    {
        "n": st.integers(0, 40),
        "size": st.tuples(st.integers(1, 30), st.integers(1, 45)),
        "seed": st.integers(0, 10_000),
        "bend": st.sampled_from([0.0, 0.05, 0.15, 1.0, 3.0]),
        "thick": st.sampled_from([0.0, 0.05, 0.3, 1.0]),
        "shaped": st.booleans(),
    }
)


def paint(renderer, blend, strokes, size, *, order=None, target=None) -> Canvas:
    """Paint strokes, with the background and the target converted to the dtype of the strokes."""
    order = torch.arange(len(strokes)) if order is None else order
    dtype = strokes.position.dtype
    return blend(renderer(strokes), order, size, BACKGROUND.to(dtype), None if target is None else target.to(dtype))


def paint_with_gradient(renderer, blend, strokes, size, weight, *, order=None) -> tuple[Tensor, dict[str, Tensor]]:
    """Return the picture and the gradient of its weighted sum with respect to each field, both in float64."""
    leaves = strokes.map(lambda value: value.detach().clone().requires_grad_())
    if not strokes.drift.any():
        leaves = replace(leaves, drift=strokes.drift)  # strokes of one colour use separate kernels
    image = paint(renderer, blend, leaves, size, order=order).image
    (image * weight.to(image)).sum().backward()
    zero = {name: torch.zeros_like(value) for name, value in leaves.items()}
    return image.detach().double(), {n: (zero[n] if v.grad is None else v.grad).double() for n, v in leaves.items()}


def assert_agree(
    renderer, blend, strokes, size, fields=tuple(FIELDS), *, order=None, slack=1e-3, exactness=1e-4, dense=DENSE
):
    """Assert that a blend agrees with the float64 reference.

    The picture may differ by ``exactness`` (absolute), and each gradient by ``slack`` (relative).
    """
    weight = torch.randn(3, *size, generator=torch.Generator().manual_seed(0))
    image, gradient = paint_with_gradient(renderer, blend, strokes, size, weight, order=order)
    exact, slope = paint_with_gradient(renderer, dense, strokes.map(lambda v: v.double()), size, weight, order=order)
    torch.testing.assert_close(image, exact, atol=exactness, rtol=0)
    for name in fields:
        error, scale = (gradient[name] - slope[name]).norm(), slope[name].norm()
        assert error <= slack * scale + 1e-5 * weight.norm(), f"{name}: off by {error:.2g}, its gradient is {scale:.2g}"


def check_random_scene(renderer, blend, n, size, seed, bend, thick, shaped, fields=tuple(FIELDS)):
    # Where two points of a curve are equally near, a taper or texture jumps; slightly bent curves have no such points
    # nearby.
    textured = isinstance(renderer, Textured)
    bend = min(bend, 0.15) if textured or shaped or getattr(renderer, "taper", 0) else bend
    strokes = random_strokes(n, size, seed=seed, bend=bend, width=(0.0, thick))
    if shaped:
        strokes = with_shapes(strokes, seed)
    order = torch.randperm(n, generator=torch.Generator().manual_seed(seed))
    # At the edge of a texel, the slope of a bilinear lookup jumps, and a pixel may fall on either side. Across a narrow
    # stroke the texture itself is steep: a thousandth of a pixel is a few ten-thousandths of alpha.
    loose = {"slack": 3e-3, "exactness": 5e-4} if textured else {}
    assert_agree(renderer, blend, strokes, size, fields, order=order, **loose)


def check_accuracy(renderer, blend):
    strokes = with_shapes(random_strokes(30, (20, 33), bend=0.1))
    target, order = torch.rand(3, 20, 33), torch.randperm(30)
    strokes.position[3] = 500
    accuracy = paint(renderer, blend, strokes, (20, 33), order=order, target=target).accuracy
    exact = paint(renderer, DENSE, strokes.map(lambda v: v.double()), (20, 33), order=order, target=target).accuracy
    assert exact[3].isnan(), "nothing of this stroke is on the canvas"
    torch.testing.assert_close(accuracy.double(), exact, atol=1e-4, rtol=0, equal_nan=True)
    stroke = straight((4, 4), (12, 4), color=(1.0, 0.5, 0.0))
    accuracy = paint(Analytic(), blend, stroke, (8, 16), target=torch.zeros(3, 8, 16)).accuracy
    torch.testing.assert_close(accuracy, torch.tensor([1 - (1.0 + 0.25)]))


@torch.no_grad()
def check_importance(renderer, blend):
    """Check the importance that a blend computes for random strokes against the dense blend, and return the inputs."""
    size, strokes = (20, 29), with_shapes(random_strokes(25, (20, 29), bend=0.05))
    order, target, weight = torch.randperm(25), torch.rand(3, *size), torch.rand(size)
    layers = renderer(strokes)
    estimate = blend.importance(layers, order, size, BACKGROUND, target, weight)

    def error(chosen):
        image = DENSE(layers, chosen, size, BACKGROUND).image
        return (weight * (image - target).square()).double().sum()

    grown = torch.stack([error(order[order != i]) for i in range(25)]) - error(order)
    torch.testing.assert_close(estimate.double(), grown, atol=2e-3, rtol=1e-3)
    assert estimate.abs().max() > 0.1
    return layers, order, size, BACKGROUND, target, weight


def check_skipping(renderer, blend_of, strokes, size):
    exact = paint(renderer, DENSE, strokes, size).image
    for opaque in (1e-4, 0.1):
        image = paint(renderer, blend_of(opaque=opaque), strokes, size).image
        assert (image - exact).abs().max() <= opaque + 1e-4


def check_degenerate(renderer, blend, name):
    size, stroke, weight = (16, 19), DEGENERATE[name], torch.randn(3, 16, 19)
    image, gradient = paint_with_gradient(renderer, blend, stroke, size, weight)
    exact, slope = paint_with_gradient(renderer, DENSE, stroke.map(lambda v: v.double()), size, weight)
    # At the tip of a fold the curve nearly stands still, so the nearest point on it is less certain.
    assert ((image - exact).abs() > 1e-4).float().mean() <= (0.05 if name == "almost folded" else 0)
    for gradients in (gradient, slope):
        assert all(value.isfinite().all() and value.abs().max() < 1e4 for value in gradients.values())
    if name in ("zero width", "transparent", "off the canvas", "far off the canvas"):
        torch.testing.assert_close(image, BACKGROUND.double().view(3, 1, 1).expand(3, *size))
    elif isinstance(renderer, Analytic) and "folded" not in name:
        assert_agree(renderer, blend, stroke, size)


def check_edges(blend):
    for soft in (0.5, 6.0):
        assert_agree(Analytic(soft=soft), blend, random_strokes(30, (20, 33)), (20, 33))
