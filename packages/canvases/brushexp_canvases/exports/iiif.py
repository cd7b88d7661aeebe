"""Write the painting as museums' viewers read it, by IIIF, as files that need no image server."""

from dataclasses import dataclass
from pathlib import Path

from brushexp.contracts import register
from brushexp.contracts.families import Exporter, ExportJob
from brushexp_canvases.levels import archive, levels_of
from brushexp_canvases.pyramid import BASE, write_iiif


@register("to", "iiif")
@dataclass(kw_only=True)
class Iiif(Exporter):
    """``iiif.zip``: ``manifest.json`` (Presentation API 3) and tiles (Image API 3, level 0), at any ``resolution``.

    Args:
        base: address at which what is in it will be served; documents of IIIF name each other by it.
    """

    base: str = BASE

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        with archive(path := folder / "iiif.zip") as into, levels_of(job) as levels:
            write_iiif(into, levels, Path(job.source).name or "painting", self.base)
        return [path]
