"""A kind of layer with its own kernel is one file, and every kernel knows what each stroke contributes."""

import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from kernels import BACKGROUND, assert_agree, assert_same_bits_on_threads, paint, paint_with_gradient
from scenes import Windowed, random_strokes

from brushexp import registry
from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.blend.tiled import Backend, Tiled
from brushexp.plugins.blend.topk import TopK
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.textured import Textured
from brushexp.system.compiled import function, inline

TILED = Tiled(opaque=0.0, kernel=Backend.numba)
NAMES = ("dabs", "plain", "tapered", "textured", "windows")


@pytest.fixture(scope="module")
def renderers():
    """By name; the plugin `dabs` is known to these tests alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "_plugins", dict(registry._plugins))
        import_module("dabs")
        dabs = registry.build_named("renderer", "dabs", {})
    textured = Textured(checkpoint=None).requires_grad_(False)
    brushes = (dabs, Analytic(), Analytic(taper=0.5), textured, Windowed().requires_grad_(False).eval())
    return dict(zip(NAMES, brushes, strict=True))


@settings(max_examples=15, deadline=None)
@given(n=st.integers(0, 30), height=st.integers(1, 30), width=st.integers(1, 40), seed=st.integers(0, 10_000))
def test_a_plugin_with_its_own_kernel_agrees_with_the_reference(renderers, n, height, width, seed):
    order = torch.randperm(n, generator=torch.Generator().manual_seed(seed))
    assert_agree(renderers["dabs"], TILED, random_strokes(n, (height, width), seed=seed), (height, width), order=order)


def test_a_plugin_with_its_own_kernel_has_what_the_skeleton_gives(renderers):
    strokes, target, weight = random_strokes(40, (20, 33)), torch.rand(3, 20, 33), torch.randn(3, 20, 33)
    accuracy = paint(renderers["dabs"], TILED, strokes, (20, 33), target=target).accuracy
    exact = paint(renderers["dabs"], Dense(), strokes.map(lambda v: v.double()), (20, 33), target=target).accuracy
    torch.testing.assert_close(accuracy.double(), exact, atol=1e-4, rtol=0, equal_nan=True)

    def step():
        image, gradient = paint_with_gradient(renderers["dabs"], Tiled(), strokes, (20, 33), weight)
        return image, *gradient.values()

    assert_same_bits_on_threads(step)


@pytest.mark.parametrize("name", NAMES)
def test_importance_is_what_the_error_grows_by_without_a_stroke(renderers, name):
    size, strokes = (20, 29), random_strokes(25, (20, 29), bend=0.05)
    order, target, weight = torch.randperm(25), torch.rand(3, *size), torch.rand(size)
    with torch.no_grad():
        layers = renderers[name](strokes)
        found = TILED.importance(layers, order, size, BACKGROUND, target, weight)

        def error(chosen):
            image = Dense()(layers, chosen, size, BACKGROUND).image
            return (weight * (image - target).square()).double().sum()

        grown = torch.stack([error(order[order != i]) for i in range(25)]) - error(order)
    torch.testing.assert_close(found.double(), grown, atol=2e-3, rtol=1e-3)
    assert found.abs().max() > 0.1


def test_a_blend_without_a_kernel_leaves_importance_to_others(renderers):
    size, strokes = (9, 12), random_strokes(3, (9, 12))
    given = torch.arange(3), size, BACKGROUND, torch.rand(3, *size), torch.ones(size)
    for blend in (Tiled(kernel=Backend.torch), Dense(), TopK(k=4)):
        assert blend.importance(renderers["plain"](strokes), *given) is None
    exact = TopK(k=None).importance(renderers["plain"](strokes), *given)
    torch.testing.assert_close(exact, TILED.importance(renderers["plain"](strokes), *given))


@inline
def twice(x):
    return 2 * x


@inline
def thrice(x):
    return 3 * x


@inline
def part(x):
    """Stands for another."""


@function
def apply(values):
    for k in range(len(values)):
        values[k] = part(values[k])


def test_parts_make_kernels_of_their_own():
    values = np.ones(3)
    names = set()
    for choice in (twice, thrice, twice):
        chosen = apply.having(part=choice)
        chosen(values)
        names.add(chosen.dispatcher.py_func.__qualname__)
    assert values.tolist() == [12.0] * 3
    assert len(names) == 2, "machine code is kept under a name for each choice of parts"


def test_numba_is_not_imported_before_a_kernel_is_called():
    code = "import sys; from brushexp.plugins.blend.tiled import Tiled; Tiled(); sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
