"""Place strokes with a trained network, in a few passes over the picture."""

from dataclasses import dataclass
from typing import Annotated

import torch
from torch import Tensor

from brushexp.contracts import between, register
from brushexp.contracts.families import Initializer
from brushexp.contracts.members import Area
from brushexp.contracts.strokes import Strokes
from brushexp_predictor.lay.checkpoints import WEIGHTS
from brushexp_predictor.lay.colors import ROUNDS


@register("init", "predicted")
@dataclass(kw_only=True)
class Predicted(Initializer):
    """Place strokes from large to small with a network, where the canvas still differs most, in a fifth of a second.

    The network is trained through the renderer (``task=train_predictor``), because only the resulting picture matters.

    Source: the feed-forward prediction proposed in the thesis (2020), in stages that receive the canvas so far, as in
    Paint Transformer (Liu et al., 2021). Unlike in the source, there is one stroke per cell, which may extend beyond
    the cell; training needs no labels; and colours are fitted by least squares at the end.

    Args:
        checkpoint: trained weights: a .safetensors file, or the name of shipped weights, which is plain, or brushed for
            look=oil and similar looks (renderer=textured).
        temperature: variation in strokes between seeds, in units of the deviations that the network predicts; 0 = none.
        color_rounds: number of conjugate-gradient rounds that optimise colours; 0 keeps the predicted colours.
        draft_effort: fraction of a look's steps that ``quality=draft`` takes, starting from these strokes.
    """

    checkpoint: Annotated[str, WEIGHTS] = "plain"
    temperature: Annotated[float, between(0, 10)] = 0.0
    color_rounds: Annotated[int, between(0, 100)] = ROUNDS
    draft_effort: Annotated[float, between(0, 1)] = 0.028

    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        from brushexp_predictor.lay.network import load_predictor  # noqa: PLC0415  (``--help`` needs no compiled kernels)
        from brushexp_predictor.lay.predicting import predict, with_best_colors  # noqa: PLC0415

        network = load_predictor(self.checkpoint)
        *_, strokes = predict(network, target, n, generator, self.temperature, focus)
        strokes = strokes[Area().depth(strokes, None).argsort(stable=True)]  # colours are fitted for this initial order
        return with_best_colors(network, strokes, target, self.color_rounds)
