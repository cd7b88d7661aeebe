"""Write the painting as an OME-Zarr image."""

from dataclasses import dataclass
from pathlib import Path

from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp_canvases.levels import write_levels


@register("to", "zarr")
@dataclass(kw_only=True)
class Zarr(Exporter):
    """``painting.ome.zarr``: levels of halved size in chunks (OME-Zarr 0.5), crisp at any ``resolution``."""

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        write_levels(path := folder / "painting.ome.zarr", job)
        return [path / "zarr.json"]
