"""Write the painting as static IIIF files, which museum viewers can read without an image server."""

from dataclasses import dataclass
from pathlib import Path

from brushexp.contracts import register
from brushexp.contracts.families import Exporter, ExportJob
from brushexp_canvases.levels import archive, levels_of
from brushexp_canvases.pyramid import BASE, write_iiif


@register("to", "iiif")
@dataclass(kw_only=True)
class Iiif(Exporter):
    """Writes ``iiif.zip``: ``manifest.json`` (Presentation API 3), and tiles (Image API 3, level 0) at any resolution.

    Args:
        base: address at which the files will be served; the links between the IIIF documents begin with it.
    """

    base: str = BASE

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        with archive(path := folder / "iiif.zip") as into, levels_of(job) as levels:
            write_iiif(into, levels, Path(job.source).name or "painting", self.base)
        return [path]
