"""Write the strokes as a small file."""

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
    """``strokes.bits``: rounded strokes in a small file, to keep, send and give back: catalogue=strokes.bits.

    Numbers are rounded as coarsely as the picture allows, each by how much it shows, and coded; strokes that do not
    overlap may change places. What is read back is a painting of as many strokes, which looks as ``fidelity`` says, or
    as good as ``size`` bytes allow. Settings that draw it (renderer, colour space, paper, lamp) are in the file, others
    are not.

    Args:
        fidelity: PSNR of the decoded painting against the one that is exported, dB; more takes more bits.
        size: largest size of the file, which replaces ``fidelity``: 1500B, 20kB, 0.5MB; null = no limit.
        steps: number of gradient steps in which unrounded values compensate for rounded ones; 0 is quick.
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
        coded = self._coded(job.bare())
        path, count = folder / "strokes.bits", len(job.strokes)
        write_bytes(path, coded.data)
        bits = 8 * len(coded.data) / max(1, count)
        about = path.name, len(coded.data), bits, psnr_of(max(coded.loss, SAME))
        log.info("%s: %d bytes, %.1f bits a stroke, %.2f dB against the exported painting", *about)
        return [path]

    def _coded(self, job: ExportJob) -> Coded:
        if self.size is None:
            return code(job, allowed=10 ** (-self.fidelity / 10), steps=self.steps)
        option = f"{self.key}.size"
        return code_within(job, size=size_from(self.size, option), steps=self.steps, option=option)
