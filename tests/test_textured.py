"""`renderer=textured`: the reference has the right gradient, and the compiled kernels agree with it."""

from copy import deepcopy
from dataclasses import replace
from itertools import pairwise

import pytest
import torch
from brushexp_training.evaluation import squared_error
from kernels import BACKGROUND, DEGENERATE, DENSE, paint
from scenes import leaves, random_strokes, straight
from torch.nn import functional

from brushexp.compositing.textures import Loop, sheets_of
from brushexp.errors import UserError
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import window_pictures
from brushexp.plugins.renderer.textured import STRETCH, Textured, close_loop, double_textures, unroll_stroke
from brushexp.registry import build_named
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.prior import parameters_of, sample_prior

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
    renderer = Textured(variants=2, rows=16, columns=32, checkpoint=None).double()
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


def test_a_brush_has_one_look_in_any_batch_and_order():
    parameters, shuffled = parameters_of(sample_prior(12)), torch.randperm(12)
    whole, parts = (window_pictures(PAINTER, parameters[n], 32, n) for n in (torch.arange(12), shuffled))
    torch.testing.assert_close(parts, whole[shuffled])
    looks = window_pictures(PAINTER, parameters[:1].expand(17, -1), 32)
    assert torch.equal(looks[0], looks[2 * PAINTER.variants])
    assert not torch.equal(looks[0], looks[1])
    assert not torch.equal(looks[0], looks[PAINTER.variants]), "turned over"


def test_painting_shows_what_was_trained_to_the_eye():
    renderer = Textured(checkpoint=None)
    parameters = parameters_of(sample_prior(24))
    trained = window_pictures(renderer.train(), parameters, 48)
    frozen = window_pictures(renderer.eval().requires_grad_(False), parameters, 48)
    covered = [picture[:, 3:] * picture[:, :3] for picture in (trained, frozen)]
    assert (trained - frozen)[:, 3].abs().mean() < 2e-3
    assert (covered[0] - covered[1]).abs().mean() < 2e-3
    assert (trained - frozen)[:, 3].abs().max() < 0.1


def test_painting_follows_the_weights_and_training_reaches_them():
    renderer, size = Textured(variants=2, checkpoint=None), (16, 19)
    stroke = straight((4, 8), (12, 9))
    image_of(TILED, stroke, size, renderer).square().sum().backward()
    assert renderer.textures.grad.abs().sum() > 0
    with pytest.raises(UserError, match=r"use blend\.kernel=auto"):
        image_of(Tiled(kernel="numba"), stroke, size, renderer)
    before = image_of(TILED, stroke, size, renderer.requires_grad_(False))
    renderer.textures[:, 0] = -20.0
    after = image_of(TILED, stroke, size, renderer)
    assert not torch.equal(before, after)
    torch.testing.assert_close(after, BARE.expand(3, *size))


def test_renderers_of_the_same_weights_share_their_textures_and_these_are_as_made_afresh():
    first, other = (Textured(variants=3, checkpoint=None).requires_grad_(False) for _ in range(2))
    stroke = straight((4, 8), (12, 9))
    shared = first(stroke).sheets
    assert other(stroke).sheets is shared
    copied = deepcopy(first)
    assert copied(stroke).sheets is shared
    assert copied.double()(stroke).sheets.texels.dtype == torch.float64
    parts = first.textures[:, 0].sigmoid(), first.textures[:, 1].tanh(), first.textures[:, 2].sigmoid()
    finer = double_textures(torch.stack(parts, dim=1), first.loop)
    afresh = sheets_of(finer, first.levels, Loop(192, 192), rounded=True)
    for name, value in vars(afresh).items():
        torch.testing.assert_close(getattr(shared, name), value, rtol=0, atol=0)
    other.textures[0, 0, 5] = 3.0
    assert other(stroke).sheets is not shared
    assert first(stroke).sheets is shared


def line(length, width, number=0, zoom=1.0):
    """A level stroke (1,) in pixels, from x = 20 on, in the middle of 40 rows."""
    stroke = straight((20 * zoom, 20 * zoom), ((20 + length) * zoom, 20 * zoom), width=width * zoom)
    return PAINTER(replace(stroke, brush=torch.tensor([number])))


def test_a_longer_stroke_has_more_of_the_pattern_and_its_ends_stay():
    repeats = [int(line(length, 8.0).repeats) for length in (10, 30, 60, 120, 240)]
    assert repeats[:2] == [0, 0]
    assert all(a < b for a, b in pairwise(repeats[1:]))
    pictures = []
    for length in (120, 240):
        layers = line(length, 8.0)
        y, x = torch.meshgrid(torch.arange(8, 33, 0.5), torch.arange(10.0, length + 31, 0.5), indexing="ij")
        points = torch.stack([x.flatten(), y.flatten()], dim=1)[None]
        pictures.append(layers.sample(torch.zeros(1, 1, dtype=torch.int64), points)[0].view(y.shape))
    texel = [length / float(line(length, 8.0).frame()[0, 3]) for length in (120, 240)]
    assert texel[0] == pytest.approx(texel[1], rel=0.1), "no longer texels on a longer stroke"
    for ends in ([p[:, :40] for p in pictures], [p[:, -40:] for p in pictures]):
        assert (ends[0] - ends[1]).abs().mean() < 0.02
    assert [float(p[:, :10].amax()) for p in pictures] == pytest.approx([0, 0], abs=0.3), "little before the start"


@pytest.mark.parametrize("length", [3, 20, 47, 90, 400])
def test_a_texture_goes_through_beginning_loop_and_end_without_a_seam(length):
    """Along a stroke, each column of the texture comes where the loop says; what follows itself is smooth."""
    wave = torch.sin(2 * torch.pi * torch.arange(96.0) / 96)
    columns = torch.cat([0.3 + 0.3 * torch.arange(96.0) / 96, 0.6 + 0.3 * wave, 0.6 - 0.3 * torch.arange(64.0) / 64])
    textures = torch.stack([columns, 0 * columns, columns])[None, :, None].expand(1, 3, 96, 256)
    layers = replace(line(length, 8.0), look=torch.zeros(1, dtype=torch.int64))
    layers = replace(layers, sheets=sheets_of(textures, 1, Loop(96, 96), rounded=False))
    x = torch.linspace(20.5, 19.5 + length, 2000)
    points = torch.stack([x, torch.full_like(x, 20.0)], dim=1)[None]
    opacity = layers.sample(torch.zeros(1, 1, dtype=torch.int64), points)[0][0, 0]
    assert opacity.diff().abs().max() < 0.05
    tops = ((opacity[1:-1] > opacity[:-2]) & (opacity[1:-1] >= opacity[2:]) & (opacity[1:-1] > 0.85)).sum()
    assert tops == layers.repeats[0]


def test_smaller_textures_are_the_means_of_larger_ones():
    textures = torch.rand(2, 3, 16, 32)
    sheets = sheets_of(textures, 3, Loop(12, 12), rounded=False)
    small = sheets.texels[sheets.first[4] :][: (8 + 2) * (16 + 2)].view(10, 18, 3)[1:-1, 1:-1]
    quarters = textures[1].view(3, 8, 2, 16, 2).permute(1, 3, 0, 2, 4).flatten(3)
    inner = small[1:-1, 5:-5]
    torch.testing.assert_close(inner[..., 0], quarters[1:-1, 5:-5, 0].mean(-1))
    counted = (quarters[1:-1, 5:-5, 1] * quarters[1:-1, 5:-5, 0]).mean(-1) / quarters[1:-1, 5:-5, 0].mean(-1)
    torch.testing.assert_close(inner[..., 1], counted)
    assert sheets.size.tolist() == [[16, 32], [8, 16], [4, 8]] * 2
    assert sheets.loop[1].tolist() == [6, 6]


def test_a_texture_in_twice_its_size_is_the_same_with_finer_detail_where_it_has_some():
    rows = torch.sin(torch.arange(32.0) * 2.2)[:, None]
    textures = (0.5 + 0.3 * rows * torch.ones(3, 32, 64))[None].clone()
    textures[:, :, :, 48:] = 0.5  # smooth
    large = double_textures(textures, Loop(16, 16))
    assert large.shape == (1, 3, 64, 128)
    smooth = functional.interpolate(textures, scale_factor=2, mode="bilinear")
    large, smooth, textures = large[:, :2], smooth[:, :2], textures[:, :2]
    assert functional.avg_pool2d(large - smooth, 8).abs().max() < 0.08, "as light on the whole"
    finest = (large - functional.interpolate(functional.avg_pool2d(large, 2), scale_factor=2, mode="bilinear")).square()
    coarse = functional.interpolate(functional.avg_pool2d(smooth, 2), scale_factor=2, mode="bilinear")
    assert finest[..., 8:88].mean() > 10 * (smooth - coarse)[..., 8:88].square().mean()
    assert (large - smooth)[..., 112:].abs().max() < 1e-6


def test_distilled_strokes_look_like_those_of_the_engine():
    engine = build_named("engine", "fluid", {"window": 64, "brushes": 2})
    renderer = Textured(variants=2, checkpoint=None)
    parameters = parameters_of(sample_prior(20, seed=4))
    truth = engine(parameters, seed=3).images

    @torch.no_grad()
    def off() -> float:
        return float(squared_error(window_pictures(renderer.eval(), parameters, 64), truth))

    before = off()
    renderer.distil(lambda parameters, first: engine(parameters, seed=3, first=first))
    assert off() < 0.8 * before
    tone, height = (part.detach() for part in (renderer.textures[:, 1].tanh(), renderer.textures[:, 2].sigmoid()))
    assert tone.std() > 0.01
    assert abs(float(tone.mean())) < 0.05, "no light: as much paler as darker"
    assert height.amax((1, 2)).min() > 0.9


def test_a_texture_is_read_where_the_stroke_is():
    parameters = torch.zeros(1, 10)
    parameters[0, 0], parameters[0, 4], parameters[0, 6] = -STRETCH, STRETCH, 1.0
    opacity = unroll_stroke(window_pictures(Analytic(soft=0.1), parameters, 256)[0, 3:], 0.2, 24, 66)[0]
    assert opacity[6:18, 8:58].min() > 0.98, "8 of 24 rows to either side are within the half width"
    assert opacity[:3].max() < 0.01
    torch.testing.assert_close(opacity, opacity.flip(0), atol=0.05, rtol=0)


def test_a_loop_follows_itself_and_the_end_follows_it():
    texels = torch.cumsum(torch.rand(2, 6, 64), dim=2)
    loop = Loop(24, 24)
    result = close_loop(texels, loop)
    torch.testing.assert_close(result[..., :36], texels[..., :36])
    torch.testing.assert_close(result[..., 47], texels[..., 23])
    torch.testing.assert_close(result[..., 48], texels[..., 24])
    torch.testing.assert_close(result[..., 56:], texels[..., 56:])


def test_textures_too_short_for_their_ends_are_refused():
    with pytest.raises(UserError, match=r"renderer.columns=64 leaves no room .*=128; set renderer.columns=96 or more"):
        Textured(rows=128, columns=64, checkpoint=None)
    pictures = window_pictures(
        Textured(variants=1, rows=128, columns=96, checkpoint=None), parameters_of(sample_prior(3)), 64
    )
    assert bool((pictures[:, 3].flatten(1).amax(1) > 0.5).all())
