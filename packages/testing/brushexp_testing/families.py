"""Check plugins of all families other than engines, changes, palettes and papers."""

import tempfile
from collections.abc import Callable
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any

import torch

from brushexp.contracts import UserError
from brushexp.contracts.families import (
    Comparison,
    DensificationState,
    PaintedView,
    Painter,
    PaintRequest,
    Run,
    front_to_back,
)
from brushexp.contracts.members import Analytic, Tiled
from brushexp.contracts.runs import Status
from brushexp.contracts.strokes import FIELDS, LATER_FIELDS, Catalogue, Strokes, check_strokes
from brushexp_testing.words import has_clear_message

Make = Callable[..., Any]  # function that builds a new plugin from options
Check = Callable[[Make], None]
SIZE = (24, 40)  # not square, so that swapping height and width fails


def some_strokes(
    n: int,
    size: tuple[int, int],
    *,
    seed: int = 0,
    bend: float = 0.3,
    width: tuple[float, float] = (0.02, 0.3),
    dtype: torch.dtype = torch.float32,
) -> Strokes:
    """Sample ``n`` random strokes on and near a canvas of ``size`` (H, W); ``bend`` scales their curvature."""
    generator = torch.Generator().manual_seed(seed)
    uniform = partial(torch.rand, generator=generator)
    start, end = uniform(n, 2) * 2 - 1, uniform(n, 2) * 2 - 1
    strokes = Strokes(
        position=(uniform(n, 2) * 1.4 - 0.2) * torch.tensor([size[1], size[0]]),
        scale=5 + 25 * uniform(n),
        start=start,
        control=(start + end) / 2 + bend * torch.randn(n, 2, generator=generator),
        end=end,
        width=width[0] + (width[1] - width[0]) * uniform(n),
        color=uniform(n, 3),
        opacity=uniform(n),
    )
    return strokes.map(lambda value: value.to(dtype))


def with_gradients(strokes: Strokes, dtype: torch.dtype = torch.float32) -> Strokes:
    """Copy the fields of strokes into leaf tensors that accumulate gradients."""
    return strokes.map(lambda value: value.detach().to(dtype).clone().requires_grad_())


def makes_requested_strokes_in_range(make: Make) -> None:
    """Check that an initialiser returns the requested number of valid strokes, which depend only on the seed."""
    for n in (1, 7, 60):
        target = torch.rand(3, *SIZE)
        strokes, again = (make()(target, n, torch.Generator().manual_seed(1)) for _ in range(2))
        assert len(strokes) == n
        assert all(value.dtype == torch.float32 for _, value in strokes.items())
        check_strokes(strokes)
        assert all(torch.equal(getattr(strokes, field), getattr(again, field)) for field in FIELDS)


def is_bounded_and_differentiable_in_every_field(make: Make) -> None:
    """Check that alpha is in [0, 1] and 0 outside a stroke's reach, and that every field receives a gradient."""
    strokes = with_gradients(some_strokes(5, SIZE, width=(0.1, 0.3)))
    layers = make()(strokes)
    points = torch.rand(1, 400, 2) * torch.tensor([40.0, 24.0])
    alpha, color = layers.sample(torch.arange(5)[None], points)
    assert alpha.shape == (1, 5, 400)
    assert color.shape in ((1, 5, 1, 3), (1, 5, 400, 3))
    assert -1e-6 <= alpha.min() <= alpha.max() <= 1 + 1e-6
    (alpha[..., None] * color).sum().backward()
    reached = {field for field, value in strokes.items() if value.grad is not None and value.grad.abs().sum() > 0}
    assert reached >= set(FIELDS) - set(LATER_FIELDS)
    fine = torch.linspace(0, 1, 200)
    weights = torch.stack([(1 - fine) ** 2, 2 * fine * (1 - fine), fine**2], -1)  # (200, 3)
    points = torch.rand(500, 2) * 80 - 20
    distance = torch.cdist(points[None], weights @ layers.curve.detach())  # (5, 500, 200)
    alpha, _ = layers.sample(torch.arange(5)[None], points[None])
    beyond = distance.min(-1).values > layers.reach[:, None] + 0.1
    assert (alpha[0][beyond] == 0).all()


def numbers_the_strokes_it_holds(make: Make) -> None:
    """Check that a renderer returns distinct indices of existing strokes, or None, for the strokes that it holds."""
    held = make().held(some_strokes(5, SIZE))
    assert held is None or (held.dtype == torch.int64 and set(held.tolist()) <= set(range(5)))
    assert held is None or len(held.unique()) == len(held)


def loads_its_checkpoint(make: Make) -> None:
    """Check that a renderer with a ``checkpoint`` option raises a clear error if the file is missing."""
    if "checkpoint" in signature(type(make())).parameters:
        try:
            make(checkpoint="missing.safetensors")
        except UserError as error:
            has_clear_message(error)
            return
        raise AssertionError("call self.restore(checkpoint, ...) at the end of __init__")


def paints_requested_size(make: Make) -> None:
    """Check that a blend returns a picture of the requested size in [0, 1], and an accuracy for each stroke."""
    layers = Analytic()(some_strokes(9, SIZE))
    canvas = make()(layers, torch.arange(9), SIZE, torch.ones(3), torch.rand(3, *SIZE))
    assert canvas.image.shape == (3, *SIZE)
    assert 0 <= canvas.image.min() <= canvas.image.max() <= 1 + 1e-5
    assert canvas.accuracy.shape == (9,)


def gives_every_stroke_a_depth(make: Make) -> None:
    """Check that an order ranks every stroke exactly once, both with and without the strokes' accuracy."""
    order = make()
    assert order.every >= 1
    for accuracy in (None, torch.rand(9)):
        depth = order.depth(some_strokes(9, SIZE), accuracy)
        assert sorted(front_to_back(depth).tolist()) == list(range(9))


def is_finite_differentiable_and_zero_at_best(make: Make) -> None:
    """Check that a loss is finite even without strokes, has finite gradients, and is 0 for equal pictures."""
    loss = make()
    assert loss.weight > 0
    image, strokes = torch.rand(3, *SIZE, requires_grad=True), with_gradients(some_strokes(6, SIZE, bend=0.05))
    value = loss(PaintedView(image, torch.rand(3, *SIZE), strokes))
    assert value.shape == ()
    assert 0 <= value < torch.inf
    value.backward()
    assert all(grad is None or grad.isfinite().all() for grad in [image.grad, *(x.grad for _, x in strokes.items())])
    if image.grad is not None and image.grad.abs().sum() > 0:
        assert loss(PaintedView(image.detach(), image.detach(), strokes)) < 1e-8
    for n in (0, 1):
        assert loss(PaintedView(image, torch.rand(3, *SIZE), some_strokes(n, SIZE))).isfinite()


def is_best_for_equal_pictures(make: Make) -> None:
    """Check that a metric returns a number or None for pictures of any size, and is best for equal pictures.

    Metrics that need the ``job`` are skipped: they measure a painting's file, which this check does not have, and are
    covered by their own tests.
    """
    metric, size = make(), (176, 184)  # some metrics compare several scales
    if "job" in metric.needs:
        return
    strokes, focus = some_strokes(6, size), torch.ones(size)
    picture, target = (torch.rand(3, *size) * 255).round() / 255, torch.zeros(3, *size)
    unlike, alike = (metric(Comparison(one, target, focus, strokes)) for one in (picture, target))
    assert all(isinstance(value, float) for value in (unlike, alike))
    assert alike >= unlike if metric.higher_is_better else alike <= unlike
    pixel = torch.rand(3, 1, 1)
    assert isinstance(metric(Comparison(pixel, pixel, torch.ones(1, 1), strokes)), float | None)


def stays_within_budget(make: Make) -> None:
    """Check that a density policy ends within the stroke budget, accepts an empty set, and can restore its state."""
    for n in (0, 1, 40):
        density, strokes = make(), some_strokes(n, SIZE)
        assert 1 <= density.first(60, 60) <= 60
        assert density.first(1, 60) == 1
        for step in range(1, 61):
            painted, target = torch.rand(3, *SIZE), torch.rand(3, *SIZE)
            importance = partial(torch.rand, len(strokes))
            update = density.revise(DensificationState(painted, target, None, strokes, 60, step, 60, importance))
            if update is not None:
                assert update.keep.shape == (len(strokes),)
                strokes = Strokes.join(strokes[update.keep], update.new)
                check_strokes(strokes)
        assert len(strokes) <= 60
        again = make()
        again.load_state_dict(density.state_dict())
        assert again.state_dict() == density.state_dict()


def stays_on_the_canvas(make: Make) -> None:
    """Check that a sampler's region is within the picture, and that the strokes it selects exist and are distinct."""
    sampler = make()
    for step in range(20):
        view = sampler(some_strokes(9, SIZE), SIZE, step, torch.Generator().manual_seed(step))
        region = view.region
        numbers = [number for number in (view.active, view.ring) if number is not None]
        assert len(torch.cat([torch.arange(0), *numbers]).unique()) == sum(map(len, numbers)) <= 9
        assert 0 <= region.top <= region.top + region.height <= SIZE[0]
        assert 0 <= region.left <= region.left + region.width <= SIZE[1]
        assert min(region.height, region.width) > 0


def lowers_a_loss(make: Make) -> None:
    """Check that an optimiser reduces a loss in ten steps at its own learning rates."""
    optimizer = make()
    catalogue = Catalogue(some_strokes(6, SIZE), optimizer.units)
    goal = torch.full((6, 3), 0.5)
    torch_optimizer = optimizer.over(catalogue.parameters())

    def closure() -> torch.Tensor:
        torch_optimizer.zero_grad()
        loss = (catalogue().color - goal).square().mean()
        loss.backward()
        return loss

    before = float(closure().detach())
    rates = [group["lr"] for group in torch_optimizer.param_groups]
    for step in range(10):
        share = optimizer.share(step / 10)
        assert 0 <= share <= 1
        for group, rate in zip(torch_optimizer.param_groups, rates, strict=True):
            group["lr"] = share * rate
        torch_optimizer.step(closure)
    assert float(closure().detach()) < before


def writes_into_the_folder_of_the_run(make: Make) -> None:
    """Check that a logger writes at least one file into the run's folder."""
    with tempfile.TemporaryDirectory() as name:
        logger = make()
        curves = logger.open(Run(Path(name)))
        curves.log_metrics({"loss/mse": 0.5}, step=1)
        curves.save()
        logger.finish(Run(Path(name), status=Status.COMPLETED, metrics={"psnr": 20.0}))
        curves.finalize("success")
        assert any(path.is_file() for path in Path(name).rglob("*"))


def paints_within_stroke_budget(make: Make) -> None:
    """Check that a painter's strokes are valid, stay within the budget and leave paint, and that step numbers increase.

    The result must depend only on the seed. The check includes a tiny picture and a picture of a single colour.
    """
    if not isinstance(make(), Painter):
        return
    shades = torch.linspace(0, 1, SIZE[1]).expand(3, *SIZE).clone()
    shades[0, :, : SIZE[1] // 2] = 0.9
    for target, n, times in ((shades, 12, 2), (torch.rand(3, 3, 2), 1, 1), (torch.full((3, *SIZE), 0.5), 8, 1)):
        background = torch.tensor([0.2, 0.4, 0.9])
        paintings = [list(make()(request_of(target, n, background))) for _ in range(times)]
        states, again = paintings[0], paintings[-1][-1].strokes
        assert states
        assert all(0 < len(state.strokes) <= n for state in states)
        steps = [state.step for state in states]
        assert [0, *steps] == sorted({0, *steps})
        assert all(state.step <= state.steps for state in states)
        check_strokes(states[-1].strokes)
        assert all(torch.equal(getattr(again, name), value) for name, value in states[-1].strokes.items())
        drawn = request_of(target, n, background).draw(states[-1].strokes)
        assert (drawn - background[:, None, None]).abs().amax() > 0.1


def request_of(target: torch.Tensor, n: int, background: torch.Tensor) -> PaintRequest:
    """Return a request to paint a picture with strokes of the analytic renderer."""

    def draw(strokes: Strokes) -> torch.Tensor:
        order = torch.arange(len(strokes) - 1, -1, -1)
        return Tiled()(Analytic()(strokes), order, (target.shape[1], target.shape[2]), background).image

    return PaintRequest(target, n, background, draw, torch.Generator().manual_seed(3))


CHECKS: dict[str, list[Check]] = {
    "painter": [paints_within_stroke_budget],
    "init": [makes_requested_strokes_in_range],
    "renderer": [is_bounded_and_differentiable_in_every_field, numbers_the_strokes_it_holds, loads_its_checkpoint],
    "blend": [paints_requested_size],
    "order": [gives_every_stroke_a_depth],
    "loss": [is_finite_differentiable_and_zero_at_best],
    "metric": [is_best_for_equal_pictures],
    "density": [stays_within_budget],
    "sampler": [stays_on_the_canvas],
    "optimizer": [lowers_a_loss],
    "logger": [writes_into_the_folder_of_the_run],
}
