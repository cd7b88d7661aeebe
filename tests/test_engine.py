"""Every brush simulator keeps the contract; the plain ones also agree with obvious loops."""

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

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
