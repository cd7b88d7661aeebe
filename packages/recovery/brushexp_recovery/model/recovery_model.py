"""Combine all learned models for stroke recovery in one weights file."""

from pathlib import Path
from typing import NamedTuple

from torch import nn

from brushexp.contracts.files import CheckpointFormat
from brushexp_recovery.model.features import ConfidenceFeature, NodeFeature, NodeScore, OrderFeature, PairFeature
from brushexp_recovery.model.perceptron import Perceptron, PerceptronWeights
from brushexp_recovery.model.unet import StrokeNetwork

SHIPPED_WEIGHTS = "strokes"
CHECKPOINTS = CheckpointFormat(
    noun="recovery",
    family="recovery",
    key="weights",
    task="task=train_recovery",
    without="",
    folders=lambda: [Path(__file__).parents[1] / "weights"],
)


class Classifiers(NamedTuple):
    """The perceptrons that score pairs of regions and individual regions."""

    pairs: PerceptronWeights  # chance that two regions belong to one stroke
    nodes: PerceptronWeights  # `NodeScore`s of a region


class RecoveryModel(nn.Module):
    """The network, and the models that score the regions found in the network's maps."""

    def __init__(self) -> None:
        super().__init__()
        self.network = StrokeNetwork()
        self.pairs = Perceptron(len(PairFeature))  # log-odds that two regions belong to one stroke
        self.nodes = Perceptron(len(NodeFeature), len(NodeScore))
        self.order = nn.Linear(len(OrderFeature), 1, bias=False)  # log-odds that the second of two lies above
        self.confidence = nn.Linear(len(ConfidenceFeature), 1)  # log-odds that a region is a stroke
        for linear in (self.order, self.confidence):  # before training, they use only their first feature
            linear.weight.data.zero_()[0, 0] = 1.0
        self.confidence.bias.data.zero_()

    def classifiers(self) -> Classifiers:
        """Return the two perceptrons in a form that does not use PyTorch."""
        return Classifiers(self.pairs.weights(), self.nodes.weights())


def trained_families(checkpoint: str) -> tuple[str, ...]:
    """Return the paint families on which a checkpoint was trained, including the families of its initial weights."""
    recipe = CHECKPOINTS.read_recipe(CHECKPOINTS.path_of(checkpoint))
    return tuple(recipe["data"].get("families", ()))


def load_model(checkpoint: str = SHIPPED_WEIGHTS) -> RecoveryModel:
    """Load trained weights, given a .safetensors file or the name of shipped weights."""
    model = RecoveryModel()
    CHECKPOINTS.restore(model, SHIPPED_WEIGHTS, checkpoint, {})
    return model
