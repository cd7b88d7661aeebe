"""Test that each step of the brush simulators agrees with a simple implementation, and that strokes look right."""

import numpy as np
import pytest
import torch
from brushexp_training.engine import _bristles, _deposition
from brushexp_training.engine.fluid import Fluid
from torch.testing import assert_close

from brushexp.registry import build_named
from brushexp.strokes.prior import parameters_of, sample_prior, strokes_of

RNG = np.random.default_rng(0)
V = _bristles.VERTICES


def stroke(start, control, end, *, width=0.1):
    """Return one stroke (1, 10), given its points in half-windows."""
    return torch.tensor([[*start, *control, *end, (2 * width - 0.23) / 0.17, -0.6, 0.0, 0.6]])


def one_frame_of_one_bristle(p, velocity, root, scale, stiffness, gravity, damping, iterations):
    """Compute what `move` does for one bristle, vertex by vertex in float64; p and velocity are (V, 3)."""
    q = p + damping * velocity - np.array([0, 0, gravity])
    weight = [0.0] + [1.0] * (len(p) - 1)
    for _ in range(iterations):
        q[0] = root
        for begin in (0, 1):
            for a in range(begin, len(p) - 1, 2):
                way = q[a + 1] - q[a]
                d = np.linalg.norm(way)
                push = (d - 0.5 * scale) * way / max(d, 0.01) / (weight[a] + weight[a + 1])
                q[a] += weight[a] * push
                q[a + 1] -= weight[a + 1] * push
        for begin in (0, 1, 2):
            for a in range(begin, len(p) - 2, 3):
                first, second = q[a + 1] - q[a], q[a + 2] - q[a + 1]
                l1, l2 = np.linalg.norm(first), np.linalg.norm(second)
                first, second = first / l1, second / l2
                dot = first @ second
                if dot > 0:
                    ga, gc = (dot * first - second) / max(l1, 1e-4), (first - dot * second) / max(l2, 1e-4)
                    gb = -ga - gc
                    size = weight[a] * ga @ ga + gb @ gb + gc @ gc
                    factor = stiffness * (dot - 1) / max(size, 1e-4)
                    q[a] -= weight[a] * factor * ga
                    q[a + 1] -= factor * gb
                    q[a + 2] -= factor * gc
        q[:, 2] = np.where(q[:, 2] < 0, 0.5 * q[:, 2], q[:, 2])
    return q, q - p


def test_bristles_move_as_one_by_one():
    n, scale = 3, 6.0
    roots = RNG.uniform(-0.7, 0.7, (2, n)).astype(np.float32)
    stiffness = RNG.uniform(0, 0.3, n).astype(np.float32)
    p = np.empty((3, V, n), np.float32)
    p[:2] = scale * (roots[:, None] + RNG.normal(0, 0.2, (2, V, n)))
    p[2] = scale * np.linspace(2, 0.1, V)[:, None]
    velocity, before, q = np.zeros_like(p), np.empty_like(p), np.empty_like(p)
    slow, f = [(p[:, :, i].T.astype(float), np.zeros((V, 3))) for i in range(n)], np.float32
    for x in (1.0, 3.0):
        _bristles.move(p, velocity, before, q, roots, f(x), f(0), f(scale), stiffness, f(30), f(0.75), 4)
        for i in range(n):
            root = np.array([x + scale * roots[0, i], scale * roots[1, i], 2 * scale])
            slow[i] = one_frame_of_one_bristle(*slow[i], root, scale, float(stiffness[i]), 30.0, 0.75, 4)
            np.testing.assert_allclose(p[:, :, i].T, slow[i][0], atol=2e-3)
            np.testing.assert_allclose(velocity[:, :, i].T, slow[i][1], atol=2e-3)


def test_a_resting_brush_lies_on_the_canvas_and_is_as_long_as_it_should():
    brush = Fluid()
    brush(stroke((-0.5, 0), (0, 0), (0.5, 0)), seed=0)
    (pose,) = brush._poses
    segments = np.linalg.norm(np.diff(pose, axis=1), axis=0)  # in brush radii
    assert np.abs(segments - 0.5).mean() < 0.02
    assert pose[2].min() > -0.05
    assert np.abs(pose[2, 5:]).mean() < 0.1
    assert pose[0, -1].mean() < -1, "the brush trails behind the handle"


def test_splats_keep_the_amount_of_paint_on_any_grid():
    scale, opacity, n = 8.0, 0.02, 5
    p = np.zeros((3, V, n), np.float32)
    p[:2] = RNG.uniform(80, 170, (2, V, n))
    before = p + RNG.uniform(-10, 10, p.shape).astype(np.float32)
    before[2] = 0
    t = (np.arange(8)[:, None, None] + 0.5) / 8
    now, then = (s[:2, None, :-1] + t * (s[:2, None, 1:] - s[:2, None, :-1]) for s in (p, before))
    radius, ways = 0.05 * scale, np.linalg.norm(now - then, axis=0)
    expected = (opacity * (radius * ways + np.pi / 3 * radius**2)).sum()  # max(1 - d / R, 0) over all capsules
    for side in (66, 258, 514):
        grid, area = np.zeros((3, side * side), np.float32), np.array([side, -1, side, -1])
        _deposition._splat(p, before, p - before, *map(np.float32, (scale, opacity, 0)), side, grid, area)
        assert grid[0].sum() * (256 / (side - 2)) ** 2 == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("radius", [0.7, 2.5, 6.2])
def test_splats_have_their_radius_on_a_fine_grid(radius):
    side = 40
    grid, scratch, area = np.zeros((3, side, side), np.float32), np.zeros((3, side * side)), np.array([18, 21, 15, 20])
    grid[:, 18:22, 15:21] = RNG.uniform(0, 1, (3, 4, 6))
    wide = np.sqrt(max(radius**2 - 1, 0))
    weight = np.maximum(1 - np.abs(np.arange(-9, 10)) / max(wide, 1), 0)
    expected = grid.astype(float)
    for axis in (1, 2):
        expected = np.apply_along_axis(np.convolve, axis, expected, weight / weight.sum(), "same")
    _deposition._widen(grid.reshape(3, -1), scratch, side, area, np.float32(radius))
    np.testing.assert_allclose(grid, expected, atol=1e-5)
    outside = np.ones((side, side), bool)
    outside[area[0] : area[1] + 1, area[2] : area[3] + 1] = False
    assert not grid[:, outside].any()


def test_the_closed_form_of_a_frame_agrees_with_splat_after_splat():
    splats, side = RNG.uniform(0, 0.025, 200), 4
    cover = 1 - 0.7 * np.prod(1 - splats)
    grid, state = np.zeros((3, side * side), np.float32), np.zeros((4, side * side), np.float32)
    grid[0, 5], state[2, 5] = splats.sum(), 0.3
    _deposition._lay(grid, state, side, np.array([1, 2, 1, 2]))
    assert state[2, 5] == pytest.approx(cover, abs=0.005)
    assert state[3, 5] == pytest.approx(splats.sum(), rel=1e-5)
    assert not grid.any(), "the grid is cleared for the next frame"


def flow(side):
    """Return a smooth flow (2, side, side) that is 0 at the margin."""
    y, x = np.mgrid[:side, :side] / side * 2 * np.pi
    field = np.stack([np.sin(x) * np.cos(2 * y), np.cos(x + 1) * np.sin(y)]).astype(np.float32)
    field[:, [0, -1]] = field[:, :, [0, -1]] = 0
    return field


@pytest.mark.parametrize("rounds", [0, 1, 2, 7])
def test_projection_agrees_with_whole_arrays(rounds):
    side = 18
    state = np.zeros((4, side * side), np.float32)
    state[:2] = flow(side).reshape(2, -1)
    before = state[:2].reshape(2, side, side).astype(float)
    scratch, area = np.zeros((3, side * side), np.float32), np.array([1, side - 2, 1, side - 2])
    _deposition._project(state, scratch, side, area, rounds)
    pressure = np.zeros((side, side))
    divergence = 0.5 * (before[0, 1:-1, 2:] - before[0, 1:-1, :-2] + before[1, 2:, 1:-1] - before[1, :-2, 1:-1])
    for _ in range(rounds):
        near = pressure[1:-1, :-2] + pressure[1:-1, 2:] + pressure[:-2, 1:-1] + pressure[2:, 1:-1]
        pressure[1:-1, 1:-1] = (near - divergence) / 4
    before[0, 1:-1, 1:-1] -= 0.5 * (pressure[1:-1, 2:] - pressure[1:-1, :-2])
    before[1, 1:-1, 1:-1] -= 0.5 * (pressure[2:, 1:-1] - pressure[:-2, 1:-1])
    np.testing.assert_allclose(state[:2].reshape(2, side, side), before, atol=1e-6)


def bilinear(field, x, y):
    """Interpolate a flat or stacked field (..., side, side) between its cells."""
    x, y = np.clip(x, 1, field.shape[-1] - 2.001), np.clip(y, 1, field.shape[-1] - 2.001)
    ix, iy = int(x), int(y)
    fx, fy = x - ix, y - iy
    low = (1 - fx) * field[..., iy, ix] + fx * field[..., iy, ix + 1]
    return (1 - fy) * low + fy * ((1 - fx) * field[..., iy + 1, ix] + fx * field[..., iy + 1, ix + 1])


def test_advection_agrees_with_cell_by_cell():
    side = 18
    state = RNG.uniform(0, 1, (4, side, side)).astype(np.float32)
    state[:2] = 5 * flow(side)
    new = np.zeros((4, side * side), np.float32)
    _deposition._advect(state.reshape(4, -1), new, side, np.array([1, side - 2, 1, side - 2]), np.float32(0.8))
    dt, decay = 100 / 60 * (side - 2) / 256, np.array([0.8, 0.8, 1, 1])
    for y, x in np.ndindex(side, side):
        if 0 < y < side - 1 and 0 < x < side - 1:
            half = bilinear(state[:2], x - dt / 2 * state[0, y, x], y - dt / 2 * state[1, y, x])
            expected = decay * bilinear(state, x - dt * half[0], y - dt * half[1])
            np.testing.assert_allclose(new.reshape(4, side, side)[:, y, x], expected, atol=2e-5)


def test_flat_paint_shows_the_recorded_colour_and_bristles_streaks_of_the_brush_of_a_stroke():
    parameters = parameters_of(sample_prior(100, seed=3))
    images = Fluid(relief=0.0)(parameters, seed=0).images
    color = 0.5 * (parameters[:, 7:] + 1)
    torch.testing.assert_close(images[:, :3], color[:, :, None, None].expand(-1, -1, 64, 64), atol=1e-5, rtol=0)
    images = Fluid()(parameters, seed=0).images
    off = ((images[:, :3] - color[:, :, None, None]).abs().mean(1) * images[:, 3]).sum() / images[:, 3].sum()
    assert off < 0.015, "light on the ridges hardly changes the colour"
    # Across the stroke, the paint rises and falls more often than a smooth profile, which does so once.
    alpha = Fluid(window=256, supersample=1)(stroke((-0.7, 0), (0, 0), (0.7, 0), width=0.19), seed=0).images[0, 3]
    across = alpha[:, 118:138].mean(1)
    rises = ((across[1:-1] > across[:-2] + 1e-3) & (across[1:-1] > across[2:] + 1e-3)).sum()
    assert rises >= 4
    parameters = stroke((-0.5, 0), (0, 0.1), (0.5, 0)).expand(4, 10)
    same, other = (Fluid()(parameters, seed=seed).images for seed in (0, 1))
    images = Fluid(brushes=2)(parameters, seed=0).images
    torch.testing.assert_close(same[0], same[3])
    assert torch.equal(images[:2], images[2:])
    assert not torch.equal(images[0], images[1])
    assert not torch.equal(same, other)


@pytest.mark.parametrize("option", ["projection", "fluidity", "load", "after", "jacobi", "stiffness", "gravity"])
def test_every_setting_of_the_physics_matters(option):
    other = {"projection": False, "fluidity": 0.3, "load": 0.3, "after": 30, "jacobi": 20, "stiffness": 0.9}
    parameters = stroke((-0.5, 0), (0, 0.3), (0.5, 0), width=0.2)
    plain = Fluid()(parameters, seed=0).images
    assert not torch.equal(Fluid(**{option: other.get(option, 3.0)})(parameters, seed=0).images, plain)


def test_strokes_of_the_prior_stay_in_their_windows_and_a_fuller_load_covers_more():
    alpha = Fluid()(parameters_of(sample_prior(300, seed=1)), seed=0).images[:, 3]
    edge = torch.cat([alpha[:, 0], alpha[:, -1], alpha[:, :, 0], alpha[:, :, -1]], 1)
    assert (edge.max(1).values > 0.1).float().mean() < 0.01
    parameters = parameters_of(sample_prior(4))
    for bristles in (100, 140, 200):
        little, much = (Fluid(window=32, bristles=bristles, load=load)(parameters, seed=0) for load in (0.1, 1.0))
        assert float(much.images[:, 3].mean()) > 1.1 * float(little.images[:, 3].mean()), bristles


WINDOW = 32


def test_discs_agree_with_the_loop():
    parameters, side = parameters_of(sample_prior(3, seed=4)), 2 * WINDOW
    y, x = np.mgrid[:side, :side] + 0.5
    drawn = build_named("engine", "disc", {"window": WINDOW})(parameters, seed=1).images[:, 3]
    strokes = strokes_of(parameters.double())
    fields = (getattr(strokes, name).numpy() for name in ("start", "control", "end", "width"))
    for alpha, start, control, end, width in zip(drawn, *fields, strict=True):
        canvas = np.zeros((side, side))
        for t in np.arange(100) / 100:
            u, v = ((1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end + 1) * side / 2
            canvas[np.hypot(x - u, y - v) <= width * side / 2] = 1
        assert_close(alpha, torch.from_numpy(canvas.reshape(WINDOW, 2, WINDOW, 2).mean((1, 3))).float())
