"""Losses of pictures against libraries and loops, and their gradients; their extremes are in test_degenerate_losses."""

from functools import partial

import numpy as np
import pytest
import torch
import yaml
from networks import saved, state_of, torchvision_features
from torch import Tensor
from torch.testing import assert_close
from torchmetrics.functional.image import lpips as published
from torchmetrics.functional.image import structural_similarity_index_measure

from brushexp.errors import UserError
from brushexp.features.distance import open_distance, perceptual_distance
from brushexp.painting.metrics import measure
from brushexp.pictures.focus import focus_weights
from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.plugins.loss.l1 import MeanAbsoluteError
from brushexp.plugins.loss.lpips import Lpips
from brushexp.plugins.loss.mse import MeanSquaredError
from brushexp.plugins.loss.perceptual import Perceptual
from brushexp.plugins.loss.sinkhorn import Sinkhorn
from brushexp.plugins.loss.ssim import StructuralSimilarity
from brushexp.plugins.loss.style import KERNELS, Style
from brushexp.registry import build_named
from brushexp.strokes.catalogue import Strokes

NETWORKS = {"alexnet": "alex", "squeeze": "squeeze", "vgg16": "vgg"}  # and what torchmetrics calls them


def pictures(height: int = 5, width: int = 8, dtype: torch.dtype = torch.float64) -> tuple[Tensor, Tensor]:
    target = torch.rand(3, height, width, dtype=dtype)
    return (target + 0.2 * torch.randn_like(target)).clamp(0, 1), target


def judged(loss: Loss, image: Tensor, target: Tensor) -> Tensor:
    return loss(PaintedView(image, target, Strokes.none()))


@pytest.mark.parametrize(
    "made", [StructuralSimilarity, Lpips, partial(Perceptual, jitter=0), Sinkhorn, partial(Style, taps=["stem"])]
)
def test_a_target_is_looked_at_once_without_a_slope_until_another_comes(made):
    loss, looks = made(), []
    ask = loss.of_target
    loss.of_target = lambda target, look, key=None: ask(target, lambda seen: looks.append(1) or look(seen), key)
    image, target = pictures(12, 10, torch.float32)
    target.requires_grad_()
    for _ in range(3):
        judged(loss, image.requires_grad_(), target).backward()
    assert len(looks) == 1
    assert image.grad.isfinite().all()
    for other in (target.detach().clone(), torch.zeros_like(image)):
        assert_close(judged(loss, image, other), judged(made(), image, other))
    assert len(looks) == 3


LIMITS = ["perceptual.jitter=4", "direction.k=0", "direction.every=0", "sinkhorn.side=0", "sinkhorn.epsilon=0.001"]
LIMITS += ["sinkhorn.epsilon=nan", "sinkhorn.iterations=0", "sinkhorn.floor=0", "style.scale=0"]


@pytest.mark.parametrize("typed", [*LIMITS, "style.kernel=cubic", "style.colors=none"])
def test_options_that_cannot_be_are_refused_before_work_starts(typed):
    (name, option), value = typed.partition("=")[0].split("."), yaml.safe_load(typed.partition("=")[2])
    with pytest.raises(UserError, match=rf"loss\.{typed} is not .*; try loss\.{name}\.{option}="):
        build_named("loss", name, {option: float("nan") if value == "nan" else value})


SLOPES = {
    "mse": (MeanSquaredError, (5, 8)), "l1": (MeanAbsoluteError, (5, 8)),
    **{f"ssim {size}": (StructuralSimilarity, size) for size in [(1, 1), (2, 7), (8, 12)]},
    **{f"perceptual {k}": (partial(Perceptual, jitter=k, taps=["b1"]), (4, 6)) for k in (0, 1, 3)},
    **{f"style {kernel}": (partial(Style, kernel=kernel, taps=["stem", "b0"]), (4, 5)) for kernel in KERNELS},
    "sinkhorn": (Sinkhorn, (4, 6)), "sinkhorn, shrunk": (partial(Sinkhorn, side=8), (5, 30)),
}  # fmt: skip
CASES = [*((name, False) for name in SLOPES), *((name, True) for name in ("mse", "l1", "ssim (2, 7)", "perceptual 0"))]


@pytest.mark.parametrize(("name", "focused"), CASES)
def test_a_loss_has_the_slope_of_its_value(name, focused):
    make, size = SLOPES[name]
    loss, (image, target) = make().double(), pictures(*size)
    image = 0.9 * image + 0.05  # at 0 a mass has a kink
    focus = focus_weights(torch.rand(size), 8) if focused else None

    def value(picture: Tensor) -> Tensor:
        if isinstance(loss, Perceptual):
            loss.calls.fill_(1)  # the same shift
        return loss(PaintedView(picture, target, Strokes.none(), focus=focus))

    assert torch.autograd.gradcheck(value, image.requires_grad_())


@pytest.mark.parametrize(("loss", "power"), [(MeanSquaredError(), 2), (MeanAbsoluteError(), 1)])
def test_pixel_losses_average_over_pixels_and_channels(loss, power):
    image, target = pictures()
    pairs = zip(image.flatten().tolist(), target.flatten().tolist(), strict=True)
    assert float(judged(loss, image, target)) == pytest.approx(sum(abs(a - b) ** power for a, b in pairs) / 120)
    exact = target.clone().requires_grad_()
    value = judged(loss, exact, target)
    assert value == 0
    assert (torch.autograd.grad(value, exact)[0] == 0).all(), "of l1, too"


@pytest.mark.parametrize("size", [(6, 6), (11, 17), (37, 50)])
def test_ssim_agrees_with_torchmetrics(size):
    image, target = pictures(*size)
    wanted = 1 - structural_similarity_index_measure(image[None], target[None], data_range=1.0)
    assert_close(judged(StructuralSimilarity(), image, target), wanted, rtol=0, atol=1e-6)
    assert_close(judged(StructuralSimilarity(), image.float(), target.float()), wanted.float(), rtol=0, atol=1e-4)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (3, 5), (5, 40)])
def test_ssim_of_small_pictures_has_smaller_windows(size):
    image, target = pictures(*size)
    height, width = size
    down, across = min(5, height - 1), min(5, width - 1)
    steps = [np.exp(-((np.arange(-r, r + 1) / 1.5) ** 2) / 2) for r in (down, across)]
    weights = np.outer(*steps) / np.outer(*steps).sum()
    values = []
    for channel in range(3):
        x, y = (np.pad(p[channel].numpy(), ((down, down), (across, across)), mode="reflect") for p in (image, target))
        for row, column in np.ndindex(height, width):
            a, b = (p[row : row + 2 * down + 1, column : column + 2 * across + 1] for p in (x, y))
            m, n = (weights * a).sum(), (weights * b).sum()
            v, w, c = ((weights * p).sum() for p in ((a - m) ** 2, (b - n) ** 2, (a - m) * (b - n)))
            similar = (2 * m * n + 1e-4) / (m * m + n * n + 1e-4)
            values.append(1 - similar * (2 * c + 9e-4) / (v + w + 9e-4))
    assert float(judged(StructuralSimilarity(), image, target)) == pytest.approx(np.mean(values), abs=1e-9)


def perceptual(**options: object) -> Perceptual:
    return Perceptual(**({"jitter": 0} | options)).double()


def test_perceptual_is_the_mean_square_of_the_difference_of_features():
    image, target = pictures(22, 17)
    loss = perceptual(taps=["b1", "b3.expand"])
    ours, theirs = (loss.network(x[None], ["b1", "b3.expand"]) for x in (image, target))
    wanted = {tap: np.mean((ours[tap] - theirs[tap]).numpy() ** 2) for tap in ours}
    assert float(judged(loss, image, target)) == pytest.approx(np.mean(list(wanted.values())))
    assert float(judged(perceptual(), image, target)) == pytest.approx(wanted["b3.expand"])


def test_jitter_takes_four_shifts_in_turn_and_goes_on_after_a_restart():
    painting = PaintedView(*pictures(12, 10, torch.float32), Strokes.none())
    loss, second, third, sizes = Perceptual(jitter=3), Perceptual(jitter=3), Perceptual(jitter=3), set()
    loss.network.register_forward_pre_hook(lambda _, inputs: sizes.add(tuple(inputs[0].shape)))
    values = [float(loss(painting)) for _ in range(8)]
    assert len(set(values)) == 4
    assert values[:4] * 2 == values
    assert sizes == {(1, 3, 15, 13)}, "one size, so that the network's grid stays put"
    for _ in range(2):
        second(painting)
    assert list(second.state_dict()) == ["calls"]
    third.load_state_dict(second.state_dict())
    assert [float(third(painting)) for _ in range(4)] == values[2:6]
    for jitter in range(4):
        for rows in zip(*Perceptual(jitter=jitter).shifts, strict=True):
            assert set(rows) == set(range(jitter + 1)), "each row and column is gone through"


@pytest.mark.parametrize("name", NETWORKS)
def test_lpips_agrees_with_torchmetrics(tmp_path, monkeypatch, name):
    monkeypatch.setattr(published, "_get_tv_model_features", lambda net, _: torchvision_features(net))
    wanted = published._LPIPS(net=NETWORKS[name])
    image, target = torch.rand(2, 3, 35, 51)
    loss = Lpips(backbone=name, weights=str(saved(tmp_path, state_of(name))))
    assert loss.label == f"lpips-{name}"
    assert_close(judged(loss, image, target), wanted(image[None], target[None], normalize=True).squeeze())


def test_lpips_has_the_right_slope_and_is_by_default_the_distance_of_the_metrics(tmp_path):
    path = str(saved(tmp_path, state_of("squeeze")))
    image, target = pictures(9, 6)
    for loss in (Lpips().double(), Lpips(backbone="squeeze", weights=path).double()):
        value = partial(judged, loss, target=target)
        assert torch.autograd.gradcheck(lambda x, value=value: value(x), image.requires_grad_(), fast_mode=True)
    loss, (image, target) = Lpips(), pictures(40, 57, torch.float32)
    assert loss.label == "effl0"
    assert float(judged(loss, image, target)) == pytest.approx(perceptual_distance(image, target), rel=1e-6)


def test_positions_without_activation_have_a_slope():
    distance = open_distance()
    distance.network.stem.weight.zero_()
    distance.network.stem.bias.zero_()
    picture = torch.rand(3, 6, 8, requires_grad=True)
    seen = distance.look(picture)
    assert (seen[0] == 0).all()
    distance.compare(seen, [torch.rand_like(value) for value in seen]).backward()
    assert picture.grad.isfinite().all()


def test_metrics_hold_the_official_distance_if_there_is_a_file(tmp_path):
    a, b = np.random.default_rng(0).integers(0, 256, (2, 40, 33, 3), dtype=np.uint8)
    distance = open_distance("alexnet", str(saved(tmp_path, state_of("alexnet"))), "lpips_weights")
    found = measure(a, b, distance)
    shown = [torch.tensor(x).permute(2, 0, 1) / 255 for x in (a, b)]
    assert found["lpips_alexnet"] == pytest.approx(float(distance(*shown)))
    assert found == measure(a, b) | {"lpips_alexnet": found["lpips_alexnet"]}
    similarity = structural_similarity_index_measure(*(picture[None].double() for picture in shown), data_range=1.0)
    assert found["ssim"] == pytest.approx(float(similarity), abs=1e-6)
