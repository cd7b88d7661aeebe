"""Tests that brushexp's Python functions return the same results under any global settings of PyTorch."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
import torch
from skimage import data

import brushexp
from brushexp.strokes.prior import sample_prior

STROKES = sample_prior(4).moved(shift=(16, 12))


@pytest.fixture(scope="module")
def painting():
    return brushexp.paint("astronaut", look="plain", resolution=24, strokes=12, steps=3)


@contextmanager
def precision(dtype: torch.dtype) -> Iterator[None]:
    before = torch.get_default_dtype()
    torch.set_default_dtype(dtype)
    try:
        yield
        assert torch.get_default_dtype() == dtype
    finally:
        torch.set_default_dtype(before)


@pytest.mark.parametrize("name", [
    "paint", "simulate", "analyse", "recover", "sample_brushwork", "create", "draw", "export", "render",
    "render in texture", "render by a network", "render densely",
])  # fmt: skip
def test_results_are_the_same_whatever_is_the_default_of_the_program_around(name, painting, tmp_path):
    results = {
        "paint": lambda: brushexp.paint("astronaut", look="plain", resolution=24, strokes=12, steps=3).image,
        "simulate": lambda: brushexp.simulate(2, engine="disc", window=32)[1].images,
        "analyse": lambda: brushexp.analyse(painting).values("length"),
        "recover": lambda: brushexp.recover(data.astronaut()[64:128, 200:264]).labels,
        "sample_brushwork": lambda: brushexp.sample_brushwork("astronaut", samples=2, resolution=48).samples[0].psnr,
        "create": lambda: next(brushexp.create("renderer", "neural").parameters()),
        "draw": lambda: painting.render(40),
        "export": lambda: [path.read_bytes() for path in painting.export("svg", tmp_path)],
        "render": lambda: brushexp.render(STROKES, (24, 32)),
        "render in texture": lambda: brushexp.render(STROKES, (24, 32), renderer="textured"),
        "render by a network": lambda: brushexp.render(STROKES, (24, 32), renderer="neural"),
        "render densely": lambda: brushexp.render(STROKES, (24, 32), blend="dense"),
    }
    expected = results[name]()
    for around in (precision(torch.float64), torch.inference_mode(), torch.no_grad(), torch.device("meta")):
        with around:
            result = results[name]()
        if isinstance(expected, torch.Tensor):
            assert torch.equal(result, expected)
            assert result.dtype == expected.dtype
        else:
            assert np.array_equal(result, expected)


def test_strokes_are_drawn_with_gradients_unless_the_program_around_wants_none():
    strokes = STROKES.map(lambda value: value.clone().requires_grad_())
    assert brushexp.render(strokes, (24, 32)).requires_grad
    with torch.no_grad():
        assert not brushexp.render(strokes, (24, 32)).requires_grad
