"""Test that `blend.kernel=triton`, interpreted if there is no CUDA device, agrees with the CPU kernels."""

import os
import subprocess
import sys
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
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
)
from refusals import refuses
from scenes import random_strokes, straight
from test_kernels import KINDS
from test_measures import random_tiles

from brushexp.compositing import tile_lists
from brushexp.plugins.blend.base import Compositor
from brushexp.plugins.blend.tiled import Tiled
from brushexp.registry import build_named
from brushexp.strokes.bezier import closest_parameter, curve_of, half_width_of, point_at
from brushexp.strokes.catalogue import Strokes

triton = pytest.importorskip("triton")
CUDA = torch.cuda.is_available()
pytestmark = [pytest.mark.gpu] if CUDA else []
DEVICE = torch.device("cuda" if CUDA else "cpu")
OURS = ("plain", "tapered", "textured")  # kinds of layers that have kernels


def moved(value, device=DEVICE):
    """Copy a tensor, or all tensors in a dataclass, to another device, so that gradients flow through the copy."""
    if is_dataclass(value):
        return replace(value, **{f.name: moved(getattr(value, f.name), device) for f in fields(value) if f.init})
    return value.to(device) if isinstance(value, torch.Tensor) else value


class Twin:
    """The Triton blend, callable with values in CPU memory."""

    def __init__(self, **options):
        self.blend = Tiled(kernel="triton", **options)

    def __call__(self, layers, *arguments):
        arguments = [moved(argument) for argument in arguments]
        return moved(self.blend(moved(layers), *arguments), torch.device("cpu"))

    def importance(self, layers, *arguments):
        return self.blend.importance(moved(layers), *map(moved, arguments)).cpu()


TWIN = Twin(opaque=0.0)


def shorten_chunks(monkeypatch):
    from brushexp_gpu import lists, rasterization  # noqa: PLC0415  (both, before one is changed that the other copies)

    for module in (lists, rasterization):
        monkeypatch.setattr(module, "CHUNK", 4)


@pytest.mark.parametrize("kind", OURS)
@settings(max_examples=2, deadline=None)
@given(scene=SCENES)
def test_it_agrees_on_random_scenes(kind, scene):
    check_random_scene(KINDS[kind], TWIN, **scene)


@pytest.mark.parametrize("kind", ["plain", "textured"])
def test_accuracy_and_importance_agree_also_in_pigment(kind):
    check_accuracy(KINDS[kind], TWIN)
    check_importance(KINDS[kind], TWIN)
    space, strokes = build_named("color", "pigment", {}), random_strokes(12, (18, 27), bend=0.05)
    blend, dense = Compositor(TWIN, space), Compositor(DENSE, space)
    loose = {"slack": 5e-3, "exactness": 2e-3} if kind == "textured" else {"slack": 2e-3, "exactness": 5e-4}
    assert_agree(KINDS[kind], blend, strokes, (18, 27), dense=dense, **loose)


@pytest.mark.parametrize("kind", ["plain", "textured"])
@pytest.mark.parametrize("name", DEGENERATE)
def test_degenerate_strokes_have_a_picture_and_a_finite_gradient(kind, name):
    check_degenerate(KINDS[kind], TWIN, name)


def test_edges_of_any_width_agree_and_what_is_skipped_cannot_be_seen(monkeypatch):
    check_edges(TWIN)
    shorten_chunks(monkeypatch)
    check_skipping(KINDS["plain"], Twin, random_strokes(24, (8, 16)), (8, 16))


@pytest.mark.parametrize("kind", ["plain", "textured"])
def test_a_pile_of_several_chunks_has_the_same_bits_however_many_tiles_are_interpreted_at_once(kind, monkeypatch):
    """The colour behind a chunk is computed from the next chunk even if the chunk's last stroke is opaque."""
    shorten_chunks(monkeypatch)
    pile = random_strokes(15, (8, 9), seed=3, bend=0.05, width=(0.3, 1.0))
    pile = replace(pile, opacity=torch.where(torch.arange(15) % 4 == 3, 1.0, 0.2 * pile.opacity))
    assert_agree(KINDS[kind], TWIN, pile, (8, 9), slack=3e-3, exactness=5e-4)
    from brushexp_gpu import rasterization  # noqa: PLC0415  (imports Triton)

    strokes, size, results = random_strokes(5, (8, 17), bend=0.1), (8, 17), []
    for tiles in (rasterization.TILES,) * 3 if CUDA else (rasterization.TILES, 1, 2):  # other shapes use other code
        monkeypatch.setattr(rasterization, "TILES", tiles)
        image, gradient = paint_with_gradient(KINDS[kind], Twin(), strokes, size, torch.ones(3, *size))
        results.append([image, *gradient.values()])
    assert all(torch.equal(a, b) and torch.equal(a, c) for a, b, c in zip(*results, strict=True))


def test_a_pile_longer_than_a_chunk_nothing_and_very_much():
    pile = random_strokes(35, (8, 8), seed=3, width=(0.3, 1.0))
    assert_agree(KINDS["plain"], TWIN, replace(pile, opacity=0.2 * pile.opacity), (8, 8))
    none = random_strokes(0, (9, 17))
    image, gradient = paint_with_gradient(KINDS["plain"], TWIN, none, (9, 17), torch.randn(3, 9, 17))
    torch.testing.assert_close(image, BACKGROUND.double().view(3, 1, 1).expand(3, 9, 17))
    assert all(len(value) == 0 for value in gradient.values())
    huge = straight((-1e5, 3), (1e5, 9), width=2e5)
    assert_agree(KINDS["plain"], TWIN, Strokes.join(huge, straight((2, 3), (14, 9))), (16, 19), ("color", "opacity"))
    words = r"float32 on CUDA devices.*use blend\.kernel=auto"
    refuses(words, paint, KINDS["plain"], TWIN, random_strokes(2, (8, 8), dtype=torch.float64), (8, 8))
    refuses(r"only plain and textured strokes", paint, KINDS["windows"], TWIN, random_strokes(2, (8, 8)), (8, 8))


def test_lists_are_those_of_the_processor_and_hardly_more():
    from brushexp_gpu import lists  # noqa: PLC0415

    strokes, size = random_strokes(300, (200, 333), bend=0.5), (200, 333)
    strokes.position[3], strokes.width[4] = 5000, 0
    order, curve, reach = torch.randperm(300), curve_of(strokes), half_width_of(strokes)
    ours = lists.tile_lists(curve.to(DEVICE), reach.to(DEVICE), order.to(DEVICE), size)
    theirs = tile_lists.tile_lists(curve, reach, order, size)
    first, stroke, pairs = ours.first.cpu(), ours.stroke.cpu(), [set(), set()]
    place = order.argsort()
    for tile in range(len(theirs.first) - 1):
        mine = stroke[first[tile] : first[tile + 1]]
        assert (place[mine].diff() > 0).all(), "front to back"
        pairs[0] |= {(tile, int(i)) for i in mine}
        pairs[1] |= {(tile, int(order[i])) for i in theirs.stroke[theirs.first[tile] : theirs.first[tile + 1]]}
    assert len(pairs[1] - pairs[0]) <= 1e-3 * len(pairs[1]), "rounding may change pairs at the very edge of strokes"
    assert len(pairs[0]) <= 1.02 * len(pairs[1])


def test_the_distance_is_found_wherever_it_is_within_reach():
    from seeking import nearest_points  # noqa: PLC0415

    curve, reach, corners = (torch.from_numpy(part) for part in random_tiles(600))
    y, x = np.divmod(np.arange(64), 8)
    pixels = corners[:, None] + torch.from_numpy(np.stack([x, y], axis=1) + 0.5)
    found = nearest_points(*(part.to(DEVICE) for part in (curve, reach, corners))).double().cpu()
    curves = curve.double()[:, None]
    exact = (point_at(curves, closest_parameter(curves, pixels)) - pixels).norm(dim=-1)
    distance, within = (point_at(curves, found) - pixels).norm(dim=-1), exact <= reach[:, None]
    assert within.float().mean() > 0.3
    assert (distance - exact)[within].max() < 1e-3


@pytest.mark.slow(kernels=False)  # kernels of Numba
def test_the_kernels_compile_for_a_gpu_that_is_not_there_without_a_number_in_memory_for_lack_of_registers():
    command = [sys.executable, Path(__file__).with_name("compiling.py"), "90", "textured"]
    compiles = {name: value for name, value in os.environ.items() if name != "TRITON_INTERPRET"}
    lines = subprocess.run(command, env=compiles, capture_output=True, text=True, check=True).stdout.splitlines()
    names = {line.split()[0] for line in lines}
    lists = {"box_kernel", "find_kernel", "arrange_kernel"}
    assert names == lists | {"forward_pass", "behind_pass", "backward_pass", "sum_rows"}
    assert all("STACK:0 " in line and "LOCAL:0 " in line for line in lines)
