"""Tests of valid strokes, stroke parameters and initialisers: counts, colours, directions and randomness."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from scenes import random_strokes, straight
from torch import Tensor
from torch.testing import assert_close

from brushexp.plugins.init.base import Initializer
from brushexp.plugins.init.grid import Grid, lattice
from brushexp.plugins.init.layers import InLayers
from brushexp.plugins.init.random import Random
from brushexp.plugins.init.slic import Slic
from brushexp.registry import build_named
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import FIELDS, Strokes, check_strokes
from brushexp.strokes.prior import (
    INSET,
    SHORTEST_CHORD,
    SPREAD,
    THICKEST,
    THINNEST,
    bend_of,
    clamp_to_prior,
    parameters_of,
    rewindow,
    sample_prior,
    strokes_of,
)

N = 10_000


def naive_sample(n: int) -> np.ndarray:
    """Draw samples (n, 10) as the thesis describes them, one stroke at a time, with points in half-windows."""
    random = np.random.default_rng(1)
    rows = []
    for _ in range(n):
        while True:
            start, end, width = random.random(2), random.random(2), random.uniform(THINNEST, THICKEST)
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


def test_samples_depend_on_seed_and_number_alone_and_have_the_moments_of_the_naive_sampler():
    ours, theirs = table(sample_prior(N, seed=5)), naive_sample(N)
    spread = theirs.std(axis=0)
    assert np.abs((ours.mean(0) - theirs.mean(0)) / spread).max() < 5 * np.sqrt(2 / N)
    assert np.abs((np.cov(ours.T) - np.cov(theirs.T)) / np.outer(spread, spread)).max() < 5 * 2 / np.sqrt(N)
    tails = (np.quantile(rows / spread, [0.1, 0.9], axis=0) for rows in (ours, theirs))
    assert np.abs(np.subtract(*tails)).max() < 0.1
    many = table(sample_prior(1000, seed=7))
    for n in (0, 1, 2, 999):
        np.testing.assert_array_equal(table(sample_prior(n, seed=7)), many[:n])
    np.testing.assert_array_equal(table(sample_prior(100, seed=7, first=333)), many[333:433])
    np.testing.assert_array_equal(table(sample_prior(1, seed=7, first=999)), many[999:])
    assert len(np.unique(many, axis=0)) == 1000
    for seed in (1, 2**64 - 1):
        assert np.abs(table(sample_prior(50, seed=seed)) - many[:50]).min(axis=0).max() > 0


def test_samples_keep_the_constraints():
    strokes = sample_prior(N, seed=2)
    check_strokes(strokes)
    for points in (strokes.start, strokes.control, strokes.end):
        assert points.abs().max() <= INSET + 1e-6
    assert THINNEST - 1e-7 <= strokes.width.min() <= strokes.width.max() <= THICKEST + 1e-7
    length = 0.5 * (strokes.start - strokes.end).norm(dim=1) / INSET  # in window sides, before the strokes were shrunk
    assert (length >= 2 * strokes.width - 1e-6).all()
    assert length.min() < 2 * THINNEST * 1.5  # the constraint has an effect
    assert (strokes.position == 0).all()
    assert (strokes.scale == 64).all()
    assert (strokes.opacity == 1).all()


def test_parameters_are_start_control_end_width_and_colour_in_the_unit_range_and_come_back():
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


def test_any_stroke_becomes_valid_near_where_it_was_and_a_point_the_shortest_valid_stroke():
    for bend in (0.0, 0.3, 3.0):
        strokes = random_strokes(300, (80, 120), bend=bend, width=(0.0, 1.0))
        new = rewindow(strokes)
        check_strokes(new)
        change = (in_pixels(clamp_to_prior(new)) - in_pixels(new)).abs().amax(1)
        assert (change < 2e-3).float().mean() > 0.98, "but for hairpins there should be nothing change to clamp"
        middle, before = curve_of(new).mean(1), curve_of(strokes).mean(1)
        assert (middle - before).norm(dim=1).max() < 0.5 * strokes.scale.max()
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


OVERLAPPING = partial(Grid, shift=True, length=1.8, width=1.4)  # as in the preset
BUILT_IN = [Grid(), OVERLAPPING(), Slic(), Slic(detail=0.0), Slic(detail=1.0, orient="random"), Random(), InLayers()]
NAMES = ["grid", "overlapping_grid", "slic", "slic_even", "slic_random", "random", "layers"]
CALM = InLayers(calm=0.1, shadows=1.0)  # as in look=oil
every_init = pytest.mark.parametrize("init", [*BUILT_IN, CALM], ids=[*NAMES, "calm_layers"])


def noise(height: int, width: int, seed: int = 0) -> Tensor:
    return torch.rand(3, height, width, generator=torch.Generator().manual_seed(seed))


def stripes(height: int, width: int, degrees: float) -> Tensor:
    """Draw stripes that run ``degrees`` clockwise from the x axis (y points down), with a period of 12 pixels."""
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    across = y * math.cos(math.radians(degrees)) - x * math.sin(math.radians(degrees))
    return (0.5 + 0.4 * torch.sin(2 * math.pi * across / 12)).expand(3, height, width).contiguous()


def made(init: Initializer, target: Tensor, n: int, seed: int = 0) -> Strokes:
    return init(target, n, torch.Generator().manual_seed(seed))


def same(one: Strokes, other: Strokes) -> bool:
    return all(torch.equal(getattr(one, name), getattr(other, name)) for name in FIELDS)


@every_init
@pytest.mark.parametrize("size", [(1, 1), (1, 2), (1, 300), (300, 1), (2, 2), (9, 7), (4, 600), (600, 4), (37, 61)])
@pytest.mark.parametrize("look", ["noise", "constant"])
def test_any_canvas_gets_exactly_n_strokes_within_it(init, size, look):
    height, width = size
    pixels = height * width
    target = noise(height, width) if look == "noise" else torch.full((3, height, width), 0.5)
    for n in sorted({n for n in (1, 2, 3, 5, pixels // 9, pixels // 3, pixels - 1, pixels) if 1 <= n <= pixels}):
        strokes = made(init, target, n)
        assert len(strokes) == n
        check_strokes(strokes)
        assert all(value.dtype == torch.float32 for _, value in strokes.items())
        x, y = strokes.position.T
        assert 0 < x.min() <= x.max() < width, "a canvas that is not square must not be transposed"
        assert 0 < y.min() <= y.max() < height


@every_init
def test_the_generator_decides_and_nothing_else_does(init):
    target = noise(30, 50)
    torch.manual_seed(1)
    np.random.seed(1)  # noqa: NPY002  (the global state is the point)
    one, state = made(init, target, 40), torch.get_rng_state()
    torch.manual_seed(2)
    np.random.seed(2)  # noqa: NPY002
    assert same(one, made(init, target, 40))
    torch.manual_seed(1)
    assert torch.equal(torch.get_rng_state(), state), "the global generator is not to be moved"
    assert not same(one, made(init, target, 40, seed=1))
    assert torch.equal(target, noise(30, 50)), "the target is left as it was"


@pytest.mark.parametrize("init", BUILT_IN[:-1], ids=NAMES[:-1])
@pytest.mark.parametrize("n", [1, 7, 40, 600])
def test_a_stroke_has_the_mean_colour_and_centre_of_mass_of_its_cell(init, n):
    target, still = noise(20, 30), replace(init, jitter=0.0)
    labels = still.cells(target, n, torch.Generator().manual_seed(0), None)
    assert sorted(set(labels.ravel())) == list(range(n))
    strokes = made(still, target, n)
    cells = [(labels == k).nonzero() for k in range(n)]
    assert_close(strokes.color, torch.stack([target[:, y, x].mean(1) for y, x in cells]))
    assert_close(strokes.position, torch.tensor([[x.mean() + 0.5, y.mean() + 0.5] for y, x in cells]).float())


@pytest.mark.parametrize(("height", "width", "n"), [(20, 30, 7), (1, 30, 30), (30, 1, 13), (7, 9, 63), (50, 4, 41)])
@pytest.mark.parametrize("shift", [False, True])
def test_rows_of_a_lattice_differ_by_one_cell_at_most(height, width, n, shift):
    labels = lattice(height, width, n, shift=shift)
    assert sorted(set(labels.ravel())) == list(range(n))
    counts = {len(row) for row in {tuple(sorted(set(row))) for row in labels.tolist()}}
    assert max(counts) - min(counts) <= 1


@pytest.mark.parametrize("init", [*BUILT_IN[:4], InLayers()], ids=[*NAMES[:4], "layers"])
@pytest.mark.parametrize("degrees", [0, 30, 45, 90, 120])
def test_strokes_follow_the_stripes_of_the_picture(init, degrees):
    strokes = made(init, stripes(96, 144, degrees), 200)
    along = strokes.end - strokes.start
    inside = (strokes.position > 8).all(1) & (strokes.position < torch.tensor([136, 88])).all(1)
    angle = torch.atan2(along[:, 1], along[:, 0]).rad2deg()[inside]
    deviation = (angle - degrees + 90) % 180 - 90
    assert (deviation.abs() < 10).float().mean() > 0.95


@pytest.mark.parametrize("init", BUILT_IN[:4], ids=NAMES[:4])
def test_the_control_point_is_midway_and_the_window_is_a_few_strokes_wide(init):
    strokes = made(init, noise(40, 60), 24)
    assert_close(strokes.control, (strokes.start + strokes.end) / 2)
    assert_close(strokes.scale, torch.full((24,), 64.0), msg="64 px at 100 px per stroke, as in the thesis")
    assert strokes.start.abs().max() < 1


@pytest.mark.parametrize("init", [Grid(orient="random"), BUILT_IN[4]], ids=["grid", "slic"])
def test_the_random_start_is_that_of_the_thesis(init):
    strokes = made(init, noise(100, 120), 1200)
    points = torch.stack([strokes.start, strokes.control, strokes.end])
    assert_close(points.std(), torch.tensor(0.1), atol=0.005, rtol=0)
    assert_close(points.mean(), torch.tensor(0.0), atol=0.005, rtol=0)
    assert_close(strokes.width, torch.full((1200,), 0.03))


def test_more_strokes_lie_where_the_picture_has_detail_and_layers_go_from_large_to_small_ones():
    target = torch.full((3, 60, 90), 0.5)
    target[:, :, 60:] = noise(60, 30)  # a third of the canvas
    inits = Slic(detail=0.0), Slic(), build_named("init", "scatter", {"detail": 0.7})
    even, *shares = (float((made(init, target, 150).position[:, 0] > 60).float().mean()) for init in inits)
    assert min(shares) > max(0.5, even)
    target = torch.full((3, 60, 90), 0.5)
    target[:, :, 60:] = noise(60, 30)
    strokes = made(InLayers(ratio=0.5, cover=0.5, jitter=0), target, 140)
    sizes, counts = (strokes.width * strokes.scale).round(decimals=4).unique(return_counts=True)
    assert_close(sizes[1:] / sizes[:-1], torch.full((2,), 2.0), atol=1e-3, rtol=0)
    assert counts.tolist() == [80, 40, 20]
    is_right = (strokes.position[:, 0] > 60).float()
    right = [float(is_right[strokes.scale == scale].mean()) for scale in strokes.scale.unique()]
    assert right[0] > 0.6
    assert 0.5 > right[2] > 0.2  # the lowest layer is everywhere: a third of it lies here


def test_an_underpainting_is_broad_reaches_the_edges_and_stops_at_none():
    stripes = (torch.arange(90) // 6 % 2).float().expand(3, 60, -1).contiguous()
    target = 0.5 * stripes + 0.5 * stripes[:, :, :60].transpose(1, 2).repeat(1, 1, 2)[:, :60, :90]
    plain, under = (made(InLayers(ratio=0.5, jitter=0, underpainting=on), target, 140) for on in (False, True))
    lowest = under.scale == under.scale.max()
    assert_close(under.width[lowest], 1.5 * plain.width[lowest])
    length, full = ((strokes.end - strokes.start).norm(dim=1) for strokes in (plain, under))
    assert (full[lowest] >= length[lowest] - 1e-5).all()
    assert full[lowest].mean() > 1.2 * length[lowest].mean()
    for strokes in (plain, under):
        assert strokes.position[lowest].amin(0).max() < 1
    assert all(torch.equal(getattr(plain, name)[~lowest], getattr(under, name)[~lowest]) for name in FIELDS)


def test_strokes_in_layers_end_where_the_picture_has_another_colour_and_bend_with_it():
    disc = torch.zeros(1, 80, 80)
    y, x = torch.meshgrid(torch.arange(80) - 39.5, torch.arange(80) - 39.5, indexing="ij")
    disc[:, (x.square() + y.square()) < 30**2] = 1
    strokes = made(InLayers(layers=1, jitter=0), disc.expand(3, -1, -1).contiguous(), 300)
    curve = strokes.position[:, None] + torch.stack([strokes.start, strokes.end], 1) * strokes.scale[:, None, None] / 2
    ends = (curve - 40).norm(dim=2)
    light = strokes.color[:, 0] > 0.9
    assert (ends[light] < 34).all()
    assert (ends[strokes.color[:, 0] < 0.1] > 26).all()
    around = light & ((strokes.position - 40).norm(dim=1) > 24)
    radius = strokes.position[around] - 40
    along = strokes.end[around] - strokes.start[around]
    cosine = (radius * along).sum(1).abs() / (radius.norm(dim=1) * along.norm(dim=1))
    assert cosine.median() < 0.15, "along the edge, not across"


def test_calm_strokes_lie_nearly_level_where_nothing_is_and_along_edges_as_ever():
    target = torch.full((3, 120, 200), 0.4)
    target[:, :, 20:24] = 0.9  # a mast in an empty sky
    plain, calm = (made(InLayers(layers=1, jitter=0, calm=weight), target, 150) for weight in (0.0, 0.3))
    steep = [
        (strokes.end - strokes.start)[:, 1].abs() / (strokes.end - strokes.start).norm(dim=1)
        for strokes in (plain, calm)
    ]
    sky, mast = plain.position[:, 0] > 80, (plain.position[:, 0] - 22).abs() < 6
    assert steep[0][sky].median() > 0.9, "parallel to the mast, far as it is"
    assert steep[1][sky].median() < 0.4
    assert steep[1][sky].std() > 0.02, "and not ruled"
    assert min(float(turned[mast].median()) for turned in steep) > 0.9


def test_differences_in_shadows_count_as_those_in_the_light_if_they_are_to():
    target = 0.1 + 0.05 * noise(60, 90)
    target[:, :, 45:] = 0.7 + 0.1 * noise(60, 45)  # twice the difference, a seventh of it relative to the light
    dark = [
        float((strokes.position[strokes.scale < strokes.scale.max(), 0] < 45).float().mean())
        for strokes in (made(InLayers(jitter=0, shadows=share), target, 200) for share in (0.0, 1.0))
    ]
    assert dark[0] < 0.35
    assert dark[1] > 0.6


@pytest.mark.parametrize("cls", [Grid, OVERLAPPING, Slic])
def test_jitter_makes_seeds_differ_and_nothing_else(cls):
    target = noise(30, 44)
    plain, one, other = made(cls(jitter=0), target, 60), made(cls(), target, 60, 1), made(cls(), target, 60, 2)
    pitch = math.sqrt(30 * 44 / 60)
    for jittered in (one, other):
        shift = (jittered.position - plain.position) / pitch
        assert 0.01 < float(shift.std()) < 0.03
        assert all(torch.equal(getattr(jittered, name), getattr(plain, name)) for name in FIELDS if name != "position")
