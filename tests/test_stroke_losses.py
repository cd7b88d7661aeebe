"""Losses of strokes against slow formulations, and their gradients; their extremes are in test_degenerate_losses."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from brushexp_discriminator.discriminator import Discriminated
from scenes import leaves, random_strokes
from torch import Tensor
from torch.distributions import MultivariateNormal, kl_divergence
from torch.testing import assert_close

from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.plugins.loss.curvature import Curvature
from brushexp.plugins.loss.direction import Direction
from brushexp.plugins.loss.kl import SHRINK, KullbackLeibler
from brushexp.plugins.loss.width import Width
from brushexp.strokes.bezier import curve_of
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.prior import INSET, clamp_to_prior, sample_prior

SIZE = (24, 40)
POINTS = ("start", "control", "end")
FIELDS = ("scale", *POINTS, "width")
WANTED = torch.diag(torch.tensor([1 / 200, 1 / 25], dtype=torch.float64))


def scene(n: int, seed: int = 0, dtype: torch.dtype = torch.float64, bend: float = 0.3) -> Strokes:
    return random_strokes(n, SIZE, seed=seed, dtype=dtype, bend=bend, width=(0.0, 0.5))


def of(points: list[list[float]], width: list[float]) -> Strokes:
    """Strokes of given start, control, end (N rows of 6, half-windows) and width."""
    table = torch.tensor(points, dtype=torch.float64)
    shape = dict(zip(POINTS, table.split(2, dim=1), strict=True))
    return replace(scene(len(width)), **shape, width=torch.tensor(width, dtype=torch.float64))


def judged(loss: Loss, strokes: Strokes) -> Tensor:
    nothing = strokes.color.new_zeros(3, *SIZE)
    return loss(PaintedView(nothing, nothing, strokes))


LOSSES = [Width(), KullbackLeibler(), Curvature(), Direction(k=4, every=10_000), Discriminated().double()]


@pytest.mark.parametrize("loss", LOSSES)
def test_they_have_the_right_slope(loss):
    made = scene(7)

    def value(*inputs: Tensor) -> Tensor:
        return judged(loss, replace(made, **dict(zip(FIELDS, inputs, strict=True))))

    assert torch.autograd.gradcheck(value, [getattr(made, name).clone().requires_grad_() for name in FIELDS])


def test_width_compares_length_and_thickness_in_sides_of_the_window():
    apart = [0.4, 0.0, 0, 0, -0.4, 0.0]  # 0.8 half-windows: 0.4 of the side
    for width, wanted in ((0.1, 0.0), (0.28, 0.0), (0.5, 0.3), (1.0, 1.0)):
        assert float(judged(Width(), of([apart], [width]))) == pytest.approx(wanted, abs=1e-12)
    made, total = scene(50), 0.0
    for start, end, width in zip(made.start.numpy(), made.end.numpy(), made.width.numpy(), strict=True):
        s, e = (start + 1) / 2, (end + 1) / 2  # as the thesis has them: 0 to 1 within the window
        total += max(0.0, 2 * INSET * width - np.hypot(*(s - e)))
    assert float(judged(Width(), made)) == pytest.approx(total / 50)


def test_width_leaves_the_ends_of_a_point_alone_and_thins_it():
    made = leaves(of([[0.1, 0.2, 0, 0, 0.1, 0.2]], [0.1]), torch.float64)
    value = judged(Width(), made)
    value.backward()
    assert float(value.detach()) == pytest.approx(0.14)
    assert (made.start.grad == 0).all()
    assert (made.end.grad == 0).all()
    assert made.control.grad is None
    assert made.width.grad.tolist() == pytest.approx([1.4])


def test_valid_strokes_cost_hardly_anything():
    for made in (sample_prior(5000), clamp_to_prior(scene(500, dtype=torch.float32))):
        assert float(judged(Width(), made)) < 1e-8
    assert float(judged(KullbackLeibler(), sample_prior(5000))) < 0.01


def textbook_divergence(made: Strokes) -> float:
    """The KL by projecting one control point after another, and torch's formula for two normal distributions."""
    rows = []
    for start, control, end in zip(made.start.numpy(), made.control.numpy(), made.end.numpy(), strict=True):
        length = np.hypot(*(start - end))
        along = (start - end) / length
        across = np.array([[0, -1], [1, 0]]) @ along
        offset = (control - (start + end) / 2) / length
        rows.append([offset @ along, offset @ across])
    bends = torch.tensor(np.array(rows))
    mean = bends.mean(0)
    covariance = (bends - mean).T @ (bends - mean) / len(bends)
    measured = MultivariateNormal(mean, (1 - SHRINK) * covariance + SHRINK * WANTED)
    return float(kl_divergence(measured, MultivariateNormal(torch.zeros(2, dtype=torch.float64), WANTED)))


@pytest.mark.parametrize(("n", "bend"), [(2, 0.5), (3, 5.0), (100, 0.7), (100, 50.0)])
def test_kl_agrees_with_the_textbook_and_depends_on_neither_size_nor_place(n, bend):
    made = scene(n, seed=n, bend=bend)
    made = made[torch.linalg.vector_norm(made.start - made.end, dim=1) > 0.2]
    assert float(judged(KullbackLeibler(), made)) == pytest.approx(textbook_divergence(made), rel=1e-9)
    other = replace(made, **{name: 3 * getattr(made, name) - 0.5 for name in POINTS})
    assert_close(judged(KullbackLeibler(), made), judged(KullbackLeibler(), other))


def textbook_direction(strokes: Strokes, k: int) -> float:
    """4 sin^2 of the angle between the principal axes of each stroke and its nearest ones, pair by pair."""
    t = torch.linspace(0, 1, 2001, dtype=torch.float64)[:, None]
    angle = []
    for start, control, end in curve_of(strokes):
        values, axes = torch.linalg.eigh(((1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end).T.cov())
        angle.append(math.atan2(float(axes[1, values.argmax()]), float(axes[0, values.argmax()])))
    pairs = [(i, j) for i, row in enumerate(nearest_middles(strokes, k).tolist()) for j in row]
    return sum(4 * math.sin(angle[i] - angle[j]) ** 2 for i, j in pairs) / len(pairs)


def nearest_middles(strokes: Strokes, k: int) -> Tensor:
    middles = curve_of(strokes).mean(1)
    return torch.cdist(middles, middles).argsort(1)[:, 1 : k + 1]


def test_curvature_agrees_with_the_loop():
    made = scene(40)
    total = 0.0
    for s, c, e in zip(made.start.numpy(), made.control.numpy(), made.end.numpy(), strict=True):
        (a, b), (x, y) = c - s, e - c
        total += abs((math.atan2(y, x) - math.atan2(b, a) + math.pi) % (2 * math.pi) - math.pi)
    assert float(judged(Curvature(), made)) == pytest.approx(total / 40, rel=1e-3)


@pytest.mark.parametrize("k", [1, 10, 60])
def test_direction_agrees_with_the_double_loop(k):
    made = scene(40, seed=k)
    assert float(judged(Direction(k=k), made)) == pytest.approx(textbook_direction(made, k), rel=5e-3)


def test_neighbours_are_kept_and_renewed_also_after_a_restart():
    loss, restarted = Direction(k=3, every=3), Direction(k=3, every=3)
    first, second = leaves(scene(20, seed=1), torch.float64), scene(20, seed=2)
    judged(loss, first).backward()
    assert first.start.grad.abs().sum() > 0
    assert first.position.grad is None, "which strokes are near has no slope"
    kept = loss.neighbours
    for _ in range(2):
        judged(loss, second)
        assert loss.neighbours is kept
    restarted.load_state_dict(loss.state_dict())
    judged(restarted, second)
    judged(loss, second)
    for one in (loss, restarted):
        assert torch.equal(one.neighbours, nearest_middles(second, 3))
    for n in (19, 2, 30):
        made = scene(n, seed=n)
        assert float(judged(loss, made)) == pytest.approx(textbook_direction(made, 3), rel=5e-3), "another number"
