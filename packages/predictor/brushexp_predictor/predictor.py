"""The ``predictor`` painter: a trained network without gradient steps."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

from brushexp.contracts import between, register
from brushexp.contracts.families import Painter, PaintRequest, PaintState
from brushexp_predictor.lay.checkpoints import WEIGHTS
from brushexp_predictor.lay.colors import ROUNDS, best_colors


@register("painter", "predictor")
@dataclass(kw_only=True)
class Predictor(Painter):
    """Place all strokes with a network in a few passes over the picture; see ``init=predicted``.

    Args:
        checkpoint: trained weights: a .safetensors file, or the name of shipped weights, which is plain, or brushed for
            look=oil and similar looks (renderer=textured).
        temperature: variation in strokes between seeds, in units of the deviations that the network predicts; 0 = none.
        color_rounds: number of conjugate-gradient rounds that optimise colours; 0 keeps the predicted colours.
    """

    kind, differentiates = "a trained network", True

    checkpoint: Annotated[str, WEIGHTS] = "plain"
    temperature: Annotated[float, between(0, 10)] = 0.0
    color_rounds: Annotated[int, between(0, 100)] = ROUNDS

    def __call__(self, request: PaintRequest) -> Iterator[PaintState]:
        from brushexp_predictor.lay.network import load_predictor  # noqa: PLC0415  (``--help`` needs no compiled kernels)
        from brushexp_predictor.lay.predicting import predict  # noqa: PLC0415

        network, step = load_predictor(self.checkpoint), 0
        for strokes in predict(network, request.target.cpu(), request.n, request.generator, self.temperature):
            step += 1
            yield PaintState(strokes, step, step + 1)
        here = strokes.map(lambda value: value.to(request.target.device))
        yield PaintState(best_colors(here, request.target, request.draw, self.color_rounds), step + 1, step + 1)
