"""The distribution of valid strokes, and strokes as plain numbers."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scenes import random_strokes, straight
from torch.testing import assert_close

from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Strokes, check_strokes
from brushexp.strokes.prior import (
    INSET,
    SHORTEST_CHORD,
    SPREAD,
    WIDTH,
    bend_of,
    clamp_to_prior,
    parameters_of,
    rewindow,
    sample_prior,
    strokes_of,
)

N = 10_000


def naive_sample(n: int) -> np.ndarray:
    """The distribution as the thesis words it, one stroke at a time: (n, 10), points in half-windows."""
    random = np.random.default_rng(1)
    rows = []
    for _ in range(n):
        while True:
            start, end, width = random.random(2), random.random(2), random.uniform(*WIDTH)
            if np.hypot(*(start - end)) >= 2 * width:
                break
        a = start - end
        frame = np.array([a, [-a[1], a[0]]])
        while True:
            control = (start + end) / 2 + random.normal(0, np.sqrt(SPREAD)) @ frame
            if ((control >= 0) & (control <= 1)).all():
                break
        points = [INSET * (2 * p - 1) for p in (start, control, end)]
        rows.append([*points[0], *points[1], *points[2], width, *random.random(3)])
    return np.array(rows)


def table(strokes: Strokes) -> np.ndarray:
    parts = [strokes.start, strokes.control, strokes.end, strokes.width[:, None], strokes.color]
    return torch.cat(parts, dim=1).double().numpy()


def test_samples_have_the_moments_of_the_naive_sampler():
    ours, theirs = table(sample_prior(N, seed=5)), naive_sample(N)
    spread = theirs.std(axis=0)
    assert np.abs((ours.mean(0) - theirs.mean(0)) / spread).max() < 5 * np.sqrt(2 / N)
    assert np.abs((np.cov(ours.T) - np.cov(theirs.T)) / np.outer(spread, spread)).max() < 5 * 2 / np.sqrt(N)
    tails = (np.quantile(rows / spread, [0.1, 0.9], axis=0) for rows in (ours, theirs))
    assert np.abs(np.subtract(*tails)).max() < 0.1


def test_samples_keep_the_constraints():
    strokes = sample_prior(N, seed=2)
    check_strokes(strokes)
    for points in (strokes.start, strokes.control, strokes.end):
        assert points.abs().max() <= INSET + 1e-6
    assert strokes.width.min() >= WIDTH[0] - 1e-7
    assert strokes.width.max() <= WIDTH[1] + 1e-7
    length = 0.5 * (strokes.start - strokes.end).norm(dim=1) / INSET  # in window sides, before they were shrunk
    assert (length >= 2 * strokes.width - 1e-6).all()
    assert length.min() < 2 * WIDTH[0] * 1.5  # the constraint bites
    assert (strokes.position == 0).all()
    assert (strokes.scale == 64).all()
    assert (strokes.opacity == 1).all()


def test_a_stroke_depends_on_seed_and_number_alone():
    many = table(sample_prior(1000, seed=7))
    for n in (0, 1, 2, 999):
        np.testing.assert_array_equal(table(sample_prior(n, seed=7)), many[:n])
    np.testing.assert_array_equal(table(sample_prior(100, seed=7, first=333)), many[333:433])
    np.testing.assert_array_equal(table(sample_prior(1, seed=7, first=999)), many[999:])
    assert len(np.unique(many, axis=0)) == 1000
    for seed in (1, 2**64 - 1):
        assert np.abs(table(sample_prior(50, seed=seed)) - many[:50]).min(axis=0).max() > 0


def test_parameters_lie_in_the_unit_range_and_come_back():
    strokes = sample_prior(300, seed=3)
    numbers = parameters_of(strokes)
    assert numbers.shape == (300, 10)
    assert numbers.abs().max() <= 1 + 1e-6
    for (name, ours), (_, theirs) in zip(strokes.items(), strokes_of(numbers).items(), strict=True):
        assert_close(ours, theirs, msg=name)
    assert_close(parameters_of(strokes_of(numbers)), numbers)
    assert torch.autograd.gradcheck(
        lambda x: parameters_of(strokes_of(x)), numbers[:3].double().requires_grad_(), fast_mode=True
    )


def test_parameters_are_start_control_end_width_and_colour():
    numbers = torch.tensor([[-1.0, -0.5, 0.0, 0.25, 0.5, 1.0, -1.0, -1.0, 0.0, 1.0]], dtype=torch.float64)
    strokes = strokes_of(numbers)
    assert strokes.start.tolist() == [[-1.0, -0.5]]
    assert strokes.control.tolist() == [[0.0, 0.25]]
    assert strokes.end.tolist() == [[0.5, 1.0]]
    assert strokes.width.tolist() == [0.03]
    assert strokes.color.tolist() == [[0.0, 0.5, 1.0]]
    assert strokes.opacity.dtype == torch.float64


@pytest.mark.parametrize("angle", [0.0, 0.7, 3.0, -2.0])
def test_bends_are_measured_in_the_frame_of_the_stroke_and_are_0_for_a_point(angle):
    turn = torch.tensor([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    start, end = torch.tensor([0.4, 0.1]).double(), torch.tensor([-0.2, 0.1]).double()  # s - e = (0.6, 0)
    control = 0.5 * (start + end) + torch.tensor([0.06, -0.12])
    points = torch.stack([start, control, end]) @ turn.T
    numbers = torch.cat([points.flatten(), torch.zeros(4)])[None]
    assert_close(bend_of(strokes_of(numbers)), torch.tensor([[0.1, -0.2]]).double())
    point = torch.zeros(1, 10, requires_grad=True)
    bend = bend_of(strokes_of(point))
    assert (bend == 0).all()
    assert torch.autograd.grad(bend.sum(), point)[0].abs().max() < 1 / SHORTEST_CHORD**2


def in_pixels(strokes: Strokes) -> torch.Tensor:
    return torch.cat([curve_of(strokes).flatten(1), 2 * half_width_of(strokes)[:, None]], dim=1)


def test_strokes_that_fit_into_some_window_stay_where_they_are_and_valid_ones_keep_theirs():
    clamped = clamp_to_prior(sample_prior(500))
    assert all(torch.equal(value, getattr(clamped, name)) for name, value in rewindow(clamped).items())
    valid = sample_prior(500, seed=3)
    generator = torch.Generator().manual_seed(0)
    zoom, shift = 0.2 + 9 * torch.rand(500, 1, generator=generator), 2 * torch.rand(500, 2, generator=generator) - 1
    odd = replace(
        valid,
        position=300 * torch.rand(500, 2, generator=generator),
        scale=valid.scale / zoom[:, 0],
        width=valid.width * zoom[:, 0],
        **{name: getattr(valid, name) * zoom + shift for name in ("start", "control", "end")},
    )
    new = rewindow(odd)
    assert_close(in_pixels(clamp_to_prior(new)), in_pixels(odd), atol=1e-3, rtol=0)
    assert_close(new.color, odd.color)
    assert_close(new.opacity, odd.opacity)


def test_any_stroke_becomes_valid_near_where_it_was():
    for bend in (0.0, 0.3, 3.0):
        strokes = random_strokes(300, (80, 120), bend=bend, width=(0.0, 1.0))
        new = rewindow(strokes)
        check_strokes(new)
        change = (in_pixels(clamp_to_prior(new)) - in_pixels(new)).abs().amax(1)
        assert (change < 2e-3).float().mean() > 0.98, "but for hairpins there should be nothing change to clamp"
        middle, before = curve_of(new).mean(1), curve_of(strokes).mean(1)
        assert (middle - before).norm(dim=1).max() < 0.5 * strokes.scale.max()


SHAPES = {"a disc": ((20, 20), (20, 20), 9.0), "short": ((20, 20), (25, 22), 12.0), "thin": ((5, 20), (105, 20), 1.5)}


@pytest.mark.parametrize("kind", SHAPES)
def test_a_stroke_that_fits_into_no_window_keeps_its_area(kind):
    start, end, width = SHAPES[kind]
    stroke = straight(start, end, width=width)
    new = clamp_to_prior(rewindow(stroke))

    def area(stroke: Strokes) -> float:
        curve, width = curve_of(stroke)[0], 2 * half_width_of(stroke)[0]
        return float((curve[2] - curve[0]).norm() * width + 0.25 * torch.pi * width**2)

    assert area(new) == pytest.approx(area(stroke), rel=0.03)
    assert_close(curve_of(new)[0].mean(0), curve_of(stroke)[0].mean(0))
    assert not torch.allclose(in_pixels(new), in_pixels(stroke), atol=0.1)


def test_a_point_becomes_the_shortest_valid_stroke():
    strokes = strokes_of(torch.zeros(3, 10))
    strokes = replace(strokes, end=torch.tensor([[0.0, 0.0], [0.01, 0.0], [0.0, 0.5]]))
    clamped = clamp_to_prior(strokes)
    length = (clamped.end - clamped.start).norm(dim=1)
    assert_close(length, torch.tensor([SHORTEST_CHORD, SHORTEST_CHORD, 0.5]))
    assert_close(clamped.start[:2] + clamped.end[:2], strokes.start[:2] + strokes.end[:2])
    assert_close(clamp_to_prior(clamped).end, clamped.end)
    new = rewindow(straight((8, 8), (8, 8), width=0.0))
    check_strokes(new)
    assert in_pixels(clamp_to_prior(new))[0, 6] < 0.1
    assert len(rewindow(Strokes.none())) == 0
