"""Measure rate and distortion: the size of the strokes as a file, and the picture that is painted of it."""

import logging
from dataclasses import replace
from typing import Annotated

import numpy as np
import torch

from brushexp.contracts import UserError, at_least, between, register
from brushexp.contracts.families import Comparison, ExportJob, Metric
from brushexp.contracts.files import to_bytes
from brushexp.contracts.pictures import picture_psnr
from brushexp_coding.file import read_bits
from brushexp_coding.fitting import SIDE, Coded, code, code_within, mean_square
from brushexp_coding.sizes import SIZE, size_from

log = logging.getLogger(__name__)
LEAST = 1e-7  # mean squared error that rounding may add to a painting that is its target
FILE = "strokes.bits"


@register("metric", "bits")
class BitsPerPixel(Metric):
    """Bits per pixel of the strokes, rounded and coded as a file (strokes.bits).

    They are rounded as coarsely as ``loss`` allows, or as finely as fits into ``size`` bytes; with a size, the run
    keeps the file. Beside the bits stands ``psnr_decoded``, the PSNR of what is painted from that very file: these two
    belong together, and `psnr` is that of the strokes before they are rounded.

    Args:
        loss: PSNR that rounding may cost, dB.
        size: largest size of the file, which replaces ``loss``: 1500B, 20kB, 0.5MB; null = no limit.
        steps: number of gradient steps after rounding; 0 is quick but takes more bits.
    """

    title, digits = "bits per pixel", 3
    higher_is_better = False
    needs = ("job",)

    def __init__(
        self,
        *,
        loss: Annotated[float, between(0.01, 10)] = 0.15,
        size: Annotated[str, SIZE] | None = None,
        steps: Annotated[int, at_least(0)] = 60,
    ) -> None:
        self.loss, self.size, self.steps = loss, size, steps

    def __call__(self, comparison: Comparison) -> float | None:
        assert comparison.job is not None
        job, target = comparison.job, comparison.target
        self.remarks, self.files = {}, {}
        try:
            with torch.enable_grad():
                data = self._coded(comparison, job).data
        except UserError as error:
            log.warning("%s is not written: %s", FILE, error)
            return None
        saved = read_bits(data)
        decoded = replace(job, saved=replace(job.saved, strokes=saved.strokes, depth=saved.depth)).picture()
        pixels: np.ndarray = to_bytes(target)
        psnr = picture_psnr(decoded, pixels)
        self.remarks = {"psnr_decoded": psnr}
        if self.size is not None:
            self.remarks, self.files = {"bytes": len(data), "psnr_decoded": psnr}, {FILE: data}
            bits = 8 * len(data) / max(1, len(saved.strokes))
            log.info("%s: %d bytes, %.1f bits a stroke, %.2f dB when it is decoded", FILE, len(data), bits, psnr)
        return 8 * len(data) / target[0].numel()

    def _coded(self, comparison: Comparison, job: ExportJob) -> Coded:
        target = comparison.target
        goal = target if max(job.size) <= SIDE else None
        if self.size is not None:
            return code_within(job, size=size_from(self.size, "bits"), goal=goal, steps=self.steps, option="bits")
        before = mean_square(comparison.image - target)
        allowed = max(LEAST, before * (10 ** (self.loss / 10) - 1))
        return code(job, allowed=allowed, goal=goal, steps=self.steps)
