"""The network that predicts a stroke for each cell of a picture, given the canvas so far."""

from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d, gelu, layer_norm

from brushexp.contracts import UserError
from brushexp.contracts.files import CheckpointFormat
from brushexp_predictor.lay.decoding import FORMS

CELL = 8  # side of a cell in pixels of the network's input
NUMBERS = 11  # shift (x, y), cosine and sine of twice the angle, half length, bend, width, RGB, opacity
INPUTS = 10  # target - 1/2, canvas - 1/2, three times their difference, and 1 within the picture
RECEPTIVE_FIELD = 14  # maximum distance in cells at which a pixel affects a cell
DEVIATION, SPREAD = -2.5, 3.0  # initial logarithm of the numbers' deviations, and its maximum change

SHIPPED_NAME = "plain"
PREDICTORS = CheckpointFormat(
    noun="predictor", family="predictor", key="checkpoint", task="task=train_predictor", without="",
    folders=lambda: [Path(__file__).parent / "weights"],
)  # fmt: skip


class CellPredictions(NamedTuple):
    """The network's output for the cells of B pictures."""

    numbers: Tensor  # (B, H, W, 11)
    deviations: Tensor  # (B, H, W, 11), logarithms
    worth: Tensor  # (B, H, W), log-odds of the share of a cell's error that its stroke removes


class Block(nn.Module):
    """A ConvNeXt block (Liu et al., 2022) on features (B, H, W, C)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.spread = nn.Conv2d(width, width, 5, padding=2, groups=width)
        self.norm = nn.LayerNorm(width)
        self.widen, self.narrow = nn.Linear(width, 2 * width), nn.Linear(2 * width, width)
        self.scale = nn.Parameter(torch.full((width,), 0.3))

    def forward(self, x: Tensor) -> Tensor:
        spread = self.spread(x.permute(0, 3, 1, 2)).permute(0, 2, 3, 1)
        normal = layer_norm(spread, self.norm.normalized_shape, self.norm.weight, self.norm.bias)
        return torch.addcmul(x, self.scale, self.narrow(gelu(self.widen(normal))))


class StrokePredictor(nn.Module):
    """Predict a stroke for each cell of `CELL` pixels from a target and a canvas.

    Args:
        form: form of the strokes, as a key of `FORMS`.
        width: number of features per cell.
        blocks: number of ConvNeXt blocks; each extends the receptive field by two cells.
    """

    def __init__(self, form: str = "plain", width: int = 64, blocks: int = 6) -> None:
        super().__init__()
        self.form = FORMS[form]
        self.look = nn.Conv2d(INPUTS, 32, 6, stride=4, padding=1)
        self.gather = nn.Conv2d(32, width, 4, stride=2, padding=1)
        self.blocks = nn.Sequential(*(Block(width) for _ in range(blocks)))
        self.tell = nn.Linear(width, 2 * NUMBERS + 1)
        with torch.no_grad():
            self.tell.weight.mul_(0.1)
            self.tell.bias.zero_()

    def forward(self, target: Tensor, canvas: Tensor) -> CellPredictions:
        """Predict strokes from targets and canvases (B, 3, `CELL` H, `CELL` W)."""
        seen = torch.cat([target, canvas, torch.ones_like(target[:, :1])], 1)
        looked = conv2d(seen, self._look_weight(), self.look.bias, self.look.stride, self.look.padding)
        features = gelu(self.gather(gelu(looked).contiguous(memory_format=torch.channels_last)))
        told = self.tell(self.blocks(features.permute(0, 2, 3, 1)))
        deviations = DEVIATION + SPREAD * torch.tanh(told[..., NUMBERS : 2 * NUMBERS] / SPREAD)
        return CellPredictions(told[..., :NUMBERS], deviations, told[..., -1])

    def _look_weight(self) -> Tensor:
        """Fold the weights of all `INPUTS` into weights for target, canvas and a constant 1, which halves the work."""
        target, canvas, difference, inside = self.look.weight.split((3, 3, 3, 1), 1)
        middle = 0.5 * (target + canvas).sum(1, keepdim=True)
        return torch.cat([target + 3 * difference, canvas - 3 * difference, inside - middle], 1)


def load_predictor(checkpoint: str = SHIPPED_NAME) -> StrokePredictor:
    """Load a trained network from a .safetensors file, or from shipped weights by name."""
    path = PREDICTORS.path_of(checkpoint)
    form = PREDICTORS.read_recipe(path)["options"].get("form", SHIPPED_NAME)
    if form not in FORMS:
        raise UserError(f"{path.with_suffix('.json')} has an unknown form of strokes; train the network again")
    network = StrokePredictor(form)
    PREDICTORS.restore(network, SHIPPED_NAME, checkpoint, {})
    return network.requires_grad_(False)
