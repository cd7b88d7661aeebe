"""Every brush simulator keeps the contract; the plain ones also agree with obvious loops."""

import math

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from brushexp.errors import UserError
from brushexp.plugins.engine.base import Simulated
from brushexp.registry import build_named, plugins
from brushexp.strokes.prior import parameters_of, sample_prior, strokes_of

WINDOW = 32
EXTREMES = [
    [-0.5, 0, 0, 0.2, 0.5, 0, -1.3529, 0, 0, 0],  # no width
    [-0.5, 0, 0, 0.2, 0.5, 0, -30, 0, 0, 0],  # less than that
    [-0.5, 0, 0, 0.2, 0.5, 0, 10.41, 0, 0, 0],  # as wide as the window
    [0.3, 0.1, 0.3, 0.1, 0.3, 0.1, 0, 0, 0, 0],  # no length
    [0.3, 0.1, 0.3, 0.1, 0.3, 0.1, -1.3529, 0, 0, 0],  # neither
    [0.3, 0.1, -0.6, 0.1, 0.3, 0.1, 0, 0, 0, 0],  # back and forth
    [-0.5, 0, 3, -40, 0.5, 0, 0, 0, 0, 0],  # control far outside
    [5, 5, 6, 5, 7, 6, 0, 0, 0, 0],  # all outside
    [-1e30, 1e30, 1e30, -1e30, 3e38, 3e38, 3e38, -3e38, 3e38, 1e30],  # out of all bounds
    [-0.5, 0, 0, 0.2, 0.5, 0, 0, -3, 3, 1.5],  # colour outside
]


@pytest.fixture(scope="module", params=[plugin.name for plugin in plugins("engine")])
def engine(request):
    return build_named("engine", request.param, {"window": WINDOW})


def valid(n: int) -> Tensor:
    return parameters_of(sample_prior(n, seed=4))


def distances(parameters: Tensor) -> Tensor:
    """From every pixel's centre to the curves, (n, S, S), windows."""
    strokes = strokes_of(parameters)
    t = torch.linspace(0, 1, 101)[:, None, None]
    curve = (1 - t) ** 2 * strokes.start + 2 * t * (1 - t) * strokes.control + t**2 * strokes.end  # (101, n, 2)
    middle = 2 * (torch.arange(WINDOW) + 0.5) / WINDOW - 1
    y, x = torch.meshgrid(middle, middle, indexing="ij")
    offset = torch.stack([x, y], dim=-1) - curve[:, :, None, None]
    return 0.5 * offset.norm(dim=-1).amin(0)


def check(parameters: Tensor, painted: Simulated) -> None:
    n = len(parameters)
    assert painted.images.shape == (n, 4, WINDOW, WINDOW)
    assert painted.heights.shape == (n, WINDOW, WINDOW)
    for values in (painted.images, painted.heights):
        assert values.dtype == torch.float32
        assert (values >= 0).all()
        assert values.isfinite().all()
    assert (painted.images <= 1).all()


def test_an_engine_returns_what_the_contract_says(engine):
    parameters = valid(6).requires_grad_()
    painted = engine(parameters, seed=1)
    check(parameters, painted)
    assert not painted.images.requires_grad
    assert torch.equal(parameters, valid(6))
    assert engine.window == WINDOW
    assert (painted.images[:, 3].amax((1, 2)) > 0.2).all()
    assert (painted.heights.amax((1, 2)) > 0).all()
    color, alpha = painted.images.split([3, 1], dim=1)
    assert_close(alpha[..., 0, 0], torch.zeros(6, 1))
    bare = (alpha == 0).expand_as(color)
    assert_close(color[bare], strokes_of(parameters).color[:, :, None, None].expand_as(color)[bare])


def test_a_stroke_depends_on_its_number_and_not_on_its_batch(engine):
    parameters = valid(6)
    whole = engine(parameters, seed=3, first=5)
    for start, stop in ((0, 1), (2, 3), (2, 6)):
        part = engine(parameters[start:stop], seed=3, first=5 + start)
        assert torch.equal(part.images, whole.images[start:stop])
        assert torch.equal(part.heights, whole.heights[start:stop])


@pytest.mark.parametrize("seed", [0, 2**63, 2**64 - 1])
def test_every_seed_is_taken_and_gives_the_same_again_on_any_number_of_threads(engine, seed):
    parameters = valid(6)
    one = engine(parameters, seed=seed)
    try:
        torch.set_num_threads(2)
        two = engine(parameters, seed=seed)
    finally:
        torch.set_num_threads(1)
    assert torch.equal(one.images, two.images)
    assert torch.equal(one.heights, two.heights)


def test_anything_finite_is_drawn_and_leaves_its_neighbours_alone(engine):
    alone = valid(1)
    parameters = torch.cat([torch.tensor(EXTREMES), alone])
    painted = engine(parameters, seed=1)
    check(parameters, painted)
    assert torch.equal(painted.images[-1:], engine(alone, seed=1, first=len(EXTREMES)).images)
    check(parameters[:0], engine(parameters[:0], seed=1))


def test_paint_lies_where_the_stroke_is(engine):
    parameters = valid(12)
    alpha = engine(parameters, seed=1).images[:, 3]
    width = strokes_of(parameters).width[:, None, None]
    near = distances(parameters) <= 0.5 * width + 2 / WINDOW
    share = (alpha * near).sum((1, 2)) / alpha.sum((1, 2))
    assert share.min() > 0.6
    assert share.mean() > 0.8
    covered = (alpha * near).sum((1, 2)) / (distances(parameters) <= 0.5 * width).sum((1, 2)).clamp_min(1)
    assert covered.min() > 0.25


def test_the_centre_of_the_paint_is_the_centre_of_the_stroke(engine):
    parameters = torch.tensor([[-0.6, 0.3, 0, 0.3, 0.6, 0.3, w, 0, 0, 0] for w in (-1.0, 0.0, 1.0)])
    alpha = engine(parameters, seed=1).images[:, 3]
    middle = (torch.arange(WINDOW) + 0.5) / WINDOW
    x = (alpha.sum(1) * middle).sum(1) / alpha.sum((1, 2))
    y = (alpha.sum(2) * middle).sum(1) / alpha.sum((1, 2))
    assert_close(x, torch.full((3,), 0.5), atol=0.06, rtol=0)
    assert_close(y, torch.full((3,), 0.65), atol=0.04, rtol=0)
    assert (alpha.mean((1, 2)).diff() > 0.01).all(), "a wider stroke covers more"


def test_a_turned_stroke_is_a_turned_picture(engine):
    parameters = torch.tensor([[-0.6, 0.3, 0.1, -0.4, 0.5, 0.1, 0.5, 0, 0, 0]]).repeat(24, 1)  # grains average out
    turned = parameters.clone()
    turned[:, 0:6:2], turned[:, 1:6:2] = -parameters[:, 1:6:2], parameters[:, 0:6:2]
    straight, round_the_corner = (engine(p, seed=1).images[:, 3].mean(0) for p in (parameters, turned))
    off = torch.nn.functional.avg_pool2d((round_the_corner - torch.rot90(straight, -1))[None], 4).abs()
    assert off.max() < 0.2
    assert off.mean() < 0.03


def test_dabs_differ_from_number_to_number_and_from_seed_to_seed():
    engine = build_named("engine", "dabs", {"window": WINDOW})
    parameters = valid(1).repeat(2, 1)
    first, second = engine(parameters, seed=1).images
    assert (first - second).abs().max() > 0.1
    assert (engine(parameters, seed=2).images[0] - first).abs().max() > 0.1


def test_discs_agree_with_the_loop():
    parameters, side = valid(3), 2 * WINDOW
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


LEVEL = torch.tensor([[-0.7, 0, 0, 0, 0.7, 0, 1.0, 0, 0, 0]])  # 0.2 windows wide


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
    engine = build_named("engine", "dabs", {"window": 64} | settings)
    profile = engine(LEVEL.repeat(100, 1), seed=1).images[:, 3, :, 24:40].mean((0, 2))
    half = 0.5 * profile[30:34].mean()
    assert_close((profile >= half).sum().item() / 64, 0.2, atol=2.5 / 64, rtol=0)


def test_a_dry_stroke_has_grain():
    inside = (slice(None), 3, slice(29, 35), slice(16, 48))
    dry, tube = (build_named("engine", name, {"window": 64})(LEVEL, seed=1).images for name in ("dabs", "disc"))
    assert dry[inside].std() > 0.1
    assert_close(tube[inside], torch.ones(1, 6, 32))


def test_one_dab_has_the_profile_of_libmypaint():
    h = 0.2
    settings = {"window": 64, "supersample": 8, "hardness": h, "offset_by_random": 0.0, "radius_by_random": 0.0}
    engine = build_named("engine", "dabs", settings | {"pressure": 0.5, "end_pressure": 0.5})
    alpha = engine(torch.tensor([[0.0] * 6 + [1.0] + [0.0] * 3]), seed=1).images[0, 3]
    radius = 0.1 / engine.half_width * 64
    middle = torch.arange(64) + 0.5 - 32
    rr = (middle[:, None] ** 2 + middle**2) / radius**2
    inner, outer = 1 - rr * (1 / h - 1), h / (1 - h) * (1 - rr)
    expected = (0.8 + 0.2 * 0.5) * 0.5 * torch.where(rr <= h, inner, outer.clamp_min(0))
    assert_close(alpha, expected, atol=0.02, rtol=0)


def test_dabs_add_up_to_an_opacity_that_follows_the_pressure():
    from brushexp.plugins.engine._stamps import opacity_of, pressure_at  # noqa: PLC0415

    assert math.isclose(opacity_of(0.5, 0.8, 0.2, 0.0, 12.0), 0.45)
    assert math.isclose(1 - (1 - opacity_of(0.5, 0.8, 0.2, 1.0, 12.0)) ** 24, 0.45)
    assert opacity_of(1.0, 1.0, 1.0, 0.9, 12.0) == 1
    assert opacity_of(0.0, 0.8, 0.2, 0.9, 12.0) == 0
    for share, pressure in {0.0: 0.4, 0.125: 0.6, 0.25: 0.8, 0.5: 0.8, 0.75: 0.8, 0.875: 0.6, 1.0: 0.4}.items():
        assert math.isclose(pressure_at(share, 0.8, 0.4, 0.25, 0.75), pressure)
        assert math.isclose(pressure_at(share, 0.8, 0.4, 0.0, 1.0), 0.8)


def test_random_numbers_of_dabs_are_normal_and_independent():
    from brushexp.plugins.engine._stamps import _gauss  # noqa: PLC0415

    draws = np.array([[_gauss(np.uint64(key), counter) for counter in range(200)] for key in range(50)])
    assert abs(draws.var() - 1) < 5 * np.sqrt(2 / draws.size)
    for values in (draws, draws[:, 1:] * draws[:, :-1], draws[1:] * draws[:-1]):
        assert abs(values.mean()) < 5 / np.sqrt(values.size)


def test_a_head_that_ends_behind_the_tail_is_refused_with_the_cure():
    with pytest.raises(UserError, match=r"engine.head=0.8 is more than engine.tail=0.75; try engine.head=0.75"):
        build_named("engine", "dabs", {"head": 0.8})
