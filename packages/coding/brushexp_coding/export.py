"""Export strokes as a small file."""

import logging
from pathlib import Path
from typing import Annotated

from brushexp.contracts import at_least, between, register
from brushexp.contracts.families import Exporter, ExportJob
from brushexp.contracts.files import write_bytes
from brushexp.contracts.pictures import psnr_of
from brushexp_coding.fitting import SAME, Coded, code, code_within
from brushexp_coding.sizes import SIZE, size_from

log = logging.getLogger(__name__)


@register("to", "bits")
class Bits(Exporter):
    """Writes ``strokes.bits``: rounded strokes in a small file, to store, send or reopen with catalogue=strokes.bits.

    Each number is rounded according to its effect on the picture, and then coded; strokes that do not overlap may be
    reordered. The decoded painting has the same number of strokes, and either the PSNR ``fidelity`` or the highest PSNR
    that fits into ``size`` bytes. The file contains only the settings needed to draw the painting: renderer, colour
    space, paper and light.

    Args:
        fidelity: PSNR of the decoded painting against the exported one, in dB; a higher value needs more bits.
        size: maximum size of the file, which replaces ``fidelity``: 1500B, 20kB, 0.5MB; null = no limit.
        steps: number of gradient steps in which unrounded values compensate for rounded ones; 0 is fastest.
    """

    def __init__(
        self,
        *,
        fidelity: Annotated[float, between(20, 70)] = 45.0,
        size: Annotated[str, SIZE] | None = None,
        steps: Annotated[int, at_least(0)] = 60,
    ) -> None:
        self.fidelity, self.size, self.steps = fidelity, size, steps

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        coded = self._encode(job.bare())
        path, count = folder / "strokes.bits", len(job.strokes)
        write_bytes(path, coded.data)
        bits = 8 * len(coded.data) / max(1, count)
        about = path.name, len(coded.data), bits, psnr_of(max(coded.loss, SAME))
        log.info("%s: %d bytes, %.1f bits per stroke, %.2f dB against the exported painting", *about)
        return [path]

    def _encode(self, job: ExportJob) -> Coded:
        if self.size is None:
            return code(job, allowed=10 ** (-self.fidelity / 10), steps=self.steps)
        option = f"{self.key}.size"
        return code_within(job, size=size_from(self.size, option), steps=self.steps, option=option)
