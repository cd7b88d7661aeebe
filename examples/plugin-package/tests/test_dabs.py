"""Test that the dry brush follows libmypaint's formulas, and that its strokes have the requested width."""

import math

import numpy as np
import pytest
import torch
from brushexp_dabs._stamps import _gauss, opacity_of, pressure_at
from brushexp_dabs.engine import Dabs
from brushexp_training.engine.disc import Disc
from torch.testing import assert_close

import brushexp
from brushexp.contracts import UserError, build_named
from brushexp.contracts.strokes import parameters_of, sample_prior

LEVEL = torch.tensor([[-0.7, 0, 0, 0, 0.7, 0, 1.0, 0, 0, 0]])  # 0.2 windows wide


@pytest.mark.parametrize("check", brushexp.testing.contract("engine"), ids=lambda check: check.__name__)
def test_it_keeps_the_contract_of_engines(check):
    check(lambda **options: build_named("engine", "dabs", options))


def test_dabs_differ_from_number_to_number_and_from_seed_to_seed():
    engine = Dabs(window=32)
    parameters = parameters_of(sample_prior(1, seed=4)).repeat(2, 1)
    first, second = engine(parameters, seed=1).images
    assert (first - second).abs().max() > 0.1
    assert (engine(parameters, seed=2).images[0] - first).abs().max() > 0.1


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"pressure": 0.4},
        {"pressure": 1.0, "end_pressure": 1.0},
        {"offset_by_random": 0.0},
        {"offset_by_random": 4.0, "hardness": 0.8},
        {"opaque_linearize": 0.9},
        {"hardness": 1.0, "dabs_per_radius": 3.0},
    ],
    ids=str,
)
def test_a_band_of_dabs_is_as_wide_as_the_stroke_at_half_its_height(settings):
    engine = Dabs(window=64, **settings)
    profile = engine(LEVEL.repeat(100, 1), seed=1).images[:, 3, :, 24:40].mean((0, 2))
    half = 0.5 * profile[30:34].mean()
    assert_close((profile >= half).sum().item() / 64, 0.2, atol=2.5 / 64, rtol=0)


def test_a_dry_stroke_has_grain():
    inside = (slice(None), 3, slice(29, 35), slice(16, 48))
    dry, tube = (engine(window=64)(LEVEL, seed=1).images for engine in (Dabs, Disc))
    assert dry[inside].std() > 0.1
    assert_close(tube[inside], torch.ones(1, 6, 32))


def test_one_dab_has_the_profile_of_libmypaint():
    h = 0.2
    even = {"offset_by_random": 0.0, "radius_by_random": 0.0, "pressure": 0.5, "end_pressure": 0.5}
    engine = Dabs(window=64, supersample=8, hardness=h, **even)
    alpha = engine(torch.tensor([[0.0] * 6 + [1.0] + [0.0] * 3]), seed=1).images[0, 3]
    radius = 0.1 / engine.half_width * 64
    middle = torch.arange(64) + 0.5 - 32
    rr = (middle[:, None] ** 2 + middle**2) / radius**2
    inner, outer = 1 - rr * (1 / h - 1), h / (1 - h) * (1 - rr)
    expected = (0.8 + 0.2 * 0.5) * 0.5 * torch.where(rr <= h, inner, outer.clamp_min(0))
    assert_close(alpha, expected, atol=0.02, rtol=0)


def test_dabs_add_up_to_an_opacity_that_follows_the_pressure():
    assert math.isclose(opacity_of(0.5, 0.8, 0.2, 0.0, 12.0), 0.45)
    assert math.isclose(1 - (1 - opacity_of(0.5, 0.8, 0.2, 1.0, 12.0)) ** 24, 0.45)
    assert opacity_of(1.0, 1.0, 1.0, 0.9, 12.0) == 1
    assert opacity_of(0.0, 0.8, 0.2, 0.9, 12.0) == 0
    for share, pressure in {0.0: 0.4, 0.125: 0.6, 0.25: 0.8, 0.5: 0.8, 0.75: 0.8, 0.875: 0.6, 1.0: 0.4}.items():
        assert math.isclose(pressure_at(share, 0.8, 0.4, 0.25, 0.75), pressure)
        assert math.isclose(pressure_at(share, 0.8, 0.4, 0.0, 1.0), 0.8)


def test_random_numbers_of_dabs_are_normal_and_independent():
    draws = np.array([[_gauss(np.uint64(key), counter) for counter in range(200)] for key in range(50)])
    assert abs(draws.var() - 1) < 5 * np.sqrt(2 / draws.size)
    for values in (draws, draws[:, 1:] * draws[:, :-1], draws[1:] * draws[:-1]):
        assert abs(values.mean()) < 5 / np.sqrt(values.size)


def test_a_head_that_ends_behind_the_tail_is_refused_with_the_cure():
    with pytest.raises(UserError, match=r"engine.head=0.8 is more than engine.tail=0.75; try engine.head=0.75"):
        Dabs(head=0.8)
