"""Blends and compiled kernels agree with painting every stroke at every pixel, in value, gradient and importance."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from brushexp_policies.topk import TopK
from dabs import DabRenderer
from hypothesis import given, settings
from kernels import (
    BACKGROUND,
    DEGENERATE,
    DENSE,
    SCENES,
    check_accuracy,
    check_degenerate,
    check_edges,
    check_importance,
    check_random_scene,
    check_skipping,
    paint,
    paint_with_gradient,
)  # fmt: skip
from scenes import leaves, random_strokes, straight, with_shapes
from torch import nn

from brushexp.compat.compiled import Compiled, function, inline
from brushexp.compositing.tile_lists import tile_lists
from brushexp.compositing.windows import Windows
from brushexp.errors import UserError
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.renderer.textured import Textured
from brushexp.strokes.catalogue import FIELDS, Strokes
from brushexp.system.runtime import share

BLENDS = {
    "tiled": Tiled(opaque=0.0, kernel="numba"),
    "tiled in torch": Tiled(opaque=0.0, kernel="torch"),
    "topk": TopK(k=10_000),
}
TILED = BLENDS["tiled"]


class Noise(Renderer):
    """Windows of noise, as a network may draw them: a stroke's brush decides which."""

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
# The first has every blend; the others show that a blend takes any kind of layer.
PAIRS = [*(("plain", blend) for blend in BLENDS), *((kind, "tiled") for kind in list(KINDS)[1:])]
PAIRS += [("windows", "tiled in torch")]


@pytest.mark.parametrize(("kind", "blend"), PAIRS)
@settings(max_examples=12, deadline=None)
@given(scene=SCENES)
def test_blends_agree_on_random_scenes(kind, blend, scene):
    # topk drops empty layers, and with them their gradient
    fields = FIELDS if blend != "topk" or scene["thick"] > 0 else ()
    check_random_scene(KINDS[kind], BLENDS[blend], **scene, fields=fields)


@pytest.mark.parametrize(("kind", "blend"), PAIRS)
def test_accuracy_is_measured_in_the_same_pass(kind, blend):
    check_accuracy(KINDS[kind], BLENDS[blend])


@pytest.mark.parametrize("kind", KINDS)
def test_importance_is_what_the_error_grows_by_without_a_stroke(kind):
    arguments = check_importance(KINDS[kind], TILED)
    for blend in (BLENDS["tiled in torch"], DENSE, TopK(k=4)):
        assert blend.importance(*arguments) is None, "a blend without a kernel leaves importance to others"


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_skipped_cannot_be_seen_and_threads_do_not_change_a_bit(kind):
    strokes, size, weight, results = random_strokes(200, (32, 32)), (32, 32), torch.randn(3, 32, 32), []
    check_skipping(KINDS[kind], Tiled, strokes, size)
    for threads in (1, 2):
        torch.set_num_threads(threads)
        image, gradient = paint_with_gradient(KINDS[kind], Tiled(), strokes, size, weight)
        results.append([image, *gradient.values()])
    torch.set_num_threads(1)
    assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))


def test_the_gradient_of_strokes_with_shapes_is_that_of_finite_differences():
    strokes = with_shapes(random_strokes(3, (7, 9), bend=0.1, width=(0.1, 0.3), dtype=torch.float64))
    names, numbers = zip(*leaves(strokes, torch.float64).items(), strict=True)

    def picture(*numbers):
        return paint(KINDS["plain"], DENSE, Strokes(**dict(zip(names, numbers, strict=True))), (7, 9)).image

    assert torch.autograd.gradcheck(picture, numbers, atol=1e-5)


def test_colours_drift_along_a_stroke_and_stay_in_range():
    stroke = straight((2, 4), (30, 4), width=6, color=(0.5, 0.9, 0.0))
    stroke = replace(stroke, drift=torch.tensor([[0.25, 0.5, 0.5]]))
    row = paint(Analytic(), TILED, stroke, (8, 32)).image[:, 4, 2:30]
    torch.testing.assert_close(row[0], torch.linspace(0.25, 0.75, 28), atol=0.02, rtol=0)
    torch.testing.assert_close(row[1], torch.linspace(0.8, 1.0, 28), atol=0.01, rtol=0)
    assert not row[2].any(), "black has no room"


def test_topk_keeps_the_uppermost_strokes_that_are_there():
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


def test_edges_of_any_width_agree_and_a_point_is_a_disc_with_a_soft_edge():
    check_edges(TILED)
    image = paint(Analytic(soft=1.0), Tiled(), straight((8, 8), (8, 8), width=6.0), (16, 16)).image[1]
    y, x = torch.meshgrid(torch.arange(16) + 0.5, torch.arange(16) + 0.5, indexing="ij")
    z = (3 - ((x - 8) ** 2 + (y - 8) ** 2).sqrt() + 0.5).clamp(0, 1)
    torch.testing.assert_close(image, 0.5 * (1 - z * z * (3 - 2 * z)), atol=1e-5, rtol=0)


def test_fifty_thousand_strokes_on_one_spot():
    n, opacity, plain = 50_000, 1e-4, Analytic(soft=1.5)
    one = straight((2, 3), (14, 9), opacity=opacity)
    many = one.map(lambda v: v.expand(n, *v.shape[1:]).clone())
    image, gradient = paint_with_gradient(plain, Tiled(), many, (16, 16), torch.randn(3, 16, 16))
    single = paint(plain, DENSE, one.map(lambda v: v.double()), (16, 16)).image
    alpha = (single[1] - BACKGROUND[1]) / -BACKGROUND[1]  # the stroke has no green
    light = torch.exp(n * torch.log1p(-alpha))
    exact = one.color[0].double().view(3, 1, 1) * (1 - light) + BACKGROUND.double().view(3, 1, 1) * light
    torch.testing.assert_close(image, exact, atol=1e-3, rtol=0)  # 50,000 roundings of the transmittance
    assert all(value.isfinite().all() for value in gradient.values())


def test_what_a_blend_cannot_do_is_refused():
    with pytest.raises(UserError, match=r"use blend\.kernel=auto"):
        paint(Analytic(), TILED, random_strokes(2, (8, 8), dtype=torch.float64), (8, 8))
    with pytest.raises(UserError, match="use blend=tiled"):
        paint(Analytic(), DENSE, random_strokes(10_000, (1000, 1000)), (1000, 1000))


PLACES = {
    "pixel by pixel": ((16.001, 12.001), 16.0),  # not quite: at a kink the slope is a matter of taste
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
    pictures[1, 3] = 0  # below lies one that shows almost nothing
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


def test_parts_make_kernels_of_their_own():
    values, names = np.ones(3), set()
    for choice in (twice, thrice, twice):
        chosen = apply.having(part=choice)
        chosen(values)
        names.add(chosen.dispatcher.py_func.__qualname__)
    assert values.tolist() == [12.0] * 3
    assert len(names) == 2, "machine code is kept under a name for each choice of parts"


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


def test_the_process_that_compiles_runs_what_others_load(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))
    values = np.random.default_rng(0).standard_normal((99, 64)).astype(np.float32)
    first, second = np.empty(99, np.float32), np.empty(99, np.float32)
    for sums in (first, second):  # a second object knows nothing of the first, as another process
        again = Compiled(mix.function, {})
        share(again, 99, values, sums)
        assert len(again.dispatcher.stats.cache_hits if sums is second else again.dispatcher.stats.cache_misses) == 1
    assert first.tobytes() == second.tobytes()


def test_a_function_with_another_in_it_is_found_again_by_other_processes():
    texts = [compile("def listed(n): return [(k, 0.5) for k in range(n)]", __file__, "exec") for _ in range(2)]
    scopes = [{"__name__": __name__} for _ in texts]
    for text, scope in zip(texts, scopes, strict=True):
        exec(text, scope)
    names = {function(scope["listed"]).dispatcher.py_func.__qualname__ for scope in scopes}
    assert len(names) == 1, "its code lies elsewhere in memory each time"
