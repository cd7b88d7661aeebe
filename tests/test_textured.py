"""`renderer=textured`: the reference has the right gradient, and the compiled kernels agree with it."""

from dataclasses import replace
from itertools import pairwise

import pytest
import torch
from kernels import BACKGROUND, DEGENERATE, DENSE, paint
from scenes import leaves, random_strokes, straight

from brushexp.errors import UserError
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import window_pictures
from brushexp.plugins.renderer.textured import Textured, unrolled
from brushexp.registry import build_named
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.prior import parameters_of, sample_prior
from brushexp.training.evaluation import squared_error

PAINTER = Textured(checkpoint=None).requires_grad_(False)  # as in painting: textures of 8 bits
TILED = Tiled(opaque=0.0)
BARE = BACKGROUND.view(3, 1, 1)


def image_of(blend, strokes, size, renderer=PAINTER):
    return paint(renderer, blend, strokes, size).image


def test_on_strongly_bent_strokes_they_differ_at_hardly_any_pixel():
    size, wrong = (40, 50), 0.0
    for seed in range(5):
        strokes = random_strokes(20, size, seed=seed, bend=3.0)
        exact = image_of(DENSE, strokes.map(lambda v: v.double()), size)
        wrong += float(((image_of(TILED, strokes, size) - exact).abs() > 1e-3).float().mean()) / 5
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
    lines = [straight((4.2, 8.3), (30.1, 9.7), width=width) for width in (0.0, 0.05, 0.2, 0.8, 3.0)]
    sums = [(image_of(TILED, line, (18, 34)) - BARE).abs().sum() for line in lines]
    assert sums[0] == 0
    assert all(a < b for a, b in pairwise(sums))


def test_a_number_has_one_look_in_any_batch_and_order():
    parameters, shuffled = parameters_of(sample_prior(12)), torch.randperm(12)
    whole, parts = (window_pictures(PAINTER, parameters[n], 32, n) for n in (torch.arange(12), shuffled))
    torch.testing.assert_close(parts, whole[shuffled])
    looks = window_pictures(PAINTER, parameters[:1].expand(12, -1), 32)
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


def test_painting_follows_the_weights_and_training_reaches_them():
    renderer, size = Textured(variants=2, widths=2, checkpoint=None), (16, 19)
    stroke = straight((4, 8), (12, 9))
    image_of(TILED, stroke, size, renderer).square().sum().backward()
    assert renderer.textures.grad.abs().sum() > 0
    with pytest.raises(UserError, match=r"use blend\.kernel=auto"):
        image_of(Tiled(kernel="numba"), stroke, size, renderer)
    before = image_of(TILED, stroke, size, renderer.requires_grad_(False))
    renderer.textures[:, :, 0] = -20.0
    after = image_of(TILED, stroke, size, renderer)
    assert not torch.equal(before, after)
    torch.testing.assert_close(after, BARE.expand(3, *size))


def test_distilled_strokes_look_like_those_of_the_engine():
    engine = build_named("engine", "fluid", {"window": 64, "brushes": 2})
    renderer = Textured(variants=2, checkpoint=None)
    parameters = parameters_of(sample_prior(20, seed=4))
    truth = engine(parameters, seed=3).images

    @torch.no_grad()
    def off() -> float:
        return float(squared_error(window_pictures(renderer.eval(), parameters, 64), truth))

    before = off()
    renderer.distil(lambda parameters, first: engine(parameters, seed=3, first=first).images)
    assert off() < 0.4 * before
    assert off() < 2e-3


def test_a_texture_is_read_where_the_stroke_is():
    parameters = torch.zeros(1, 10)
    parameters[0, 0], parameters[0, 4], parameters[0, 6] = -0.7, 0.7, 1.0
    picture = window_pictures(Analytic(soft=0.1), parameters, 256)[0]
    opacity = unrolled(picture, 0.2, 24, 56)[0].sigmoid()
    assert opacity[6:18, 14:42].min() > 0.98, "8 of 24 rows to either side are within the half width"
    assert opacity[:3].max() < 0.01
    assert opacity[-3:].max() < 0.01
    torch.testing.assert_close(opacity, opacity.flip(0), atol=0.05, rtol=0)
