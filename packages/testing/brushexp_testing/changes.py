"""Check that changes to a painting keep its target and strokes valid, and continue identically when resumed."""

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from brushexp.contracts.families import Compositor, Order, PaintingState, front_to_back
from brushexp.contracts.members import Analytic, Rgb, Tiled
from brushexp.contracts.strokes import Strokes, check_strokes
from brushexp_testing.families import SIZE, Check, Make, some_strokes

N = 30  # strokes
STEPS = 100


def painting_at(step: int, strokes: Strokes, *, is_over: bool = False) -> PaintingState:
    """Return the state, after ``step`` steps, of a painting with a random target and the given strokes."""
    renderer, blend = Analytic(), Compositor(Tiled(), Rgb())
    ground = torch.tensor([0.9, 0.8, 0.6])

    @torch.no_grad()
    def draw(painted: Strokes, order: Tensor) -> Tensor:
        image: Tensor = blend(renderer(painted), order, SIZE, ground).image
        return image

    return PaintingState(
        target=torch.rand(3, *SIZE, generator=torch.Generator().manual_seed(5)),
        focus=None,
        ground=ground,
        renderer=renderer,
        blend=blend,
        step=step,
        steps=STEPS,
        generator=torch.Generator().manual_seed(6),
        strokes=lambda: strokes,
        order=lambda painted: front_to_back(painted.width),
        front_to_back=front_to_back(strokes.width),
        draw=draw,
        is_over=is_over,
    )


def begin_change(make: Make) -> tuple[Any, Strokes]:
    """Build a change and start a painting with it; return the change and the initial strokes."""
    change, strokes = make(), some_strokes(N, SIZE)
    change.target(painting_at(0, strokes).target)
    return change, change.begin(strokes, painting_at(0, strokes))


def keeps_shapes_of_target_and_ground(make: Make) -> None:
    """Check that the target stays in [0, 1] and the ground finite at every step, and that both keep their shapes."""
    change, strokes = begin_change(make)
    for step in (0, 1, 50, STEPS):
        state = painting_at(step, strokes)
        for target, ground in (
            (change.target(state.target), change.ground(state.ground)),
            change.aim(state.target, state.ground, state),
        ):
            assert target.shape == (3, *SIZE)
            assert 0 <= target.min() <= target.max() <= 1
            assert ground.shape == (3,)
            assert ground.isfinite().all()


def limits_strokes_once(make: Make) -> None:
    """Check that limited strokes are valid and unchanged in number, and that limiting them again has no effect.

    Enlarging strokes must also preserve their number.
    """
    change, strokes = begin_change(make)
    assert isinstance(change.order(Depth()), Order)
    assert len(strokes) == N
    check_strokes(strokes)
    for step, is_over in ((0, False), (1, False), (STEPS, True)):
        state = painting_at(step, strokes, is_over=is_over)
        once = change.limit(some_strokes(N, SIZE, seed=step + 1), None, None, state)
        check_strokes(once)
        assert len(once) == len(change.enlarge(once)) == N
        twice = change.limit(once, None, None, state)
        assert all(torch.allclose(getattr(twice, name), value, atol=1e-5) for name, value in once.items())


def keeps_strokes_at_the_end(make: Make) -> None:
    """Check that the final strokes begin with the original N strokes, and that the order lists each stroke once."""
    for n in (0, 1, N):
        change, strokes = make(), some_strokes(n, SIZE)
        state = painting_at(STEPS, strokes, is_over=True)
        finished, order = change.end(strokes, state.front_to_back, state)
        check_strokes(finished)
        assert sorted(order.tolist()) == list(range(len(finished)))
        assert len(finished) >= n
        for name in ("position", "start", "control", "end", "brush"):
            assert torch.equal(getattr(finished, name)[:n], getattr(strokes, name)), name


def resumes_identically(make: Make) -> None:
    """Check that a change continues identically after being restored from a saved state."""
    change, strokes = begin_change(make)
    state = painting_at(50, strokes)
    change.aim(state.target, state.ground, state)
    again, _ = begin_change(make)
    again.load_state_dict(change.state_dict())
    after = replace(state, step=51)
    for one, other in zip(
        change.aim(state.target, state.ground, after), again.aim(state.target, state.ground, after), strict=True
    ):
        assert torch.equal(one, other)


class Depth(Order):
    """Order strokes by width."""

    every = 1

    def depth(self, strokes: Strokes, accuracy: Tensor | None) -> Tensor:
        return strokes.width


CHECKS: dict[str, list[Check]] = {
    "change": [
        keeps_shapes_of_target_and_ground,
        limits_strokes_once,
        keeps_strokes_at_the_end,
        resumes_identically,
    ]
}
