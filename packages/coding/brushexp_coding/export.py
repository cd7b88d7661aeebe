"""Write the strokes as a small file."""

import logging
from pathlib import Path
from typing import Annotated

from brushexp.contracts import at_least, between, register
from brushexp.contracts.families import Exporter, ExportJob
from brushexp.contracts.files import write_bytes
from brushexp_coding.fitting import code

log = logging.getLogger(__name__)


@register("to", "bits")
class Bits(Exporter):
    """``strokes.bits``: rounded strokes in a small file, to keep, send and give back: catalogue=strokes.bits.

    Numbers are rounded as coarsely as the picture allows, each by how much it shows, and coded; strokes that do not
    overlap may change places. What is read back is a painting of as many strokes, which looks as ``fidelity`` says.
    Settings that draw it (renderer, colour space, paper, lamp) are in the file, others are not.

    Args:
        fidelity: PSNR of the decoded painting against the one that is exported, dB; more takes more bits.
        steps: number of gradient steps in which unrounded values compensate for rounded ones; 0 is quick.
    """

    def __init__(
        self, *, fidelity: Annotated[float, between(20, 70)] = 45.0, steps: Annotated[int, at_least(0)] = 60
    ) -> None:
        self.fidelity, self.steps = fidelity, steps

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        coded = code(job.bare(), allowed=10 ** (-self.fidelity / 10), steps=self.steps)
        path, count = folder / "strokes.bits", len(job.strokes)
        write_bytes(path, coded.data)
        log.info("%s: %d bytes, %.1f bits a stroke", path.name, len(coded.data), 8 * len(coded.data) / max(1, count))
        return [path]
