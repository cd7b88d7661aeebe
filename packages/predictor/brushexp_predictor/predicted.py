"""Place strokes as a trained network does that sees the picture a few times."""

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
    """A network lays strokes from large to small, each where the canvas so far is worst, in a fifth of a second.

    It is trained through the renderer (``task=train_predictor``), as nothing but the picture of the strokes
    counts. Source: the feed-forward prediction that the thesis (2020) aims at; in stages, each of which sees what is on
    the canvas so far, as Paint Transformer (Liu et al., 2021). Differs: one stroke for each cell, which it may leave,
    no labels, and colours by least squares at the end.

    Args:
        checkpoint: trained weights: a .safetensors file, or one that ships: plain, or brushed for
            look=oil and its like (renderer=textured).
        temperature: how much strokes vary from seed to seed, in the deviations that the network says; 0 = not at all.
        color_rounds: of the search for the best colours (conjugate gradients); 0 keeps those that the network says.
        draft_effort: share of a look's steps that ``quality=draft`` takes from these strokes.
    """

    checkpoint: Annotated[str, WEIGHTS] = "plain"
    temperature: Annotated[float, between(0, 10)] = 0.0
    color_rounds: Annotated[int, between(0, 100)] = ROUNDS
    draft_effort: Annotated[float, between(0, 1)] = 0.028

    def __call__(self, target: Tensor, n: int, generator: torch.Generator, focus: Tensor | None = None) -> Strokes:
        from brushexp_predictor.lay.network import load_predictor  # noqa: PLC0415  (``--help`` needs no compiled kernels)
        from brushexp_predictor.lay.predicting import in_best_colors, predict  # noqa: PLC0415

        network = load_predictor(self.checkpoint)
        *_, strokes = predict(network, target, n, generator, self.temperature, focus)
        strokes = strokes[Area().depth(strokes, None).argsort(stable=True)]  # the colours suit the order of the start
        return in_best_colors(network, strokes, target, self.color_rounds)
