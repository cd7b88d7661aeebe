"""Exporter plugin in a single file: ``to=palette``."""

from pathlib import Path

import torch

from brushexp.contracts import register
from brushexp.contracts.families import Exporter, ExportJob
from brushexp.contracts.files import write_text


@register("to", "palette")
class Palette(Exporter):
    """Writes ``palette.txt``: the strokes' colours, rounded to 16 levels per channel, the most frequent first."""

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        steps = (15 * job.strokes.color.detach().cpu().clamp(0, 1)).round().int()
        colors, counts = torch.unique(steps, dim=0, return_counts=True)
        order = counts.argsort(descending=True, stable=True)
        lines = ("#{:x}{:x}{:x} {}\n".format(*colors[k].tolist(), int(counts[k])) for k in order)
        write_text(folder / "palette.txt", "".join(lines))
        return [folder / "palette.txt"]
