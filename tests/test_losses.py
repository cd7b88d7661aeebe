"""Losses against independent formulations, their gradients, and the extremes."""

import doctest

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.distributions import MultivariateNormal, kl_divergence
from torch.testing import assert_close

from brushexp.errors import UserError
from brushexp.plugins.init import base as init_contract
from brushexp.plugins.loss import base as loss_contract
from brushexp.plugins.loss.base import Loss, Painting
from brushexp.plugins.loss.perceptual import Perceptual
from brushexp.plugins.loss.pixel import MeanAbsoluteError, MeanSquaredError
from brushexp.plugins.loss.stroke import SHRINK, KullbackLeibler, Width
from brushexp.registry import build_named
from brushexp.strokes.catalogue import Strokes
from brushexp.strokes.prior import INSET, clamp_to_prior, sample_prior, strokes_of

POINTS = ("start", "control", "end")
WANTED = torch.diag(torch.tensor([1 / 200, 1 / 25], dtype=torch.float64))


def pictures(height: int = 5, width: int = 8, dtype: torch.dtype = torch.float64) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(3)
    image, target = torch.rand(2, 3, height, width, generator=generator, dtype=dtype)
    return image, target


def strokes(points: list[list[float]], width: list[float]) -> Strokes:
    """Strokes of given start, control, end (N rows of 6, half-windows) and width."""
    made = strokes_of(torch.zeros(len(width), 10, dtype=torch.float64))
    table = torch.tensor(points, dtype=torch.float64).reshape(-1, 6)
    return moved(made, table, torch.tensor(width, dtype=torch.float64))


def moved(made: Strokes, table: Tensor, width: Tensor) -> Strokes:
    fields = dict(made.items())
    return Strokes(**fields | dict(zip(POINTS, table.split(2, dim=1), strict=True)) | {"width": width})


def judged(loss: Loss, made: Strokes) -> Tensor:
    image, target = pictures()
    return loss(Painting(image, target, made))


def random_strokes(n: int, seed: int = 0, size: float = 0.7) -> Strokes:
    random = np.random.default_rng(seed)
    return strokes(random.normal(0, size, (n, 6)).tolist(), random.uniform(0, 0.5, n).tolist())


def slopes(loss: Loss, made: Strokes) -> tuple[Tensor, list[Tensor]]:
    """Value and gradients in start, control, end and width."""
    made = made.map(lambda value: value.clone().requires_grad_())
    value = judged(loss, made)
    inputs = [made.start, made.control, made.end, made.width]
    found = torch.autograd.grad(value, inputs, allow_unused=True)
    return value.detach(), [torch.zeros_like(x) if g is None else g for x, g in zip(inputs, found, strict=True)]


@pytest.mark.parametrize(("loss", "power"), [(MeanSquaredError(), 2), (MeanAbsoluteError(), 1)])
def test_pixel_losses_average_over_pixels_and_channels(loss, power):
    image, target = pictures()
    total = sum(
        abs(float(image[c, y, x]) - float(target[c, y, x])) ** power
        for c in range(3)
        for y in range(5)
        for x in range(8)
    )
    found = loss(Painting(image, target, Strokes.none()))
    assert found.shape == ()
    assert float(found) == pytest.approx(total / 120)
    assert float(loss(Painting(target, target, Strokes.none()))) == 0
    assert torch.autograd.gradcheck(lambda x: loss(Painting(x, target, Strokes.none())), image.requires_grad_())


def test_l1_of_a_perfect_painting_has_no_slope():
    _, target = pictures()
    image = target.clone().requires_grad_()
    (slope,) = torch.autograd.grad(MeanAbsoluteError()(Painting(image, target, Strokes.none())), image)
    assert (slope == 0).all()


def test_width_compares_length_and_thickness_in_sides_of_the_window():
    apart = [0.4, 0.0, 0, 0, -0.4, 0.0]  # 0.8 half-windows: 0.4 of the side
    for width, wanted in ((0.1, 0.0), (0.28, 0.0), (0.5, 0.3), (1.0, 1.0)):
        assert float(judged(Width(), strokes([apart], [width]))) == pytest.approx(wanted, abs=1e-12)


def test_width_agrees_with_the_loop():
    made = random_strokes(50)
    total = 0.0
    for start, end, width in zip(made.start.numpy(), made.end.numpy(), made.width.numpy(), strict=True):
        s, e = (start + 1) / 2, (end + 1) / 2  # as the thesis has them: 0 to 1 within the window
        total += max(0.0, 2 * INSET * width - np.hypot(*(s - e)))
    assert float(judged(Width(), made)) == pytest.approx(total / 50)


def test_width_leaves_the_ends_of_a_point_alone_and_thins_it():
    value, (start, control, end, width) = slopes(Width(), strokes([[0.1, 0.2, 0, 0, 0.1, 0.2]], [0.1]))
    assert float(value) == pytest.approx(0.14)
    assert (start == 0).all()
    assert (end == 0).all()
    assert (control == 0).all()
    assert width.tolist() == pytest.approx([1.4])


def test_width_penalises_no_valid_stroke():
    for made in (sample_prior(5000), clamp_to_prior(random_strokes(500).map(Tensor.float))):
        assert float(judged(Width(), made)) < 1e-8


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


@pytest.mark.parametrize(("n", "size"), [(2, 0.5), (3, 5.0), (100, 0.7), (100, 50.0)])
def test_kl_agrees_with_the_textbook(n, size):
    made = random_strokes(n, seed=n, size=size)
    assert float(judged(KullbackLeibler(), made)) == pytest.approx(textbook_divergence(made), rel=1e-9)


def test_kl_vanishes_for_bends_of_the_wanted_mean_and_covariance():
    along, across = 0.1, np.sqrt(2 / 25)  # four bends on the axes: variances along^2 / 2 and across^2 / 2
    rows = [[0.5, 0, x, y, -0.5, 0] for x, y in ((along, 0), (-along, 0), (0, across), (0, -across))]
    value, found = slopes(KullbackLeibler(), strokes(rows, [0.1] * 4))
    assert float(value) == pytest.approx(0, abs=1e-12)
    for slope in found:
        assert slope.abs().max() < 1e-9


def test_kl_of_valid_strokes_is_small_and_grows_with_their_bend():
    valid = sample_prior(5000).map(Tensor.double)
    values = [float(judged(KullbackLeibler(), valid))]
    middle = 0.5 * (valid.start + valid.end)
    for factor in (1.5, 2, 4):
        bent = Strokes(**dict(valid.items()) | {"control": middle + factor * (valid.control - middle)})
        values.append(float(judged(KullbackLeibler(), bent)))
    assert values[0] < 0.01
    assert values == sorted(values)


def test_kl_does_not_depend_on_the_size_or_place_of_strokes():
    made = random_strokes(20)
    other = Strokes(**dict(made.items()) | {name: 3 * getattr(made, name) - 0.5 for name in POINTS})
    assert_close(judged(KullbackLeibler(), made), judged(KullbackLeibler(), other))


@pytest.mark.parametrize("loss", [Width(), KullbackLeibler()])
def test_stroke_losses_have_the_right_slope(loss):
    made = random_strokes(7)
    table = torch.cat([getattr(made, name) for name in POINTS], dim=1).requires_grad_()

    def value(table: Tensor, width: Tensor) -> Tensor:
        return judged(loss, moved(made, table, width))

    assert torch.autograd.gradcheck(value, (table, made.width.clone().requires_grad_()))


STRAIGHT = [0.5, 0.1, 0.0, 0.0, -0.5, -0.1]
EXTREMES = {
    "none": [],
    "one": [STRAIGHT],
    "identical": [STRAIGHT] * 9,
    "parallel": [[0.5, y, 0.0, y, -0.5, y] for y in np.linspace(-1, 1, 9)],
    "points": [[0.3, 0.3] * 3] * 4,
    "start is end": [[0.3, 0.3, x, 1.0, 0.3, 0.3] for x in np.linspace(-1, 1, 5)],
    "control on an end": [[0.5, 0.1, 0.5, 0.1, -0.5, y] for y in np.linspace(-1, 1, 5)],
    "bends on a line": [[0.5, 0.0, x, 2 * x, -0.5, 0.0] for x in np.linspace(-1e3, 1e3, 50)],
    "almost points": [[0.3, 0.3, 1e3, -1e3, 0.3 + d, 0.3] for d in (1e-3, 1e-8, 1e-20, 1e-30)],
    "bounds": [[1e3, -1e3, -1e3, 1e3, 1e3, 1e3], [-1e3, 1e3, 1e3, 1e3, 0.0, 0.0]],
    "a point and a line": [[0.3, 0.3] * 3, STRAIGHT],
}


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("rows", EXTREMES.values(), ids=EXTREMES)
@pytest.mark.parametrize("loss", [Width(), KullbackLeibler()])
def test_stroke_losses_are_finite_at_the_extremes(loss, rows, dtype):
    for width in (0.0, 0.1, 1e3):
        value, found = slopes(loss, strokes(rows, [width] * len(rows)).map(lambda x: x.to(dtype)))
        assert value.shape == ()
        assert value.isfinite()
        assert value >= -1e-6
        for slope in found:
            assert slope.isfinite().all()
        if not rows:
            assert value == 0


def test_kl_of_straight_strokes_is_bounded():
    for name in ("one", "identical", "parallel"):
        value = float(judged(KullbackLeibler(), strokes(EXTREMES[name], [0.1] * len(EXTREMES[name]))))
        assert value == pytest.approx(SHRINK - 1 - np.log(SHRINK))
        assert value < 7


def test_no_strokes_still_have_a_slope():
    for loss in (Width(), KullbackLeibler()):
        value = judged(loss, Strokes.none(torch.empty(0)).map(lambda x: x.requires_grad_()))
        value.backward()
        assert value == 0


def perceptual(**options: object) -> Perceptual:
    return Perceptual(**({"jitter": 0} | options)).double()


def test_perceptual_is_the_mean_square_of_the_difference_of_features():
    image, target = pictures(22, 17)
    loss = perceptual(taps=["b1", "b3.expand"])
    ours, theirs = (loss.network(x[None], ["b1", "b3.expand"]) for x in (image, target))
    wanted = np.mean([np.mean((ours[tap] - theirs[tap]).numpy() ** 2) for tap in ours])
    assert float(loss(Painting(image, target, Strokes.none()))) == pytest.approx(wanted)
    default = perceptual()(Painting(image, target, Strokes.none()))
    assert float(default) == pytest.approx(np.mean((ours["b3.expand"] - theirs["b3.expand"]).numpy() ** 2))


@pytest.mark.parametrize("jitter", [0, 1, 3])
def test_perceptual_has_the_right_slope(jitter):
    image, target = pictures(4, 6)
    loss = perceptual(jitter=jitter, taps=["b1"])

    def value(picture: Tensor) -> Tensor:
        loss.calls.fill_(1)
        return loss(Painting(picture, target, Strokes.none()))

    assert torch.autograd.gradcheck(value, image.requires_grad_())


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (5, 2), (9, 8)])
def test_perceptual_takes_tiny_pictures(size):
    image, target = pictures(*size, dtype=torch.float32)
    loss = Perceptual()
    for _ in range(4):
        assert float(loss(Painting(target, target, Strokes.none()))) < 1e-9
        assert loss(Painting(image, target, Strokes.none())) > 0


def test_jitter_takes_four_shifts_in_turn_and_sees_the_target_once_in_each():
    image, target = pictures(12, 10, dtype=torch.float32)
    loss, calls = Perceptual(jitter=3), []
    loss.network.register_forward_pre_hook(lambda _, inputs: calls.append(inputs[0]))
    painting = Painting(image, target, Strokes.none())
    values = [float(loss(painting)) for _ in range(12)]
    assert len(set(values)) == 4
    assert values[:4] * 3 == values
    assert len(calls) == 12 + 4
    assert {tuple(call.shape) for call in calls} == {(1, 3, 15, 13)}  # one size, so that the network's grid stays put


@pytest.mark.parametrize(("jitter", "shifts"), [(0, 1), (1, 4), (2, 3), (3, 4)])
def test_shifts_go_through_all_rows_and_columns_up_to_the_largest(jitter, shifts):
    found = Perceptual(jitter=jitter).shifts
    assert len(found) == shifts
    for axis in range(2):
        assert {shift[axis] for shift in found} == set(range(jitter + 1))


def test_the_next_shift_survives_a_restart():
    painting = Painting(*pictures(12, 10, dtype=torch.float32), Strokes.none())
    first, second = Perceptual(jitter=3), Perceptual(jitter=3)
    values = [float(first(painting)) for _ in range(6)]
    for _ in range(2):
        second(painting)
    third = Perceptual(jitter=3)
    third.load_state_dict(second.state_dict())
    assert list(second.state_dict()) == ["calls"]
    assert [float(third(painting)) for _ in range(4)] == values[2:]


def test_another_target_replaces_the_kept_features():
    image, target = pictures(12, 10, dtype=torch.float32)
    loss = Perceptual(jitter=0)
    loss(Painting(image, target, Strokes.none()))
    for other in (image.clone(), target.clone(), torch.zeros_like(image)):
        fresh = Perceptual(jitter=0)(Painting(image, other, Strokes.none()))
        assert_close(loss(Painting(image, other, Strokes.none())), fresh)


def test_the_target_gets_no_slope():
    image, target = pictures(6, 7, dtype=torch.float32)
    value = Perceptual()(Painting(image.requires_grad_(), target.requires_grad_(), Strokes.none()))
    value.backward()
    assert target.grad is None
    assert image.grad.isfinite().all()


def test_options_that_cannot_be_are_refused_before_work_starts():
    for name, options in (
        ("perceptual", {"jitter": 4}),
        ("sinkhorn", {"side": 0}),
        ("sinkhorn", {"epsilon": 0.001}),
        ("sinkhorn", {"epsilon": float("nan")}),
        ("sinkhorn", {"iterations": 0}),
        ("sinkhorn", {"floor": 0.0}),
        ("style", {"scale": 0.0}),
    ):
        ((option, value),) = options.items()
        with pytest.raises(
            UserError, match=rf"loss\.{name}\.{option}={value:g} is not .*; try loss\.{name}\.{option}="
        ):
            build_named("loss", name, options)
    with pytest.raises(UserError, match="choose from stem, b0"):
        Perceptual(taps=["relu4_3"])
    with pytest.raises(UserError, match="effl0, vgg16-hed, alexnet"):
        Perceptual(backbone="resnet")
    with pytest.raises(UserError, match=r"loss\.perceptual\.weights=path"):
        Perceptual(backbone="vgg16")


@pytest.mark.parametrize("cls", [MeanSquaredError, MeanAbsoluteError, Width, KullbackLeibler, Perceptual])
def test_weights_scale_the_sum_and_not_the_value(cls):
    painting = Painting(*pictures(6, 7, dtype=torch.float32), random_strokes(4).map(Tensor.float))
    light, heavy = cls(weight=0.5), cls(weight=4.0)
    assert (light.weight, heavy.weight) == (0.5, 4.0)
    assert_close(light(painting), heavy(painting), rtol=0, atol=0)
    assert cls().weight > 0


def test_the_examples_of_the_contracts_run():
    for module in (loss_contract, init_contract):
        assert doctest.testmod(module).attempted > 0
        assert doctest.testmod(module).failed == 0
