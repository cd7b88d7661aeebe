"""What samples are compared with: gradient descent from other seeds, for as many seconds."""

import logging
import time
from collections.abc import Iterator

import lightning as L
import torch
from torch import Tensor

from brushexp.painting.components import standard_components
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.plugins.init.layers import InLayers
from brushexp.strokes.catalogue import Catalogue
from brushexp_predictor.decoding import FORMS
from brushexp_predictor.sampling import Sample, sample_of

STEPS = 15  # of gradient descent
LEAST = 2  # restarts, however few seconds there are


def restart(target: Tensor, n: int, seconds: float, seed: int = 0, steps: int = STEPS) -> Iterator[Sample]:
    """Paint a target (3, H, W) by ``steps`` from ``init=layers``, with other seeds while CPU ``seconds`` last.

    Only the placing of strokes and the steps count, not what Lightning needs to begin.
    """
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    used, number = 0.0, 0
    while used < seconds or number < LEAST:
        begin = time.process_time()
        first = InLayers()(target, n, torch.Generator().manual_seed(1_000_003 * seed + number))
        parts = standard_components(steps=steps)
        used += time.process_time() - begin
        catalogue = Catalogue(first, parts.optimizer.units)
        painter = StrokeOptimizer(catalogue, parts, target, target.mean((1, 2)), seed=seed + number)
        trainer = L.Trainer(
            max_epochs=-1, accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False,
            enable_model_summary=False,
        )  # fmt: skip
        trainer.fit(painter)
        used += painter.schedule.cpu_seconds
        number += 1
        with torch.no_grad():
            bottom_up = painter.front_to_back.flip(0)
            strokes = painter.strokes().map(Tensor.detach)[bottom_up]
        yield sample_of(FORMS["plain"], strokes, target)
