"""Measure rate and distortion: the size of the encoded strokes, and the error of the picture painted from them."""

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
LEAST = 1e-7  # mean squared error that rounding may add to a painting identical to its target
FILE = "strokes.bits"


@register("metric", "bits")
class BitsPerPixel(Metric):
    """Bits per pixel of the rounded strokes, coded as a file (strokes.bits).

    Strokes are rounded as coarsely as ``loss`` allows, or as finely as ``size`` allows; if ``size`` is set, the run
    keeps the file. Compare the bits with ``psnr_decoded``, the PSNR of the painting decoded from the same file. Do not
    compare them with ``psnr``, which is computed before rounding.

    Args:
        loss: maximum loss of PSNR from rounding, in dB.
        size: maximum size of the file, which replaces ``loss``: 1500B, 20kB, 0.5MB; null = no limit.
        steps: number of gradient steps during rounding; 0 is fastest but needs more bits.
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
                data = self._encode(comparison, job).data
        except UserError as error:
            log.warning("%s was not written: %s", FILE, error)
            return None
        saved = read_bits(data)
        decoded = replace(job, saved=replace(job.saved, strokes=saved.strokes, depth=saved.depth)).picture()
        pixels: np.ndarray = to_bytes(target)
        psnr = picture_psnr(decoded, pixels)
        self.remarks = {"psnr_decoded": psnr}
        if self.size is not None:
            self.remarks, self.files = {"bytes": len(data), "psnr_decoded": psnr}, {FILE: data}
            bits = 8 * len(data) / max(1, len(saved.strokes))
            log.info("%s: %d bytes, %.1f bits per stroke, %.2f dB after decoding", FILE, len(data), bits, psnr)
        return 8 * len(data) / target[0].numel()

    def _encode(self, comparison: Comparison, job: ExportJob) -> Coded:
        target = comparison.target
        goal = target if max(job.size) <= SIDE else None
        if self.size is not None:
            return code_within(job, size=size_from(self.size, "bits"), goal=goal, steps=self.steps, option="bits")
        before = mean_square(comparison.image - target)
        allowed = max(LEAST, before * (10 ** (self.loss / 10) - 1))
        return code(job, allowed=allowed, goal=goal, steps=self.steps)
