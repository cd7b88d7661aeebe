"""YuNet, a convolutional network that detects faces and their landmarks."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from brushexp.system.reading_tensors import read_safetensors

WEIGHTS = Path(__file__).parent / "weights" / "yunet.safetensors"
STEM, STAGES = 16, ((16, 32), (32, 64), (64, 64), (64, 64), (64, 64))  # channels of the two units of each stage
POOLED = (1, 2, 3)  # stages after which the sides are halved
SEEN = (2, 3, 4)  # stages whose features are searched for faces
STRIDES = (8, 16, 32)  # pixels between neighbouring places in these features
WIDTH = 64  # channels of these features
LANDMARKS = 5
HEADS = {"cls": 1, "obj": 1, "bbox": 4, "kps": 2 * LANDMARKS}  # channels of each output


@dataclass(frozen=True)
class Candidates:
    """Bounding boxes that may contain a face, in pixels from the upper left corner of the picture."""

    score: Tensor  # (N,) 0 to 1
    middle: Tensor  # (N, 2: x, y)
    size: Tensor  # (N, 2: width, height)
    landmarks: Tensor  # (N, 5, 2: x, y) in the order of `Landmark`


class YuNet(nn.Module):
    """Detects upright faces of about 10 to 300 pixels, with the eyes, the nose and the corners of the mouth.

    Source: Wu, Peng and Yu (2023), "YuNet: a tiny millisecond-level face detector"; the weights are the March 2023
    version from OpenCV's model zoo, with batch norms folded into the convolutions (docs/decisions/027-faces.md).
    """

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.ModuleList([nn.Conv2d(3, STEM, 3, stride=2, padding=1), Unit(STEM, STEM)])
        channels = STEM
        for number, widths in enumerate(STAGES, 1):
            units = [Unit(channels, widths[0]), Unit(*widths)]
            self.add_module(f"stage{number}", nn.Sequential(*units))
            channels = widths[-1]
        for level in range(len(STRIDES)):
            self.add_module(f"lateral{level}", Unit(WIDTH, WIDTH))
            for head, answers in HEADS.items():
                self.add_module(f"{head}{level}", Unit(WIDTH, answers, rectify=False))

    @classmethod
    def load_shipped(cls) -> "YuNet":
        """Load the network with the shipped weights, frozen."""
        network = cls()
        network.load_state_dict(read_safetensors(WEIGHTS, "reinstall brushexp"))
        # Depthwise convolutions take half the time in this format, which torch's type stubs lack.
        network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        return network.eval().requires_grad_(False)

    def forward(self, picture: Tensor) -> Candidates:
        """Compute a candidate for every position in a picture (3, H, W), sRGB in [0, 1]; most have a score near 0."""
        height, width = picture.shape[1:]
        largest = STRIDES[-1]
        padded = functional.pad(255 * picture.flip(0), (0, -width % largest, 0, -height % largest))  # its input is BGR
        parts = []
        for level, (stride, features) in enumerate(zip(STRIDES, self.features(padded[None]), strict=True)):
            answers = {head: self.get_submodule(f"{head}{level}")(features)[0] for head in HEADS}
            parts.append(_decode(answers, stride))
        return Candidates(*(torch.cat(columns) for columns in zip(*parts, strict=True)))

    def features(self, picture: Tensor) -> list[Tensor]:
        """Compute the features (1, 64, h, w) of a picture (1, 3, H, W: BGR, 0 to 255) at each of `STRIDES`."""
        convolution, unit = self.stem
        x = functional.max_pool2d(unit(convolution(picture).relu()), 2)
        seen = []
        for number in range(len(STAGES)):
            x = self.get_submodule(f"stage{number + 1}")(x)
            if number in SEEN:
                seen.append(x)
            if number in POOLED:
                x = functional.max_pool2d(x, 2)
        coarser = torch.zeros(())
        for level in reversed(range(len(STRIDES))):  # add the features of the coarser level to each level
            seen[level] = self.get_submodule(f"lateral{level}")(seen[level] + coarser)
            coarser = functional.interpolate(seen[level], scale_factor=2)
        return seen


class Unit(nn.Module):
    """A pointwise and a depthwise convolution, followed by a rectifier except in output layers."""

    def __init__(self, channels: int, answers: int, *, rectify: bool = True) -> None:
        super().__init__()
        self.point = nn.Conv2d(channels, answers, 1)
        self.depth = nn.Conv2d(answers, answers, 3, padding=1, groups=answers)
        self.rectify = rectify

    def forward(self, x: Tensor) -> Tensor:
        x = self.depth(self.point(x))
        return x.relu() if self.rectify else x


def _decode(answers: dict[str, Tensor], stride: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Decode the outputs (C, h, w) at one stride into scores, centres, sizes and landmarks of h * w candidates."""
    score = (answers["cls"].sigmoid() * answers["obj"].sigmoid()).sqrt().flatten()
    height, width = answers["cls"].shape[1:]
    row, column = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    place = torch.stack([column, row], -1).reshape(-1, 2)
    box = answers["bbox"].flatten(1).T
    landmarks = answers["kps"].flatten(1).T.reshape(-1, LANDMARKS, 2)
    return score, stride * (place + box[:, :2]), stride * box[:, 2:].exp(), stride * (place[:, None] + landmarks)


open_network = cache(YuNet.load_shipped)  # once per process
