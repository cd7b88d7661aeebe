"""Measure rate and distortion: the size of the strokes as a file, and the picture that is painted of it."""

from dataclasses import replace
from typing import Annotated

import numpy as np
import torch

from brushexp.contracts import at_least, between, register
from brushexp.contracts.families import Comparison, Metric
from brushexp.contracts.files import to_bytes
from brushexp.contracts.pictures import picture_psnr
from brushexp_coding.file import read_bits
from brushexp_coding.fitting import SIDE, code, mean_square

LEAST = 1e-7  # mean squared error that rounding may add to a painting that is its target


@register("metric", "bits")
class BitsPerPixel(Metric):
    """Bits per pixel of the strokes, rounded and coded as a file (strokes.bits).

    They are rounded as coarsely as ``loss`` allows. Beside the bits stands ``psnr_decoded``, the PSNR of what is
    painted from that very file: these two belong together, and `psnr` is that of the strokes before they are rounded.

    Args:
        loss: PSNR that rounding may cost, dB.
        steps: number of gradient steps after rounding; 0 is quick but takes more bits.
    """

    title, digits = "bits per pixel", 3
    higher_is_better = False
    needs = ("job",)

    def __init__(
        self, *, loss: Annotated[float, between(0.01, 10)] = 0.15, steps: Annotated[int, at_least(0)] = 60
    ) -> None:
        self.loss, self.steps = loss, steps

    def __call__(self, comparison: Comparison) -> float:
        assert comparison.job is not None
        job, target = comparison.job, comparison.target
        before = mean_square(comparison.image - target)
        goal = target if max(job.size) <= SIDE else None
        allowed = max(LEAST, before * (10 ** (self.loss / 10) - 1))
        with torch.enable_grad():
            coded = code(job, allowed=allowed, goal=goal, steps=self.steps)
        saved = read_bits(coded.data)
        decoded = replace(job, saved=replace(job.saved, strokes=saved.strokes, depth=saved.depth)).picture()
        pixels: np.ndarray = to_bytes(target)
        self.remarks = {"psnr_decoded": picture_psnr(decoded, pixels)}
        return 8 * len(coded.data) / target[0].numel()
