"""Test that networks with weights from a user's file give torchvision's results, and that other files are rejected."""

import pytest
import torch
from brushexp_losses.classic import ClassicNetwork
from networks import saved, state_of, torchvision_features
from refusals import refuses
from safetensors.torch import save_file
from torch.nn import functional
from torch.testing import assert_close

from brushexp.features import open_backbone

PLACES = {  # indices of the activations in torchvision's `features`
    "alexnet": (1, 4, 7, 9, 11),
    "squeeze": (1, 3, 4, 6, 7, 9, 10, 11, 12),
    "vgg16": (1, 3, 6, 8, 11, 13, 15, 18, 20, 22, 25, 27, 29),
}


@pytest.mark.parametrize("name", PLACES)
@pytest.mark.parametrize(("size", "suffix"), [((31, 40), "pth"), ((66, 51), "safetensors")])
def test_classic_networks_from_a_file_agree_with_torchvision(tmp_path, name, size, suffix):
    path = tmp_path / f"weights.{suffix}"
    state = state_of(name) | {"classifier.0.weight": torch.zeros(2, 2)}
    (torch.save if suffix == "pth" else save_file)(state, path)
    network, x = open_backbone(name, str(path)), torch.rand(1, 3, *size)
    activations = dict(zip(PLACES[name], network(x, network.taps).items(), strict=True))
    mean, deviation = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    x = (x - mean[:, None, None]) / deviation[:, None, None]
    for place, layer in enumerate(torchvision_features(name)):
        x = layer(x)
        if place in activations:
            assert_close(activations[place][1], x, rtol=1e-4, atol=1e-4)
    assert [name for name, _ in activations.values()][-1] in ("relu5", "fire9", "relu5_3")


def test_small_pictures_are_widened_by_their_border_and_others_left_alone():
    picture = torch.rand(1, 3, 20, 40)
    wide = functional.pad(picture, (0, 0, 5, 6), mode="replicate")
    network = ClassicNetwork("alexnet", state_of("alexnet"))
    activations, expected = (network(x, ["relu1", "relu5"]) for x in (picture, wide))
    for tap, value in activations.items():
        assert_close(value, expected[tap], rtol=0, atol=0)


@pytest.mark.parametrize("name", PLACES)
def test_files_of_other_networks_are_refused(tmp_path, name):
    refuses(rf"backbone {name} needs a file.*set loss\.perceptual\.weights=path", open_backbone, name)
    words = r"set loss\.lpips\.weights=path, .*loss\.lpips\.backbone=effl0"
    refuses(words, open_backbone, name, option="loss.lpips.weights")
    words = rf"weights: Missing key.*\.weight.*torchvision's {name}"
    refuses(words, open_backbone, name, str(saved(tmp_path, {"layer": torch.zeros(1)})))
    mixed = state_of(name) | {"features.0.weight": torch.zeros(2, 3, 7, 7)}
    refuses(r"size mismatch for features\.0\.weight.*\[2, 3, 7, 7\]", open_backbone, name, str(saved(tmp_path, mixed)))
    (tmp_path / "text.pth").write_text("hello")
    for file, reason in (("absent.pth", "no file"), ("text.pth", "is damaged or cut short")):
        refuses(reason, open_backbone, name, str(tmp_path / file))
