"""Check that brush simulators (engines) give valid, reproducible pictures with the paint in the right place."""

import torch
from torch import Tensor

from brushexp.contracts.families import Simulated
from brushexp.contracts.strokes import parameters_of, sample_prior, strokes_of
from brushexp_testing.families import Check, Make

WINDOW = 32
EXTREMES = [
    [-0.5, 0, 0, 0.2, 0.5, 0, -1.3529, 0, 0, 0],  # no width
    [-0.5, 0, 0, 0.2, 0.5, 0, -30, 0, 0, 0],  # less than no width
    [-0.5, 0, 0, 0.2, 0.5, 0, 10.41, 0, 0, 0],  # as wide as the window
    [0.3, 0.1, 0.3, 0.1, 0.3, 0.1, 0, 0, 0, 0],  # no length
    [0.3, 0.1, 0.3, 0.1, 0.3, 0.1, -1.3529, 0, 0, 0],  # no length, no width
    [0.3, 0.1, -0.6, 0.1, 0.3, 0.1, 0, 0, 0, 0],  # back and forth
    [-0.5, 0, 3, -40, 0.5, 0, 0, 0, 0, 0],  # control far outside
    [5, 5, 6, 5, 7, 6, 0, 0, 0, 0],  # all outside
    [-1e30, 1e30, 1e30, -1e30, 3e38, 3e38, 3e38, -3e38, 3e38, 1e30],  # out of all bounds
    [-0.5, 0, 0, 0.2, 0.5, 0, 0, -3, 3, 1.5],  # colour outside
]


def _valid(n: int) -> Tensor:
    return parameters_of(sample_prior(n, seed=4))


def _distances(parameters: Tensor) -> Tensor:
    """Compute the distance (n, S, S) from each pixel's centre to each stroke's curve, in window sides."""
    strokes = strokes_of(parameters)
    t = torch.linspace(0, 1, 101)[:, None, None]
    curve = (1 - t) ** 2 * strokes.start + 2 * t * (1 - t) * strokes.control + t**2 * strokes.end  # (101, n, 2)
    middle = 2 * (torch.arange(WINDOW) + 0.5) / WINDOW - 1
    y, x = torch.meshgrid(middle, middle, indexing="ij")
    offset = torch.stack([x, y], dim=-1) - curve[:, :, None, None]
    return 0.5 * offset.norm(dim=-1).amin(0)


def _is_simulated(parameters: Tensor, simulated: Simulated) -> None:
    n = len(parameters)
    assert simulated.images.shape == (n, 4, WINDOW, WINDOW)
    assert simulated.heights.shape == (n, WINDOW, WINDOW)
    for values, most in ((simulated.images, 1), (simulated.heights, torch.inf)):
        assert values.dtype == torch.float32
        assert ((values >= 0) & (values <= most) & values.isfinite()).all()


def returns_pictures_and_heights(make: Make) -> None:
    """Check that each stroke leaves paint in its window, but none in the top left corner.

    Pixels without paint must have the stroke's own colour.
    """
    engine, parameters = make(window=WINDOW), _valid(6).requires_grad_()
    simulated = engine(parameters, seed=1)
    _is_simulated(parameters, simulated)
    assert not simulated.images.requires_grad
    assert torch.equal(parameters, _valid(6))
    assert engine.window == WINDOW
    assert (simulated.images[:, 3].amax((1, 2)) > 0.2).all()
    assert (simulated.heights.amax((1, 2)) > 0).all()
    color, alpha = simulated.images.split([3, 1], dim=1)
    assert (alpha[..., 0, 0] == 0).all()
    bare = (alpha == 0).expand_as(color)
    own = strokes_of(parameters).color[:, :, None, None].expand_as(color)
    torch.testing.assert_close(color[bare], own[bare])


def is_independent_of_batch(make: Make) -> None:
    """Check that a stroke gives the same result whether the whole set or only a part of it is simulated."""
    engine, parameters = make(window=WINDOW), _valid(6)
    whole = engine(parameters, seed=3, first=5)
    for start, stop in ((0, 1), (2, 3), (2, 6)):
        part = engine(parameters[start:stop], seed=3, first=5 + start)
        assert all(torch.equal(value, vars(whole)[name][start:stop]) for name, value in vars(part).items())


def is_reproducible_on_any_number_of_threads(make: Make) -> None:
    """Check that results are bit-for-bit identical for any number of threads, for seeds from 0 to 2**64 - 1."""
    engine, parameters, threads = make(window=WINDOW), _valid(6), torch.get_num_threads()
    for seed in (0, 2**63, 2**64 - 1):
        one = engine(parameters, seed=seed)
        try:
            torch.set_num_threads(threads + 1)
            two = engine(parameters, seed=seed)
        finally:
            torch.set_num_threads(threads)
        assert all(torch.equal(value, vars(two)[name]) for name, value in vars(one).items())


def draws_extreme_strokes(make: Make) -> None:
    """Check that extreme strokes and empty sets give valid pictures, and do not affect the other strokes."""
    engine, alone = make(window=WINDOW), _valid(1)
    parameters = torch.cat([torch.tensor(EXTREMES), alone])
    simulated = engine(parameters, seed=1)
    _is_simulated(parameters, simulated)
    assert torch.equal(simulated.images[-1:], engine(alone, seed=1, first=len(EXTREMES)).images)
    _is_simulated(parameters[:0], engine(parameters[:0], seed=1))


def paints_on_the_stroke(make: Make) -> None:
    """Check that most of the paint is within the stroke's outline, and that it covers much of the stroke."""
    parameters = _valid(12)
    alpha = make(window=WINDOW)(parameters, seed=1).images[:, 3]
    width, distance = strokes_of(parameters).width[:, None, None], _distances(parameters)
    near = distance <= 0.5 * width + 2 / WINDOW
    share = (alpha * near).sum((1, 2)) / alpha.sum((1, 2))
    assert share.min() > 0.6
    assert share.mean() > 0.8
    covered = (alpha * near).sum((1, 2)) / (distance <= 0.5 * width).sum((1, 2)).clamp_min(1)
    assert covered.min() > 0.25


def centres_the_paint_on_the_stroke(make: Make) -> None:
    """Check that the paint is centred on a straight stroke, and that a wider stroke covers a larger area."""
    parameters = torch.tensor([[-0.6, 0.3, 0, 0.3, 0.6, 0.3, w, 0, 0, 0] for w in (-1.0, 0.0, 1.0)])
    alpha = make(window=WINDOW)(parameters, seed=1).images[:, 3]
    middle = (torch.arange(WINDOW) + 0.5) / WINDOW
    x = (alpha.sum(1) * middle).sum(1) / alpha.sum((1, 2))
    y = (alpha.sum(2) * middle).sum(1) / alpha.sum((1, 2))
    assert (x - 0.5).abs().max() < 0.06
    assert (y - 0.65).abs().max() < 0.04
    assert (alpha.mean((1, 2)).diff() > 0.01).all()


def rotates_with_the_stroke(make: Make) -> None:
    """Check that rotating a stroke by 90 degrees rotates its picture, apart from its random texture."""
    engine = make(window=WINDOW)
    parameters = torch.tensor([[-0.6, 0.3, 0.1, -0.4, 0.5, 0.1, 0.5, 0, 0, 0]]).repeat(24, 1)  # grains average out
    turned = parameters.clone()
    turned[:, 0:6:2], turned[:, 1:6:2] = -parameters[:, 1:6:2], parameters[:, 0:6:2]
    straight, round_the_corner = (engine(p, seed=1).images[:, 3].mean(0) for p in (parameters, turned))
    off = torch.nn.functional.avg_pool2d((round_the_corner - torch.rot90(straight, -1))[None], 4).abs()
    assert off.max() < 0.2
    assert off.mean() < 0.03


CHECKS: list[Check] = [
    returns_pictures_and_heights,
    is_independent_of_batch,
    is_reproducible_on_any_number_of_threads,
    draws_extreme_strokes,
    paints_on_the_stroke,
    centres_the_paint_on_the_stroke,
    rotates_with_the_stroke,
]
