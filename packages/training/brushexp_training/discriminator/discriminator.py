"""Penalise invalid strokes with a network that recognises valid strokes; `discriminator_module` trains this network."""

from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from brushexp.contracts import register
from brushexp.contracts.families import Loss, PaintedView
from brushexp.contracts.files import CheckpointFormat
from brushexp.contracts.strokes import SHORTEST_CHORD, Strokes, at_least_single, bend_of, parameters_of, strokes_of

DISCRIMINATOR = "discriminator"
DISCRIMINATORS = CheckpointFormat(
    noun="discriminator",
    family="loss",
    key=f"loss.{DISCRIMINATOR}.checkpoint",
    task=f"task=train_{DISCRIMINATOR}",
    without="the one that comes with the program",
    folders=lambda: [Path(__file__).parent / "weights"],
)
SHAPE = 7  # numbers of a stroke that are judged: start 2, control 2, end 2, width 1
SEEN = SHAPE + 3  # inputs of the network: also the length, and the bend along and across it
HIDDEN_WIDTH = 64  # width of the hidden layers
STRETCH = 4.0  # factor before the inverse hyperbolic sine, which is linear within a window and logarithmic beyond


class Discriminator(nn.Module):
    """A network with three hidden layers that scores how valid a stroke's shape is.

    The score is a logit. Because mirroring does not affect a stroke's validity, the network receives only the absolute
    values of coordinates and bend. All inputs are passed through asinh, so that the gradient does not vanish even for a
    stroke a thousand windows away.
    """

    threshold: Tensor  # score below which a stroke counts as invalid

    def __init__(self) -> None:
        super().__init__()
        widths = (SEEN, HIDDEN_WIDTH, HIDDEN_WIDTH)
        hidden = (layer for width in widths for layer in (nn.Linear(width, HIDDEN_WIDTH), nn.SiLU()))
        self.layers = nn.Sequential(*hidden, nn.Linear(HIDDEN_WIDTH, 1))
        self.register_buffer("threshold", torch.zeros(()))

    def forward(self, shapes: Tensor) -> Tensor:
        """Compute the scores (N,), which are logits, for the shapes (N, 7) from `shapes_of`."""
        points, width = shapes.split([SHAPE - 1, 1], dim=1)
        square = (points[:, :2] - points[:, 4:]).square().sum(1, keepdim=True)
        length = (square + SHORTEST_CHORD**2).sqrt()  # has a slope even if both ends coincide
        bend = bend_of(strokes_of(functional.pad(shapes, (0, 3))))
        inputs = torch.cat([points.abs(), width, length, bend.abs()], dim=1)
        return self.layers((STRETCH * inputs).asinh())[:, 0]


@register("loss", DISCRIMINATOR)
class Discriminated(Loss):
    """Hinge loss max(0, threshold - score) of a discriminator trained to recognise valid strokes.

    Source: thesis 2020, 6.3 (only mentioned there). The network, which has a few dense layers, was trained to
    distinguish strokes sampled from `strokes.prior` from corrupted strokes, and is frozen here. It receives the shape
    in the window (start, control, end and width), but neither position nor colour. One valid stroke in twenty scores
    below the threshold, so valid strokes cost almost nothing (0.04, compared with 160 for corrupted strokes); invalid
    strokes are pulled back from anywhere in ``strokes.catalogue.FIELDS``.

    Args:
        weight: factor in the sum of losses. On a portrait, a third of the strokes were valid at the end with ``mse``
            alone, two thirds with the default weight (at a cost of 0.2 dB), and four fifths with a weight of 0.001 (at
            about the same cost).
        checkpoint: weights from ``task=train_discriminator`` (.safetensors); null = the shipped weights.
    """

    weight = 0.0001
    cost = "0.8 x mse"
    looks_at = "strokes"

    def __init__(self, *, checkpoint: str | None = None) -> None:
        super().__init__()
        self.network = Discriminator()
        DISCRIMINATORS.restore(self.network, DISCRIMINATOR, checkpoint or DISCRIMINATOR, {})
        self.network.requires_grad_(False)

    def forward(self, view: PaintedView) -> Tensor:
        shapes = shapes_of(view.strokes.map(at_least_single)).to(self.network.threshold.dtype)
        missing = functional.relu(self.network.threshold - self.network(shapes))
        return missing.sum() / max(len(shapes), 1)


def shapes_of(strokes: Strokes) -> Tensor:
    """Encode start, control, end and width as parameters (N, 7); see `strokes.prior.parameters_of`."""
    return parameters_of(strokes)[:, :SHAPE]
