"""All that is learnt for recovering strokes, in one file of weights."""

from pathlib import Path

from torch import nn

from brushexp.system.checkpoint import CheckpointFormat
from brushexp_recovery.judges import Judge
from brushexp_recovery.merging import PAIR_FEATURES
from brushexp_recovery.network import StrokeNetwork

NAME = "strokes"
NODE_FEATURES = 35
ORDER_FEATURES, CONFIDENCE_FEATURES = 9, 3  # of `stacking.meetings_of` and `calibration.signs_of`
RECOVERIES = CheckpointFormat(
    noun="recovery", family="recovery", key="weights", task="task=train_recovery", without="",
    folders=lambda: [Path(__file__).parent / "weights"],
)  # fmt: skip


class RecoveryModel(nn.Module):
    """The network, the judges of pairs and of nodes, and how far these are to be believed."""

    def __init__(self) -> None:
        super().__init__()
        self.network = StrokeNetwork()
        self.pairs = Judge(PAIR_FEATURES)
        self.nodes = Judge(NODE_FEATURES, 2)  # chance of an IoU of 0.5 or more, and the IoU
        self.order = nn.Linear(ORDER_FEATURES, 1, bias=False)  # log-odds that the second of two lies above
        self.confidence = nn.Linear(CONFIDENCE_FEATURES, 1)  # log-odds that a region is a stroke
        for linear in (self.order, self.confidence):  # untrained, they believe what they are told first
            linear.weight.data.zero_()[0, 0] = 1.0
        self.confidence.bias.data.zero_()


def load_model(checkpoint: str = NAME) -> RecoveryModel:
    """Load trained weights: a .safetensors file, or the name of those that come with the program."""
    model = RecoveryModel()
    RECOVERIES.restore(model, NAME, checkpoint, {})
    return model
