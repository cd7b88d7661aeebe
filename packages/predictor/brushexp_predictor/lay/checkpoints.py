"""Which trained weights there are."""

from dataclasses import replace

from brushexp.contracts import Rule


def check_weights(checkpoint: str, option: str) -> None:
    """Refuse (UserError) what is neither the name of weights that ship nor the path of some."""
    from brushexp_predictor.lay.network import PREDICTORS  # noqa: PLC0415  (``--help`` needs no compiled kernels)

    replace(PREDICTORS, key=option).path_of(checkpoint)


WEIGHTS = Rule(check_weights)
