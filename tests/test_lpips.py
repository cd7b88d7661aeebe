"""The loss in the form of LPIPS: against loops and torchmetrics' own network, on a part of a canvas, and its names."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from networks import saved, state_of, torchvision_features
from torch import Tensor
from torch.testing import assert_close
from torchmetrics.functional.image import lpips as published

from brushexp.errors import UserError
from brushexp.features.distance import open_distance, perceptual_distance
from brushexp.painting.metrics import measure
from brushexp.plugins.loss.base import Painting
from brushexp.plugins.loss.lpips import Lpips
from brushexp.strokes.catalogue import Strokes

NETWORKS = {"alexnet": "alex", "squeeze": "squeeze", "vgg16": "vgg"}  # and what torchmetrics calls them


def judged(loss: Lpips, image: Tensor, target: Tensor) -> Tensor:
    return loss(Painting(image, target, Strokes.none()))


def test_the_default_is_the_distance_of_the_metrics_and_named_after_its_network():
    image, target = torch.rand(2, 3, 40, 57)
    loss = Lpips()
    assert loss.label == "effl0"
    assert float(judged(loss, image, target)) == pytest.approx(perceptual_distance(image, target), rel=1e-6)


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("size", [(64, 50), (35, 71)])
def test_published_networks_agree_with_torchmetrics(tmp_path, monkeypatch, name, size):
    monkeypatch.setattr(published, "_get_tv_model_features", lambda net, _: torchvision_features(net))
    wanted = published._LPIPS(net=NETWORKS[name])
    image, target = torch.rand(2, 3, *size)
    loss = Lpips(backbone=name, weights=str(saved(tmp_path, state_of(name))))
    assert loss.label == f"lpips-{name}"
    assert_close(judged(loss, image, target), wanted(image[None], target[None], normalize=True).squeeze())


def test_it_has_the_right_slope(tmp_path):
    path = str(saved(tmp_path, state_of("squeeze")))
    image, target = torch.rand(2, 3, 9, 6, dtype=torch.float64)
    for loss in (Lpips().double(), Lpips(backbone="squeeze", weights=path).double()):
        value = partial(judged, loss, target=target)
        assert torch.autograd.gradcheck(lambda x, value=value: value(x), image.requires_grad_(), fast_mode=True)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (12, 9)])
def test_extremes_are_finite_and_equal_pictures_cost_nothing(tmp_path, size):
    extremes = [torch.zeros(3, *size), torch.ones(3, *size), torch.rand(3, *size).round()]
    for loss in (Lpips(), Lpips(backbone="alexnet", weights=str(saved(tmp_path, state_of("alexnet"))))):
        for image in extremes:
            for target in extremes:
                x = image.clone().requires_grad_()
                value = judged(loss, x, target)
                assert value.isfinite()
                assert torch.autograd.grad(value, x)[0].isfinite().all()
                assert (value < 1e-9) == torch.equal(image, target)


def test_positions_without_activation_have_a_slope():
    distance = open_distance()
    distance.network.stem.weight.zero_()
    distance.network.stem.bias.zero_()
    picture = torch.rand(3, 6, 8, requires_grad=True)
    seen = distance.look(picture)
    assert (seen[0] == 0).all()
    distance.compare(seen, [torch.rand_like(value) for value in seen]).backward()
    assert picture.grad.isfinite().all()


def test_the_target_is_looked_at_once():
    loss, calls = Lpips(), []
    loss.distance.network.register_forward_pre_hook(lambda *_: calls.append(1))
    image, target, other = torch.rand(3, 3, 12, 10)
    for _ in range(3):
        judged(loss, image, target)
    assert len(calls) == 4
    assert_close(judged(loss, image, other), judged(Lpips(), image, other))
    assert len(calls) == 6


def test_descent_lowers_it():
    target = torch.rand(3, 24, 33)
    image = torch.full_like(target, 0.5).requires_grad_()
    loss, optimizer = Lpips(), torch.optim.Adam([image], lr=0.05)
    before = judged(loss, image, target).item()
    for _ in range(20):
        optimizer.zero_grad()
        judged(loss, image, target).backward()
        optimizer.step()
    assert judged(loss, image, target).item() < 0.3 * before


def test_what_cannot_be_opened_is_refused_with_the_option_to_set():
    with pytest.raises(UserError, match=r"loss\.lpips\.backbone=resnet .*choose one of effl0, alexnet, squeeze, vgg16"):
        Lpips(backbone="resnet")
    with pytest.raises(UserError, match=r"loss\.lpips\.backbone=vgg16-hed has no weights"):
        Lpips(backbone="vgg16-hed")
    with pytest.raises(UserError, match=r"set loss\.lpips\.weights=path, .*loss\.lpips\.backbone=effl0"):
        Lpips(backbone="alexnet")
    with pytest.raises(UserError, match="no file"):
        Lpips(backbone="squeeze", weights="absent.pth")


def test_metrics_hold_the_official_distance_if_there_is_a_file(tmp_path: Path):
    a, b = np.random.default_rng(0).integers(0, 256, (2, 40, 33, 3), dtype=np.uint8)
    distance = open_distance("alexnet", str(saved(tmp_path, state_of("alexnet"))), "lpips_weights")
    found = measure(a, b, distance)
    pictures = [torch.tensor(x).permute(2, 0, 1) / 255 for x in (a, b)]
    assert found["lpips_alexnet"] == pytest.approx(float(distance(*pictures)))
    assert found == measure(a, b) | {"lpips_alexnet": found["lpips_alexnet"]}
