"""Curvature and direction against slow formulations, their gradients, and the extremes."""

import math

import pytest
import torch
from scenes import leaves, random_strokes
from torch import Tensor

from brushexp.errors import UserError
from brushexp.plugins.loss.base import Loss, Painting
from brushexp.plugins.loss.flow import Curvature, Direction
from brushexp.registry import build_named
from brushexp.strokes.bezier import curve_of
from brushexp.strokes.catalogue import Strokes

SIZE = (24, 40)
FIELDS = ("scale", "start", "control", "end")


def scene(n: int, seed: int = 0, dtype: torch.dtype = torch.float64) -> Strokes:
    return random_strokes(n, SIZE, seed=seed, dtype=dtype)


def changed(strokes: Strokes, **values: Tensor) -> Strokes:
    return Strokes(**dict(strokes.items()) | values)


def judged(loss: Loss, strokes: Strokes) -> Tensor:
    nothing = strokes.color.new_zeros(3, *SIZE)
    return loss(Painting(nothing, nothing, strokes))


def textbook_direction(strokes: Strokes, k: int) -> float:
    """4 sin^2 of the angle between the principal axes of each stroke and its nearest ones, pair by pair."""
    t = torch.linspace(0, 1, 2001, dtype=torch.float64)[:, None]
    angle = []
    for start, control, end in curve_of(strokes):
        values, axes = torch.linalg.eigh(((1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end).T.cov())
        angle.append(math.atan2(float(axes[1, values.argmax()]), float(axes[0, values.argmax()])))
    near = nearest_middles(strokes, k).tolist()
    pairs = [4 * math.sin(angle[i] - angle[j]) ** 2 for i, row in enumerate(near) for j in row]
    return sum(pairs) / len(pairs)


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


def test_straight_strokes_have_no_curvature_and_points_no_slope():
    made = scene(7)
    assert float(judged(Curvature(), changed(made, control=0.5 * (made.start + made.end)))) == pytest.approx(
        0, abs=1e-9
    )
    exact = leaves(changed(made, start=torch.zeros(7, 2), control=torch.zeros(7, 2), end=torch.zeros(7, 2)))
    judged(Curvature(), exact).backward()
    assert all((getattr(exact, name).grad == 0).all() for name in ("start", "control", "end"))


@pytest.mark.parametrize("k", [1, 3, 10, 60])
def test_direction_agrees_with_the_double_loop(k):
    made = scene(40, seed=k)
    assert float(judged(Direction(k=k), made)) == pytest.approx(textbook_direction(made, k), rel=5e-3)


def test_parallel_strokes_of_one_length_flow_whichever_way_they_point():
    made = scene(9)
    chord = torch.tensor([[0.3, 0.2]], dtype=torch.float64) * torch.tensor([1.0, -1, 1, 1, -1, -1, 1, 1, -1])[:, None]
    made = changed(made, start=-chord, control=0 * chord, end=chord, scale=torch.full((9,), 20.0, dtype=torch.float64))
    assert float(judged(Direction(), made)) == pytest.approx(0, abs=1e-9)
    crossed = changed(made, end=torch.where(torch.arange(9)[:, None] % 2 == 0, chord, chord.flip(1) * -1))
    assert float(judged(Direction(), crossed)) > 0.05


@pytest.mark.parametrize("zoom", [0.25, 4.0])
def test_neither_depends_on_the_resolution(zoom):
    made = scene(30)
    for loss in (Curvature(), Direction()):
        here, there = judged(loss, made), judged(loss, made.moved(zoom=zoom, shift=(5.0, -3.0)))
        assert float(there) == pytest.approx(float(here), rel=1e-3)


def test_lengths_and_widths_do_not_matter():
    made = scene(30)
    short = changed(made, **{name: 0.3 * getattr(made, name) for name in ("start", "control", "end", "width")})
    for loss in (Curvature(), Direction(every=1000)):
        assert float(judged(loss, made)) == pytest.approx(float(judged(loss, short)), rel=5e-3)


@pytest.mark.parametrize("loss", [Curvature(), Direction(k=4, every=10_000)])
def test_they_have_the_right_slope(loss):
    made = scene(8)
    values = [getattr(made, name).clone().requires_grad_() for name in FIELDS]

    def value(*inputs: Tensor) -> Tensor:
        return judged(loss, changed(made, **dict(zip(FIELDS, inputs, strict=True))))

    assert torch.autograd.gradcheck(value, values)


def test_places_get_no_slope():
    made = leaves(scene(12), torch.float64)
    judged(Direction(), made).backward()
    assert made.position.grad is None
    assert made.start.grad.abs().sum() > 0


def test_neighbours_are_kept_and_renewed():
    loss, first, second = Direction(k=3, every=3), scene(20, seed=1), scene(20, seed=2)
    judged(loss, first)
    kept = loss.neighbours
    for _ in range(2):
        judged(loss, second)
        assert loss.neighbours is kept
    judged(loss, second)
    assert torch.equal(loss.neighbours, nearest_middles(second, 3))
    assert not torch.equal(loss.neighbours, kept)


@pytest.mark.parametrize("n", [19, 5, 2, 30])
def test_another_number_of_strokes_is_noticed(n):
    loss = Direction(k=4, every=1000)
    judged(loss, scene(20))
    made = scene(n, seed=n)
    assert float(judged(loss, made)) == pytest.approx(textbook_direction(made, 4), rel=5e-3)


def test_a_restart_keeps_the_neighbours():
    first, second = Direction(k=3, every=5), Direction(k=3, every=5)
    for _ in range(3):
        judged(first, scene(20, seed=1))
    second.load_state_dict(first.state_dict())
    for loss in (first, second):
        judged(loss, scene(20, seed=2))
    assert torch.equal(first.neighbours, second.neighbours)
    assert first.calls == second.calls == 4
    assert torch.equal(second.neighbours, nearest_middles(scene(20, seed=1), 3))


EXTREMES = {
    "coincident": lambda n: torch.full((n, 6), 0.3),
    "ends in one place": lambda n: torch.tensor([[0.3, 0.3, 1.0, -1.0, 0.3, 0.3]]).repeat(n, 1),
    "almost": lambda n: torch.tensor([[0.3, 0.3, 1e3, -1e3, 0.3 + 1e-20, 0.3]]).repeat(n, 1),
    "far": lambda n: torch.tensor([[1e3, -1e3, -1e3, 1e3, -1e3, 1e3]]).repeat(n, 1),
    "far and a point": lambda n: torch.cat([torch.tensor([[1e3, -1e3] * 3]), torch.full((n, 6), 0.1)])[:n],
    "straight": lambda n: torch.tensor([[0.5, 0.0, 0.0, 0.0, -0.5, 0.0]]).repeat(n, 1),
}


@pytest.mark.parametrize("scale", [1e-3, 20.0, 1e6])
@pytest.mark.parametrize("n", [0, 1, 12])
@pytest.mark.parametrize("points", EXTREMES.values(), ids=EXTREMES)
@pytest.mark.parametrize("cls", [Curvature, Direction])
def test_value_and_slope_are_finite_at_the_extremes(cls, points, n, scale):
    start, control, end = points(n).split(2, dim=1)
    made = scene(n, dtype=torch.float32)
    made = changed(made, start=start, control=control, end=end, scale=torch.full((n,), scale))
    made = leaves(made)
    value = judged(cls(), made)
    value.backward()
    assert value.shape == ()
    assert value.isfinite()
    assert value >= 0
    for _, field in made.items():
        assert field.grad is None or field.grad.isfinite().all()
    if n == 0 or (cls is Direction and n == 1):
        assert value == 0


@pytest.mark.parametrize("loss", [Curvature(), Direction(k=5)])
def test_following_the_slope_lowers_them(loss):
    made = leaves(scene(40, dtype=torch.float32))
    optimizer = torch.optim.Adam([getattr(made, name) for name in FIELDS[1:]], lr=0.02)
    before = float(judged(loss, made).detach())
    for _ in range(40):
        optimizer.zero_grad()
        judged(loss, made).backward()
        optimizer.step()
    assert float(judged(loss, made).detach()) < 0.5 * before


@pytest.mark.parametrize("option", ["k", "every"])
def test_counts_below_one_are_refused(option):
    with pytest.raises(UserError, match=rf"loss\.direction\.{option}=0 is not"):
        build_named("loss", "direction", {option: 0})
