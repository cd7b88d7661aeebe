"""Write the painting as a Deep Zoom image with a viewer page."""

from dataclasses import dataclass
from pathlib import Path

from brushexp.contracts import register
from brushexp.contracts.families import Exporter, ExportJob
from brushexp_canvases.levels import archive, levels_of


@register("to", "dzi")
@dataclass(kw_only=True)
class DeepZoom(Exporter):
    """Writes ``dzi.zip``: ``painting.dzi`` with its tiles, for web pages, and ``view.html``, a viewer for local use.

    ``resolution=`` makes the image larger than the painting: strokes are scaled instead of pixels, and are drawn in
    bands.
    """

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        from brushexp_canvases.page import of_all, write_viewer  # noqa: PLC0415  (templates are slow to import)

        with archive(path := folder / "dzi.zip") as into, levels_of(job) as levels:
            write_viewer(into, levels, Path(job.source).name or "painting", len(job.strokes), of_all(job))
        return [path]
