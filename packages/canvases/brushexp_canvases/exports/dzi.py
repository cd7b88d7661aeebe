"""Write the painting as a Deep Zoom image, with a page that shows it."""

from dataclasses import dataclass
from pathlib import Path

from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp_canvases.exports._archive import archive
from brushexp_canvases.levels import levels_of
from brushexp_canvases.pyramid import write_dzi


@register("to", "dzi")
@dataclass(kw_only=True)
class DeepZoom(Exporter):
    """``dzi.zip``: ``painting.dzi`` with its tiles, for web pages, and ``view.html``, which shows them from disk.

    ``resolution=`` makes it larger than it was painted: strokes are scaled, not pixels, and painted in bands.
    """

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        from brushexp_canvases.page import write_page  # noqa: PLC0415  (templates are slow to import)
        from brushexp_canvases.page.strokes import of_all, write_strokes  # noqa: PLC0415

        height, width = job.size
        title, lead = (
            Path(job.source).name or "painting",
            f"{len(job.strokes):,} strokes on {width:,} × {height:,} pixels",
        )
        with archive(path := folder / "dzi.zip") as into, levels_of(job) as levels:
            for name, pictures in levels.items():
                write_dzi(into, name, pictures)
            strokes = write_strokes(into, job.size, of_all(job))
            write_page(into, job.size, list(levels), title, lead, strokes)
        return [path]
