"""Write the painting as museums' viewers read it, by IIIF, as files that need no image server."""

from dataclasses import dataclass
from pathlib import Path

from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp_canvases.levels import levels_of
from brushexp_canvases.pyramid import BASE, write_iiif


@register("to", "iiif")
@dataclass(kw_only=True)
class Iiif(Exporter):
    """``manifest.json`` (Presentation API 3) and tiles (Image API 3, level 0), crisp at any ``resolution``.

    Args:
        base: address at which the folder will be served; documents of IIIF name each other by it.
    """

    base: str = BASE

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        with levels_of(job) as levels:
            title = Path(job.source).name or "painting"
            return [write_iiif(folder, {"painting": levels}, title, self.base)]
