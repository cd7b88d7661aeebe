"""All blends agree with painting every stroke at every pixel, in value and gradient."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import leaves, random_strokes, straight

from brushexp.errors import UserError
from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.blend.tiled import Backend, Tiled
from brushexp.plugins.blend.topk import TopK
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.strokes.catalogue import FIELDS, Strokes

BACKGROUND = torch.tensor([0.2, 0.5, 0.9])
BLENDS = {
    "tiled": Tiled(opaque=0.0),
    "tiled in torch": Tiled(opaque=0.0, kernel=Backend.torch),
    "topk": TopK(k=10_000),
    "topk_all": TopK(k=None),
}


def paint(blend, strokes, size, *, soft=1.5, taper=0.0, order=None, target=None):
    """Picture of strokes in the dtype they have."""
    order = torch.arange(len(strokes)) if order is None else order
    layers = Analytic(soft=soft, taper=taper)(strokes)
    dtype = strokes.position.dtype
    return blend(layers, order, size, BACKGROUND.to(dtype), None if target is None else target.to(dtype))


def paint_with_gradient(blend, strokes, size, weight, **options):
    """Picture, accuracy, and the gradient of its weighted sum with respect to each field, in float64."""
    strokes = leaves(strokes, strokes.position.dtype)
    canvas = paint(blend, strokes, size, **options)
    (canvas.image * weight.to(canvas.image)).sum().backward()
    return canvas.image.detach().double(), {name: value.grad.double() for name, value in strokes.items()}


def assert_agree(blend, strokes, size, fields=tuple(FIELDS), **options):
    """Value to 1e-4, gradient to 1e-3 of its size, against the reference in float64."""
    weight = torch.randn(3, *size)
    image, gradient = paint_with_gradient(blend, strokes, size, weight, **options)
    exact, slope = paint_with_gradient(Dense(), strokes.map(lambda v: v.double()), size, weight, **options)
    torch.testing.assert_close(image, exact, atol=1e-4, rtol=0)
    for name in fields:
        error, scale = (gradient[name] - slope[name]).norm(), slope[name].norm()
        assert error <= 1e-3 * scale + 1e-5 * weight.norm(), f"{name}: off by {error:.2g}, its gradient is {scale:.2g}"


@pytest.mark.parametrize("name", BLENDS)
@settings(max_examples=25, deadline=None)
@given(
    n=st.integers(0, 40),
    height=st.integers(1, 30),
    width=st.integers(1, 45),
    seed=st.integers(0, 10_000),
    bend=st.sampled_from([0.0, 0.05, 0.3, 1.0, 3.0]),
    taper=st.sampled_from([0.0, 0.0, 0.5]),
    soft=st.sampled_from([0.5, 1.5, 6.0]),
    thick=st.sampled_from([0.0, 0.05, 0.3, 1.0]),
)
def test_blends_agree_on_random_scenes(name, n, height, width, seed, bend, taper, soft, thick):
    strokes = random_strokes(n, (height, width), seed=seed, bend=bend, width=(0.0, thick))
    order = torch.randperm(n, generator=torch.Generator().manual_seed(seed))
    # At a tie between two nearest points a tapered stroke jumps; only gently bent ones have none nearby.
    taper = taper if bend <= 0.3 else 0.0
    fields = FIELDS if name != "topk" or thick > 0 else ()  # topk drops empty layers, and with them their gradient
    assert_agree(BLENDS[name], strokes, (height, width), fields, order=order, taper=taper, soft=soft)


@pytest.mark.parametrize("taper", [0.0, 0.6])
def test_the_reference_has_the_right_gradient(taper):
    strokes = leaves(random_strokes(3, (5, 7), bend=0.1, dtype=torch.float64), torch.float64)

    def image(*values):
        return paint(Dense(), Strokes(*values), (5, 7), taper=taper).image

    assert torch.autograd.gradcheck(image, tuple(value for _, value in strokes.items()), atol=1e-5)


@pytest.mark.parametrize("name", BLENDS)
def test_accuracy_is_measured_in_the_same_pass(name):
    strokes, target = random_strokes(30, (20, 33)), torch.rand(3, 20, 33)
    order = torch.randperm(30)
    accuracy = paint(BLENDS[name], strokes, (20, 33), order=order, target=target).accuracy
    exact = paint(Dense(), strokes.map(lambda v: v.double()), (20, 33), order=order, target=target).accuracy
    assert exact.isnan().any(), "the scene should have a stroke off the canvas"
    torch.testing.assert_close(accuracy.double(), exact, atol=1e-4, rtol=0, equal_nan=True)


def test_accuracy_is_what_the_formula_says():
    stroke = straight((4, 4), (12, 4), color=(1.0, 0.5, 0.0))
    target = torch.zeros(3, 8, 16)
    accuracy = paint(Dense(), stroke, (8, 16), target=target).accuracy
    torch.testing.assert_close(accuracy, torch.tensor([1 - (1.0 + 0.25)]))


@pytest.mark.parametrize("opaque", [1e-4, 1 / 512, 0.1])
def test_what_is_skipped_cannot_be_seen(opaque):
    strokes = random_strokes(300, (40, 40))
    exact = paint(Dense(), strokes, (40, 40)).image
    image = paint(Tiled(opaque=opaque), strokes, (40, 40)).image
    assert (image - exact).abs().max() <= opaque + 1e-5


def test_topk_keeps_the_uppermost_strokes_that_are_there():
    top = straight((0, 4), (16, 4), color=(1.0, 0.0, 0.0), opacity=0.5)
    elsewhere = straight((0, 40), (16, 40), color=(0.0, 0.0, 1.0))
    under = straight((0, 4), (16, 4), color=(0.0, 1.0, 0.0))
    strokes = Strokes.join(top, elsewhere, under)
    one = paint(TopK(k=1), strokes, (8, 16)).image[:, 4, 8]
    two = paint(TopK(k=2), strokes, (8, 16)).image[:, 4, 8]
    torch.testing.assert_close(one, 0.5 * top.color[0] + 0.5 * BACKGROUND)
    torch.testing.assert_close(two, 0.5 * top.color[0] + 0.5 * under.color[0])


def test_one_thread_and_two_give_the_same_bits():
    strokes, weight = random_strokes(200, (60, 70)), torch.randn(3, 60, 70)
    results = []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        results.append(paint_with_gradient(Tiled(), strokes, (60, 70), weight))
    torch.set_num_threads(1)
    assert torch.equal(results[0][0], results[1][0])
    assert all(torch.equal(results[0][1][name], results[1][1][name]) for name in FIELDS)


@pytest.mark.parametrize("name", BLENDS)
def test_no_strokes_leave_the_bare_canvas(name):
    image = paint(BLENDS[name], Strokes.none(), (9, 13)).image
    torch.testing.assert_close(image, BACKGROUND.view(3, 1, 1).expand(3, 9, 13))


@pytest.mark.parametrize("name", BLENDS)
@pytest.mark.parametrize("size", [(1, 1), (3, 5), (8, 8), (9, 17)])
def test_small_canvases_work(name, size):
    assert_agree(BLENDS[name], random_strokes(12, size), size)


DEGENERATE = {
    "a point": straight((8, 8), (8, 8)),
    "zero width": straight((2, 3), (14, 9), width=0.0),
    "off the canvas": straight((500, 500), (520, 510)),
    "far off the canvas": straight((-1e5, 3), (-1e5, 9)),
    "transparent": straight((2, 3), (14, 9), opacity=0.0),
    "opaque": straight((2, 3), (14, 9), opacity=1.0),
    "larger than the canvas": straight((-200, 8), (300, 9), width=90.0),
}


@pytest.mark.parametrize("name", BLENDS)
@pytest.mark.parametrize("kind", DEGENERATE)
def test_degenerate_strokes_have_a_picture_and_a_finite_gradient(name, kind):
    weight = torch.randn(3, 16, 19)
    image, gradient = paint_with_gradient(BLENDS[name], DEGENERATE[kind], (16, 19), weight)
    assert image.isfinite().all()
    assert all(value.isfinite().all() for value in gradient.values())
    empty = kind in ("zero width", "transparent")
    assert_agree(BLENDS[name], DEGENERATE[kind], (16, 19), () if empty and name == "topk" else tuple(FIELDS))


def test_zero_width_and_transparent_strokes_paint_nothing():
    for kind in ("zero width", "transparent", "off the canvas"):
        image = paint(Tiled(), DEGENERATE[kind], (16, 19)).image
        torch.testing.assert_close(image, BACKGROUND.view(3, 1, 1).expand(3, 16, 19))


def test_a_point_is_a_disc_with_a_soft_edge():
    image = paint(Tiled(), straight((8, 8), (8, 8), width=6.0), (16, 16), soft=1.0).image[1]
    y, x = torch.meshgrid(torch.arange(16) + 0.5, torch.arange(16) + 0.5, indexing="ij")
    z = (3 - ((x - 8) ** 2 + (y - 8) ** 2).sqrt() + 0.5).clamp(0, 1)
    torch.testing.assert_close(image, 0.5 * (1 - z * z * (3 - 2 * z)), atol=1e-5, rtol=0)


def test_fifty_thousand_strokes_on_one_spot():
    n, opacity = 50_000, 1e-4
    one = straight((2, 3), (14, 9), opacity=opacity)
    image, gradient = paint_with_gradient(
        Tiled(), one.map(lambda v: v.expand(n, *v.shape[1:]).clone()), (16, 16), torch.randn(3, 16, 16)
    )
    painted = paint(Dense(), one.map(lambda v: v.double()), (16, 16)).image
    alpha = (painted[1] - BACKGROUND[1]) / -BACKGROUND[1]  # the stroke has no green
    light = torch.exp(n * torch.log1p(-alpha))
    exact = one.color[0].double().view(3, 1, 1) * (1 - light) + BACKGROUND.double().view(3, 1, 1) * light
    torch.testing.assert_close(image, exact, atol=1e-3, rtol=0)  # 50,000 roundings of the transmittance
    assert all(value.isfinite().all() for value in gradient.values())


def test_the_numba_kernel_refuses_what_it_cannot_do():
    with pytest.raises(UserError, match=r"use blend\.kernel=auto"):
        paint(Tiled(kernel=Backend.numba), random_strokes(2, (8, 8), dtype=torch.float64), (8, 8))


def test_dense_refuses_what_would_not_fit_into_memory():
    strokes = random_strokes(10_000, (1000, 1000))
    with pytest.raises(UserError, match="use blend=tiled"):
        paint(Dense(), strokes, (1000, 1000))
