"""Trained networks, as files of weights."""

from pathlib import Path

from brushexp.system.checkpoint import CheckpointFormat
from brushexp_predictor.network import StrokePredictor

NAME = "plain"
PREDICTORS = CheckpointFormat(
    noun="predictor", family="predictor", node="predictor", task="task=train model=predictor", without="no predictor",
    folders=lambda: [Path(__file__).parent / "weights"],
)  # fmt: skip


def load_predictor(checkpoint: str = NAME) -> StrokePredictor:
    """Load a trained network: a .safetensors file, or the name of one that comes with the program."""
    options = PREDICTORS.read_recipe(PREDICTORS.path_of(checkpoint))["options"]
    network = StrokePredictor(options.get("form", "plain"))
    PREDICTORS.restore(network, NAME, checkpoint, {})
    return network.requires_grad_(False)
