"""Classic networks with torchvision's structure and weight names, but random weights."""

from functools import cache
from itertools import pairwise
from pathlib import Path

import torch
from safetensors.torch import save_file
from torch import Tensor, nn

VGG = [3, 64, 64, 0, 128, 128, 0, 256, 256, 256, 0, 512, 512, 512, 0, 512, 512, 512]  # 0: pooling


class Fire(nn.Module):
    def __init__(self, before: int, inside: int, half: int) -> None:
        super().__init__()
        self.squeeze = nn.Conv2d(before, inside, 1)
        self.expand1x1 = nn.Conv2d(inside, half, 1)
        self.expand3x3 = nn.Conv2d(inside, half, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        x = self.squeeze(x).relu()
        return torch.cat([self.expand1x1(x).relu(), self.expand3x3(x).relu()], 1)


@cache
def torchvision_features(name: str) -> nn.Sequential:
    """Build the convolutions of alexnet, squeeze (squeezenet1_1) or vgg16; the weights keep activations stable."""
    torch.manual_seed(0)
    if name == "alexnet":
        first = [nn.Conv2d(3, 64, 11, 4, 2), nn.ReLU(), nn.MaxPool2d(3, 2)]
        second = [nn.Conv2d(64, 192, 5, padding=2), nn.ReLU(), nn.MaxPool2d(3, 2)]
        rest = [(nn.Conv2d(a, b, 3, padding=1), nn.ReLU()) for a, b in pairwise((192, 384, 256, 256))]
        network = nn.Sequential(*first, *second, *(layer for pair in rest for layer in pair))
    elif name.startswith("squeeze"):
        pool = nn.MaxPool2d(3, 2, ceil_mode=True)
        fires = [pool, Fire(64, 16, 64), Fire(128, 16, 64), pool, Fire(128, 32, 128), Fire(256, 32, 128), pool]
        last = [Fire(256, 48, 192), Fire(384, 48, 192), Fire(384, 64, 256), Fire(512, 64, 256)]
        network = nn.Sequential(nn.Conv2d(3, 64, 3, 2), nn.ReLU(), *fires, *last)
    else:
        layers: list[nn.Module] = []
        before = 3
        for channels in VGG[1:]:
            layers += [nn.Conv2d(before, channels, 3, padding=1), nn.ReLU()] if channels else [nn.MaxPool2d(2)]
            before = channels or before
        network = nn.Sequential(*layers)
    for layer in network.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight)
            nn.init.normal_(layer.bias, std=0.1)
    return network.requires_grad_(False)


def state_of(name: str) -> dict[str, Tensor]:
    """Return a network's weights, named as in torchvision."""
    return {f"features.{key}": value for key, value in torchvision_features(name).state_dict().items()}


def saved(folder: Path, state: dict[str, Tensor]) -> Path:
    """Save tensors to ``features.safetensors`` in a folder, and return the path."""
    path = folder / "features.safetensors"
    save_file(state, path)
    return path
