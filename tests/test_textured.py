"""`renderer=textured`: the reference has the right gradient, and the compiled kernels agree with it."""

from dataclasses import replace
from itertools import pairwise

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import leaves, random_strokes, straight

from brushexp.errors import UserError
from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.blend.tiled import Backend, Tiled
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import window_pictures
from brushexp.plugins.renderer.textured import Textured, unrolled
from brushexp.registry import build_named
from brushexp.strokes.catalogue import FIELDS, Strokes
from brushexp.strokes.prior import parameters_of, sample_prior
from brushexp.training.evaluation import squared_error

BACKGROUND = torch.tensor([0.2, 0.5, 0.9])
PAINTER = Textured(checkpoint=None).requires_grad_(False)  # as in painting: textures of 8 bits
DENSE, TILED = Dense(), Tiled(opaque=0.0)


def paint(blend, strokes, size, *, order=None, target=None, renderer=PAINTER):
    order = torch.arange(len(strokes)) if order is None else order
    dtype = strokes.position.dtype
    return blend(renderer(strokes), order, size, BACKGROUND.to(dtype), None if target is None else target.to(dtype))


def paint_with_gradient(blend, strokes, size, weight, **options):
    strokes = leaves(strokes, strokes.position.dtype)
    canvas = paint(blend, strokes, size, **options)
    (canvas.image * weight.to(canvas.image)).sum().backward()
    return canvas.image.detach().double(), {name: value.grad.double() for name, value in strokes.items()}


def assert_agree(strokes, size, **options):
    """Value to 1e-4, gradient to 1e-3 of its size, against the reference in float64.

    Beside the edge of a texel the derivative of a bilinear lookup jumps: a pixel may fall on either side. On random
    scenes such a pixel is one of very many, and the criterion holds all the same.
    """
    weight = torch.randn(3, *size)
    image, gradient = paint_with_gradient(TILED, strokes, size, weight, **options)
    exact, slope = paint_with_gradient(DENSE, strokes.map(lambda v: v.double()), size, weight, **options)
    torch.testing.assert_close(image, exact, atol=1e-4, rtol=0)
    for name in FIELDS:
        error, scale = (gradient[name] - slope[name]).norm(), slope[name].norm()
        assert error <= 1e-3 * scale + 1e-5 * weight.norm(), f"{name}: off by {error:.2g}, its gradient is {scale:.2g}"


@settings(max_examples=40, deadline=None)
@given(
    n=st.integers(0, 40),
    height=st.integers(1, 30),
    width=st.integers(1, 45),
    seed=st.integers(0, 10_000),
    bend=st.sampled_from([0.0, 0.05, 0.15]),  # where two points of a curve are equally near, the texture jumps
    thick=st.sampled_from([0.0, 0.05, 0.3, 1.0]),
)
def test_the_kernel_agrees_with_the_reference_on_random_scenes(n, height, width, seed, bend, thick):
    strokes = random_strokes(n, (height, width), seed=seed, bend=bend, width=(0.0, thick))
    order = torch.randperm(n, generator=torch.Generator().manual_seed(seed))
    assert_agree(strokes, (height, width), order=order)


def test_on_strongly_bent_strokes_they_differ_at_hardly_any_pixel():
    size, wrong = (40, 50), 0.0
    for seed in range(10):
        strokes = random_strokes(20, size, seed=seed, bend=3.0)
        exact = paint(DENSE, strokes.map(lambda v: v.double()), size).image
        wrong += float(((paint(TILED, strokes, size).image - exact).abs() > 1e-3).float().mean()) / 10
    assert wrong < 1e-3, "at a tie between two nearest points either may be taken"


def test_the_reference_has_the_right_gradient():
    renderer = Textured(variants=2, widths=3, rows=8, columns=6, checkpoint=None).double()
    strokes = random_strokes(3, (7, 9), bend=0.1, width=(0.05, 0.18), dtype=torch.float64)
    strokes = leaves(replace(strokes, position=strokes.position * 0.4 + 2.5), torch.float64)

    def image(textures, *values):
        layers = torch.func.functional_call(renderer, {"textures": textures}, (Strokes(*values),))
        return DENSE(layers, torch.arange(3), (7, 9), BACKGROUND.double()).image

    textures = renderer.textures.detach().clone().requires_grad_()
    assert torch.autograd.gradcheck(
        image, (textures, *(value for _, value in strokes.items())), atol=1e-5, fast_mode=True
    )


@pytest.mark.parametrize("blend", [DENSE, TILED, Tiled(opaque=0.0, kernel=Backend.torch)])
def test_accuracy_is_measured_in_the_same_pass(blend):
    strokes, target = random_strokes(30, (20, 33)), torch.rand(3, 20, 33)
    order = torch.randperm(30)
    accuracy = paint(blend, strokes, (20, 33), order=order, target=target).accuracy
    exact = paint(DENSE, strokes.map(lambda v: v.double()), (20, 33), order=order, target=target).accuracy
    assert exact.isnan().any(), "the scene should have a stroke off the canvas"
    torch.testing.assert_close(accuracy.double(), exact, atol=1e-4, rtol=0, equal_nan=True)


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


@pytest.mark.parametrize("kind", DEGENERATE)
def test_degenerate_strokes_have_a_picture_and_a_finite_gradient(kind):
    size, stroke = (16, 19), DEGENERATE[kind]
    weight = torch.randn(3, *size)
    image, gradient = paint_with_gradient(TILED, stroke, size, weight)
    exact, slope = paint_with_gradient(DENSE, stroke.map(lambda v: v.double()), size, weight)
    # At the tip of a fold the curve all but stands still: where on it the nearest point lies is not known so well.
    assert ((image - exact).abs() > 1e-4).float().mean() <= (0.05 if kind == "almost folded" else 0)
    for found in (gradient, slope):
        assert all(value.isfinite().all() for value in found.values())
        assert all(value.abs().max() < 1e4 for value in found.values()), "no pixel throws a stroke about"


@pytest.mark.parametrize("kind", ["zero width", "transparent", "off the canvas", "far off the canvas"])
def test_what_is_nowhere_paints_nothing(kind):
    image = paint(TILED, DEGENERATE[kind], (16, 19)).image
    torch.testing.assert_close(image, BACKGROUND.view(3, 1, 1).expand(3, 16, 19))


@pytest.mark.parametrize("kind", ["a point", "control at the start", "folded", "almost folded"])
def test_nothing_lies_beyond_the_reach_where_a_curve_stands_still(kind):
    layers = PAINTER(DEGENERATE[kind].map(lambda v: v.double()))
    t = torch.linspace(0, 1, 2000, dtype=torch.float64)
    curve = torch.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], -1) @ layers.curve[0]
    points = torch.rand(5000, 2, dtype=torch.float64) * 40 - 12
    alpha = layers.sample(torch.zeros(1, 1, dtype=torch.int64), points[None])[0][0, 0]
    beyond = torch.cdist(points, curve).min(1).values > layers.reach + 1e-3
    assert beyond.any()
    assert (alpha[beyond] == 0).all()
    assert (alpha > 0).any()


def test_thinner_strokes_fade_to_nothing():
    widths = torch.tensor([0.0, 0.05, 0.2, 0.8, 3.0])
    sums = [
        (paint(TILED, straight((4.2, 8.3), (30.1, 9.7), width=float(width)), (18, 34)).image - BACKGROUND.view(3, 1, 1))
        .abs()
        .sum()
        for width in widths
    ]
    assert sums[0] == 0
    assert all(a < b for a, b in pairwise(sums))


def test_a_number_has_one_look_in_any_batch_and_order():
    strokes, number = sample_prior(12), torch.arange(12)
    shuffled = torch.randperm(12)
    whole = window_pictures(PAINTER, parameters_of(strokes), 32, number)
    parts = window_pictures(PAINTER, parameters_of(strokes)[shuffled], 32, number[shuffled])
    torch.testing.assert_close(parts, whole[shuffled])
    one = parameters_of(strokes)[:1].expand(12, -1)
    looks = window_pictures(PAINTER, one, 32, number)
    assert torch.equal(looks[0], looks[PAINTER.variants])
    assert not torch.equal(looks[0], looks[1])


def test_painting_shows_what_was_trained_to_the_eye():
    renderer = Textured(checkpoint=None)
    parameters = parameters_of(sample_prior(24))
    trained = window_pictures(renderer.train(), parameters, 48)
    painted = window_pictures(renderer.eval().requires_grad_(False), parameters, 48)
    covered = [picture[:, 3:] * picture[:, :3] for picture in (trained, painted)]
    assert (trained - painted)[:, 3].abs().mean() < 2e-3
    assert (covered[0] - covered[1]).abs().mean() < 2e-3
    assert (trained - painted)[:, 3].abs().max() < 0.1


def test_painting_follows_the_weights():
    renderer = Textured(variants=2, widths=2, checkpoint=None).requires_grad_(False)
    stroke = straight((4, 8), (12, 9))
    before = paint(TILED, stroke, (16, 19), renderer=renderer).image
    renderer.textures[:, :, 0] = -20.0
    after = paint(TILED, stroke, (16, 19), renderer=renderer).image
    assert not torch.equal(before, after)
    torch.testing.assert_close(after, BACKGROUND.view(3, 1, 1).expand(3, 16, 19))


def test_while_textures_are_trained_the_gradient_reaches_them():
    renderer = Textured(checkpoint=None)
    paint(TILED, random_strokes(4, (16, 19)), (16, 19), renderer=renderer).image.square().sum().backward()
    assert renderer.textures.grad.abs().sum() > 0
    with pytest.raises(UserError, match=r"use blend\.kernel=auto"):
        paint(Tiled(kernel=Backend.numba), random_strokes(2, (8, 8)), (8, 8), renderer=renderer)


def test_a_few_steps_bring_the_textures_nearer_to_a_brush():
    renderer = Textured(variants=2, widths=2, rows=12, columns=8, checkpoint=None)
    truth = Textured(variants=3, widths=2, checkpoint=None).requires_grad_(False)
    parameters = parameters_of(sample_prior(16))
    goal, error = window_pictures(truth, parameters, 32), []
    optimizer = torch.optim.Adam(renderer.parameters(), lr=0.1)
    for _ in range(15):
        error.append((window_pictures(renderer, parameters, 32) - goal)[:, 3].square().mean())
        optimizer.zero_grad()
        error[-1].backward()
        optimizer.step()
    assert error[-1] < 0.7 * error[0]


def test_one_thread_and_two_give_the_same_bits():
    strokes, weight = random_strokes(100, (60, 70)), torch.randn(3, 60, 70)
    results = []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        results.append(paint_with_gradient(Tiled(), strokes, (60, 70), weight))
    torch.set_num_threads(1)
    assert torch.equal(results[0][0], results[1][0])
    assert all(torch.equal(results[0][1][name], results[1][1][name]) for name in FIELDS)


@pytest.mark.parametrize("opaque", [1e-4, 0.1])
def test_what_is_skipped_cannot_be_seen(opaque):
    strokes = random_strokes(300, (40, 40))
    exact = paint(DENSE, strokes, (40, 40)).image
    assert (paint(Tiled(opaque=opaque), strokes, (40, 40)).image - exact).abs().max() <= opaque + 1e-4


@pytest.mark.parametrize("options", [{"rows": 7}, {"variants": 0}, {"columns": 1000}, {"widths": -1}])
def test_textures_of_impossible_size_are_refused(options):
    with pytest.raises(UserError, match=r"renderer\.(rows|variants|columns|widths)=.*; (try|leave)"):
        Textured(checkpoint=None, **options)


def test_distilled_strokes_look_like_those_of_the_engine():
    engine = build_named("engine", "fluid", {"window": 128, "brushes": 2})
    renderer = Textured(variants=2, checkpoint=None)
    parameters = parameters_of(sample_prior(40, seed=4))
    truth = engine(parameters, seed=3).images

    def off() -> float:
        number = torch.arange(40)
        with torch.no_grad():
            return float(squared_error(window_pictures(renderer.eval(), parameters, 128, number), truth))

    before = off()
    renderer.distil(lambda parameters, first: engine(parameters, seed=3, first=first).images)
    assert off() < 0.4 * before
    assert off() < 2e-3


def test_a_texture_is_read_where_the_stroke_is():
    """A picture of an analytic stroke gives the texture of one: full in the middle, nothing beyond its sides."""
    parameters = torch.zeros(1, 10)
    parameters[0, 0], parameters[0, 4], parameters[0, 6] = -0.7, 0.7, 1.0
    picture = window_pictures(Analytic(soft=0.1), parameters, 256)[0]
    opacity = unrolled(picture, 0.2, 24, 56)[0].sigmoid()
    assert opacity[6:18, 14:42].min() > 0.98, "8 of 24 rows to either side are within the half width"
    assert opacity[:3].max() < 0.01
    assert opacity[-3:].max() < 0.01
    torch.testing.assert_close(opacity, opacity.flip(0), atol=0.05, rtol=0)
