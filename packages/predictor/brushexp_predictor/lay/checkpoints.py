"""Check that a key names trained weights."""

from dataclasses import replace

from brushexp.contracts import Rule


def check_weights(checkpoint: str, option: str) -> None:
    """Raise UserError unless ``checkpoint`` is the name of shipped weights or the path of a weights file."""
    from brushexp_predictor.lay.network import PREDICTORS  # noqa: PLC0415  (``--help`` needs no compiled kernels)

    replace(PREDICTORS, key=option).path_of(checkpoint)


WEIGHTS = Rule(check_weights)
