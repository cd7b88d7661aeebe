"""All that is learnt for recovering strokes, in one file of weights."""

from pathlib import Path

import torch
from torch import Tensor, nn

from brushexp.system.checkpoint import CheckpointFormat
from brushexp_recovery.judges import Judge
from brushexp_recovery.merging import PAIR_FEATURES
from brushexp_recovery.network import StrokeNetwork

NAME = "strokes"
NODE_FEATURES = 35
KNOTS = 9  # of the curve from what the judge of nodes says to the share of such strokes that were really there
RECOVERIES = CheckpointFormat(
    noun="recovery", family="recovery", node="recovery", task="task=train model=recovery", without="no recovery",
    folders=lambda: [Path(__file__).parent / "weights"],
)  # fmt: skip


class RecoveryModel(nn.Module):
    """The network, the judges of pairs and of nodes, and how far these are to be believed."""

    confidence: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.network = StrokeNetwork()
        self.pairs = Judge(PAIR_FEATURES)
        self.nodes = Judge(NODE_FEATURES, 2)  # chance of an IoU of 0.5 or more, and the IoU
        self.register_buffer("confidence", torch.linspace(0, 1, KNOTS))  # at chances of 0 to 1


def load_model(checkpoint: str = NAME) -> RecoveryModel:
    """Load trained weights: a .safetensors file, or the name of those that come with the program."""
    model = RecoveryModel()
    RECOVERIES.restore(model, NAME, checkpoint, {})
    return model
