"""Trained networks, as files of weights."""

from pathlib import Path

from brushexp.errors import UserError
from brushexp.system.checkpoint import CheckpointFormat
from brushexp_predictor.decoding import FORMS
from brushexp_predictor.network import StrokePredictor

NAME = "plain"
PREDICTORS = CheckpointFormat(
    noun="predictor", family="predictor", key="checkpoint", task="task=train model=predictor", without="",
    folders=lambda: [Path(__file__).parent / "weights"],
)  # fmt: skip


def load_predictor(checkpoint: str = NAME) -> StrokePredictor:
    """Load a trained network: a .safetensors file, or the name of one that comes with the program."""
    path = PREDICTORS.path_of(checkpoint)
    form = PREDICTORS.read_recipe(path)["options"].get("form", NAME)
    if form not in FORMS:
        raise UserError(f"{path.with_suffix('.json')} has no form of strokes that this brushexp knows; train it again")
    network = StrokePredictor(form)
    PREDICTORS.restore(network, NAME, checkpoint, {})
    return network.requires_grad_(False)
