"""Write the painting as a Deep Zoom image, with a page that shows it."""

from dataclasses import dataclass
from pathlib import Path

from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp_canvases.levels import levels_of
from brushexp_canvases.pyramid import write_dzi


@register("to", "dzi")
@dataclass(kw_only=True)
class DeepZoom(Exporter):
    """``painting.dzi`` and its tiles, which viewers on web pages read, and ``view.html``, which shows them from disk.

    ``resolution=`` makes it larger than it was painted: strokes are scaled, not pixels, and painted in bands.
    """

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        from brushexp_canvases.page import write_page  # noqa: PLC0415  (templates are slow to import)

        with levels_of(job) as levels:
            write_dzi(folder, "painting", levels)
        height, width = job.size
        lead = f"{len(job.strokes):,} strokes on {width:,} × {height:,} pixels"
        page = write_page(folder, job.size, ["painting"], Path(job.source).name or "painting", lead)
        return [page, folder / "painting.dzi"]
