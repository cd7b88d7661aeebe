"""Tests that blends and compiled kernels match the dense blend in value, gradient and importance."""

from copy import deepcopy
from dataclasses import replace
from enum import IntEnum
from itertools import pairwise

import numpy as np
import pytest
import torch
from brushexp_policies.topk import TopK
from brushexp_training.evaluation.evaluation import squared_error
from dabs import DabRenderer
from hypothesis import given, settings
from kernels import (
    BACKGROUND,
    DEGENERATE,
    DENSE,
    SCENES,
    assert_agree,
    check_accuracy,
    check_degenerate,
    check_edges,
    check_importance,
    check_random_scene,
    check_skipping,
    paint,
    paint_with_gradient,
)  # fmt: skip
from refusals import refuses
from scenes import leaves, random_strokes, straight, with_shapes
from torch import nn
from torch.nn import functional

from brushexp.compat.compiled import Compiled, function, inline
from brushexp.compositing.textures import Loop, sheets_of
from brushexp.compositing.tile_lists import tile_lists
from brushexp.compositing.windows import Windows
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import Renderer, window_pictures
from brushexp.plugins.renderer.textured import STRETCH, Textured, close_loop, double_textures, unroll_stroke
from brushexp.registry import build_named
from brushexp.strokes.bezier import strokes_along
from brushexp.strokes.catalogue import FIELDS, Strokes
from brushexp.strokes.prior import parameters_of, sample_prior
from brushexp.system.runtime import share

BLENDS = {
    "tiled": Tiled(opaque=0.0, kernel="numba"),
    "tiled in torch": Tiled(opaque=0.0, kernel="torch"),
    "topk": TopK(k=10_000),
}
TILED = BLENDS["tiled"]


class Noise(Renderer):
    """A renderer that draws noise windows in a network's format; each stroke's brush selects its window."""

    def __init__(self, side: int = 16) -> None:
        super().__init__()
        images = torch.rand(40, 4, side, side, generator=torch.Generator().manual_seed(0))
        self.images = nn.Parameter(images, requires_grad=False)

    def forward(self, strokes):
        images = self.images[strokes.brush % 40].to(strokes.position)
        return Windows(images, strokes.position, strokes.scale, strokes.opacity, strokes.color)


KINDS = {  # a renderer for every kind of layer
    "plain": Analytic(soft=1.5),
    "tapered": Analytic(soft=1.5, taper=0.5),
    "textured": Textured(checkpoint=None).requires_grad_(False),  # as in painting: textures of 8 bits
    "windows": Noise(),
    "dabs": DabRenderer(),
}
# The first is drawn by every blend; the others show that a blend accepts any kind of layer.
PAIRS = [*(("plain", blend) for blend in BLENDS), *((kind, "tiled") for kind in list(KINDS)[1:])]
PAIRS += [("windows", "tiled in torch")]


@pytest.mark.parametrize(("kind", "blend"), PAIRS)
@settings(max_examples=12, deadline=None)
@given(scene=SCENES)
def test_blends_agree_on_random_scenes(kind, blend, scene):
    # topk drops empty layers, and their gradient with them
    fields = FIELDS if blend != "topk" or scene["thick"] > 0 else ()
    check_random_scene(KINDS[kind], BLENDS[blend], **scene, fields=fields)


@pytest.mark.parametrize(("kind", "blend"), PAIRS)
def test_accuracy_is_measured_in_the_same_pass(kind, blend):
    check_accuracy(KINDS[kind], BLENDS[blend])


@pytest.mark.parametrize("kind", KINDS)
def test_importance_is_what_the_error_grows_by_without_a_stroke_and_what_is_skipped_cannot_be_seen(kind):
    arguments = check_importance(KINDS[kind], TILED)
    for blend in (BLENDS["tiled in torch"], DENSE, TopK(k=4)):
        assert blend.importance(*arguments) is None, "a blend without a kernel leaves importance to others"
    strokes, size, weight, results = random_strokes(200, (32, 32)), (32, 32), torch.randn(3, 32, 32), []
    check_skipping(KINDS[kind], Tiled, strokes, size)
    for threads in (1, 2):
        torch.set_num_threads(threads)
        image, gradient = paint_with_gradient(KINDS[kind], Tiled(), strokes, size, weight)
        results.append([image, *gradient.values()])
    torch.set_num_threads(1)
    assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))


def test_edges_of_any_width_agree_a_point_is_a_soft_disc_and_gradients_of_shapes_are_right():
    strokes = with_shapes(random_strokes(3, (7, 9), bend=0.1, width=(0.1, 0.3), dtype=torch.float64))
    names, numbers = zip(*leaves(strokes, torch.float64).items(), strict=True)

    def picture(*numbers):
        return paint(KINDS["plain"], DENSE, Strokes(**dict(zip(names, numbers, strict=True))), (7, 9)).image

    assert torch.autograd.gradcheck(picture, numbers, atol=1e-5)
    check_edges(TILED)
    image = paint(Analytic(soft=1.0), Tiled(), straight((8, 8), (8, 8), width=6.0), (16, 16)).image[1]
    y, x = torch.meshgrid(torch.arange(16) + 0.5, torch.arange(16) + 0.5, indexing="ij")
    z = (3 - ((x - 8) ** 2 + (y - 8) ** 2).sqrt() + 0.5).clamp(0, 1)
    torch.testing.assert_close(image, 0.5 * (1 - z * z * (3 - 2 * z)), atol=1e-5, rtol=0)


def test_colours_drift_along_a_stroke_in_range_and_topk_keeps_the_uppermost_strokes_that_are_there():
    stroke = straight((2, 4), (30, 4), width=6, color=(0.5, 0.9, 0.0))
    stroke = replace(stroke, drift=torch.tensor([[0.25, 0.5, 0.5]]))
    row = paint(Analytic(), TILED, stroke, (8, 32)).image[:, 4, 2:30]
    torch.testing.assert_close(row[0], torch.linspace(0.25, 0.75, 28), atol=0.02, rtol=0)
    torch.testing.assert_close(row[1], torch.linspace(0.8, 1.0, 28), atol=0.01, rtol=0)
    assert not row[2].any(), "black has no room"
    top = straight((0, 4), (16, 4), color=(1.0, 0.0, 0.0), opacity=0.5)
    elsewhere = straight((0, 40), (16, 40), color=(0.0, 0.0, 1.0))
    under = straight((0, 4), (16, 4), color=(0.0, 1.0, 0.0))
    strokes = Strokes.join(top, elsewhere, under)
    one, two = (paint(Analytic(), TopK(k=k), strokes, (8, 16)).image[:, 4, 8] for k in (1, 2))
    torch.testing.assert_close(one, 0.5 * top.color[0] + 0.5 * BACKGROUND)
    torch.testing.assert_close(two, 0.5 * top.color[0] + 0.5 * under.color[0])


@pytest.mark.parametrize("blend", ["tiled", "tiled in torch"])
@pytest.mark.parametrize("kind", ["plain", "textured"])
@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_strokes_have_a_picture_and_a_finite_gradient(blend, kind, name):
    check_degenerate(KINDS[kind], BLENDS[blend], name)


def test_fifty_thousand_strokes_on_one_spot_are_one_and_what_a_blend_cannot_do_is_refused():
    n, opacity, plain = 50_000, 1e-4, Analytic(soft=1.5)
    one = straight((2, 3), (14, 9), opacity=opacity)
    many = one[torch.zeros(n, dtype=torch.long)]
    image, gradient = paint_with_gradient(plain, Tiled(), many, (16, 16), torch.randn(3, 16, 16))
    single = paint(plain, DENSE, one.map(lambda v: v.double()), (16, 16)).image
    alpha = (single[1] - BACKGROUND[1]) / -BACKGROUND[1]  # the stroke has no green
    light = torch.exp(n * torch.log1p(-alpha))
    exact = one.color[0].double().view(3, 1, 1) * (1 - light) + BACKGROUND.double().view(3, 1, 1) * light
    torch.testing.assert_close(image, exact, atol=1e-3, rtol=0)  # 50,000 roundings of the transmittance
    assert all(value.isfinite().all() for value in gradient.values())
    refuses(r"use blend\.kernel=auto", paint, Analytic(), TILED, random_strokes(2, (8, 8), dtype=torch.float64), (8, 8))
    refuses("use blend=tiled", paint, Analytic(), DENSE, random_strokes(10_000, (1000, 1000)), (1000, 1000))


PLACES = {
    "pixel by pixel": ((16.001, 12.001), 16.0),  # not exactly: at a kink the slope is ambiguous
    "half as large": ((16.0, 12.0), 8.0),
    "between pixels": ((13.3, 7.9), 21.7),
    "over the edge": ((-3.0, 24.0), 20.0),
    "far off the canvas": ((-1e5, 12.0), 20.0),
    "larger than the canvas": ((15.0, 11.0), 300.0),
    "less than a pixel": ((15.2, 11.4), 0.3),
}


@pytest.mark.parametrize("side", [1, 7, 16])
@pytest.mark.parametrize(("centre", "scale"), PLACES.values(), ids=PLACES)
def test_the_gradient_reaches_the_pictures_of_windows(centre, scale, side):
    pictures = torch.rand(2, 4, side, side)
    pictures[1, 3] = 0  # below a window that is almost empty
    pictures[1, 3, -1, 0] = 1
    weight, results = torch.randn(3, 24, 33), []
    for blend, dtype in ((TILED, torch.float32), (DENSE, torch.float64)):
        images = pictures.to(dtype, copy=True).requires_grad_()
        position, size = torch.tensor([centre, (15.3, 9.1)]).to(dtype), torch.tensor([scale, 30.0]).to(dtype)
        layers = Windows(images, position, size, torch.full((2,), 0.7, dtype=dtype), torch.zeros(2, 3, dtype=dtype))
        image = blend(layers, torch.arange(2), (24, 33), BACKGROUND.to(dtype)).image
        (image * weight.to(dtype)).sum().backward()
        shows = pictures[:, 3:] > 0
        results += [image.detach().double(), torch.where(shows, images.grad, 0).double()]
    torch.testing.assert_close(results[0], results[2], atol=1e-4, rtol=0)
    torch.testing.assert_close(results[1], results[3], atol=1e-3, rtol=1e-3)


def test_tiles_where_a_window_shows_nothing_are_not_listed():
    images = torch.rand(1, 4, 16, 16)
    images[0, 3, :, 4:] = 0
    layers = Windows(images, torch.full((1, 2), 32.0), torch.tensor([63.5]), torch.ones(1), torch.zeros(1, 3))
    order = torch.zeros(1, dtype=torch.long)
    assert 0 < len(tile_lists(*layers.compiled().boxes, order, (64, 64), boxes_only=True).stroke) <= 3 * 8
    assert len(tile_lists(layers.curve, layers.reach, order, (64, 64)).stroke) == 64
    turned = replace(layers, images=images.to(memory_format=torch.channels_last))
    assert not turned.images.is_contiguous(), "pictures may lie in memory as they like"
    assert torch.equal(*(TILED(kind, order, (64, 64), BACKGROUND).image for kind in (layers, turned)))


part, twice, thrice = inline(lambda x: x), inline(lambda x: 2 * x), inline(lambda x: 3 * x)


@function
def apply(values):
    for k in range(len(values)):
        values[k] = part(values[k])


@function
def mix(begin, end, values, sums):
    for i in range(begin, end):
        own, total = np.empty(64, np.float32), np.float32(0)
        for k in range(64):
            own[k] = values[i, k] * np.float32(0.37)
        for k in range(64):
            x = values[i, k]
            total += ((x * np.float32(1.1) + np.float32(0.3)) * x + own[k]) * x / (np.float32(1) + abs(x))
        sums[i] = total


def test_parts_make_kernels_of_their_own_which_other_processes_find_again_and_load(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))
    values = np.random.default_rng(0).standard_normal((99, 64)).astype(np.float32)
    first, second = np.empty(99, np.float32), np.empty(99, np.float32)
    for sums in (first, second):  # a second object knows nothing of the first, like one in another process
        again = Compiled(mix.function, {})
        share(again, 99, values, sums)
        assert len(again.dispatcher.stats.cache_hits if sums is second else again.dispatcher.stats.cache_misses) == 1
    assert first.tobytes() == second.tobytes()
    values, names = np.ones(3), set()
    for choice in (twice, thrice, twice):
        chosen = apply.with_parts(part=choice)
        chosen(values)
        names.add(chosen.dispatcher.py_func.__qualname__)
    assert values.tolist() == [12.0] * 3
    assert len(names) == 2, "machine code is kept under a name for each choice of parts"
    texts = [compile("def listed(n): return [(k, 0.5) for k in range(n)]", __file__, "exec") for _ in range(2)]
    scopes = [{"__name__": __name__} for _ in texts]
    for text, scope in zip(texts, scopes, strict=True):
        exec(text, scope)
    names = {function(scope["listed"]).dispatcher.py_func.__qualname__ for scope in scopes}
    assert len(names) == 1, "its code lies elsewhere in memory each time"


class Column(IntEnum):
    LENGTH = 0
    WIDTH = 2


@function
def area(table):
    return table[1, Column.LENGTH] * table[1, Column.WIDTH] * len(Column)


def test_columns_named_by_an_enumeration_are_numbers_whose_change_is_noticed(monkeypatch):
    table = np.arange(1.0, 7.0).reshape(2, 3)
    before = Compiled(area.function, {})
    assert before(table) == 4 * 6 * 2
    monkeypatch.setitem(globals(), "Column", IntEnum("Column", {"LENGTH": 1, "WIDTH": 2}))
    after = Compiled(area.function, {})
    assert after(table) == 5 * 6 * 2
    assert before.dispatcher.py_func.__qualname__ != after.dispatcher.py_func.__qualname__


PAINTER = Textured(checkpoint=None).requires_grad_(False)  # as in painting: textures of 8 bits
AUTO = Tiled(opaque=0.0)  # drawn by PyTorch while textures are trained
BARE = BACKGROUND.view(3, 1, 1)


def image_of(blend, strokes, size, renderer=PAINTER):
    return paint(renderer, blend, strokes, size).image


def test_strongly_bent_strokes_differ_at_hardly_any_pixel_and_thinner_ones_fade_to_nothing():
    size, wrong = (40, 50), 0.0
    for seed in range(5):
        strokes = random_strokes(20, size, seed=seed, bend=3.0)
        exact = image_of(DENSE, strokes.map(lambda v: v.double()), size)
        wrong += float(((image_of(AUTO, strokes, size) - exact).abs() > 1e-3).float().mean()) / 5
    assert wrong < 1e-3, "at a tie between two nearest points either may be taken"
    lines = [straight((4.2, 8.3), (30.1, 9.7), width=width) for width in (0.0, 0.05, 0.2, 0.8, 3.0)]
    sums = [(image_of(AUTO, line, (18, 34)) - BARE).abs().sum() for line in lines]
    assert sums[0] == 0
    assert all(a < b for a, b in pairwise(sums))


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


def test_a_brush_has_one_look_in_any_batch_and_order():
    parameters, shuffled = parameters_of(sample_prior(12)), torch.randperm(12)
    whole, parts = (window_pictures(PAINTER, parameters[n], 32, n) for n in (torch.arange(12), shuffled))
    torch.testing.assert_close(parts, whole[shuffled])
    looks = window_pictures(PAINTER, parameters[:1].expand(17, -1), 32)
    assert torch.equal(looks[0], looks[2 * PAINTER.variants])
    assert not torch.equal(looks[0], looks[1])
    assert not torch.equal(looks[0], looks[PAINTER.variants]), "turned over"


def test_painting_shows_what_was_trained_to_the_eye_and_follows_the_weights():
    renderer = Textured(checkpoint=None)
    parameters = parameters_of(sample_prior(24))
    trained = window_pictures(renderer.train(), parameters, 48)
    frozen = window_pictures(renderer.eval().requires_grad_(False), parameters, 48)
    covered = [picture[:, 3:] * picture[:, :3] for picture in (trained, frozen)]
    assert (trained - frozen)[:, 3].abs().mean() < 2e-3
    assert (covered[0] - covered[1]).abs().mean() < 2e-3
    assert (trained - frozen)[:, 3].abs().max() < 0.1
    renderer, size = Textured(variants=2, checkpoint=None), (16, 19)
    stroke = straight((4, 8), (12, 9))
    image_of(AUTO, stroke, size, renderer).square().sum().backward()
    assert renderer.textures.grad.abs().sum() > 0
    refuses(r"use blend\.kernel=auto", image_of, Tiled(kernel="numba"), stroke, size, renderer)
    before = image_of(AUTO, stroke, size, renderer.requires_grad_(False))
    renderer.textures[:, 0] = -20.0
    after = image_of(AUTO, stroke, size, renderer)
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


def test_a_tone_of_its_own_makes_bristles_and_furrows_as_much_fainter_and_changes_nothing_else():
    stroke = straight((4, 8), (12, 9))
    full, half, none = (
        Textured(variants=2, tone=tone, checkpoint=None).requires_grad_(False)(stroke).sheets.texels
        for tone in (1.0, 0.5, 0.0)
    )
    torch.testing.assert_close(half[:, 1], 0.5 * full[:, 1], atol=0.15, rtol=0)  # detail is clamped to -1 .. 1
    assert half[:, 1].std() == pytest.approx(0.5 * float(full[:, 1].std()), rel=0.1)
    assert not none[:, 1].any()
    assert half[:, 2].std() == pytest.approx(0.5 * float(full[:, 2].std()), rel=0.15)
    assert none[:, 2].std() < 0.01
    for texels in (half, none):
        assert torch.equal(texels[:, 0], full[:, 0])


def line(length, width, number=0, zoom=1.0):
    """Return the layers (1,) of a horizontal stroke that starts at x = 20 pixels, in the middle of 40 rows."""
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
    """Opacity changes smoothly along the stroke and peaks once per repeat of the loop."""
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


@pytest.mark.parametrize("offset", [-1.3, -0.3, -0.1, 0.07, 1.2])
def test_pixels_that_see_only_the_end_of_a_short_thick_stroke_give_it_the_exact_gradient(offset):
    """The gradient is exact even where the distance to the curve has no minimum: beyond the end, inside the bend."""
    curve = torch.tensor([[[3.5, 4.0], [4.5, 4.0], [7.5, 4.0]]]) + offset
    strokes = strokes_along(curve, torch.tensor([24.0]), torch.tensor([[0.2, 0.5, 0.8]]), 0.9)
    strokes = replace(strokes, widening=torch.tensor([0.3]), drift=torch.tensor([[0.1, 0.05, -0.1]]))
    assert_agree(Analytic(soft=1.5), TILED, strokes, (8, 32))


def test_a_tile_in_which_no_slope_is_positive_gives_finite_gradients():
    curve = torch.tensor([[[3.5, 4.0], [4.5, 4.0], [7.5, 4.0]]])  # the greatest slope of the tile at 16 is exactly 0
    strokes = strokes_along(curve, torch.tensor([24.0]), torch.tensor([[0.2, 0.5, 0.8]]), 0.9)
    strokes = replace(strokes, drift=torch.tensor([[0.1, 0.05, -0.1]]))
    _, gradient = paint_with_gradient(Analytic(soft=1.5), TILED, strokes, (8, 32), torch.ones(3, 8, 32))
    assert all(bool(value.isfinite().all()) for value in gradient.values())


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


def test_a_texture_is_read_where_the_stroke_is_its_loop_follows_itself_and_one_too_short_is_refused():
    parameters = torch.zeros(1, 10)
    parameters[0, 0], parameters[0, 4], parameters[0, 6] = -STRETCH, STRETCH, 1.0
    opacity = unroll_stroke(window_pictures(Analytic(soft=0.1), parameters, 256)[0, 3:], 0.2, 24, 66)[0]
    assert opacity[6:18, 8:58].min() > 0.98, "8 of 24 rows to either side are within the half width"
    assert opacity[:3].max() < 0.01
    torch.testing.assert_close(opacity, opacity.flip(0), atol=0.05, rtol=0)
    texels = torch.cumsum(torch.rand(2, 6, 64), dim=2)
    loop = Loop(24, 24)
    result = close_loop(texels, loop)
    torch.testing.assert_close(result[..., :36], texels[..., :36])
    torch.testing.assert_close(result[..., 47], texels[..., 23])
    torch.testing.assert_close(result[..., 48], texels[..., 24])
    torch.testing.assert_close(result[..., 56:], texels[..., 56:])
    words = r"renderer.columns=64 is too small for renderer.rows=128; set renderer.columns=96 or more"
    refuses(words, Textured, rows=128, columns=64, checkpoint=None)
    pictures = window_pictures(
        Textured(variants=1, rows=128, columns=96, checkpoint=None), parameters_of(sample_prior(3)), 64
    )
    assert bool((pictures[:, 3].flatten(1).amax(1) > 0.5).all())
