"""Write the catalogue as JSON text."""

from pathlib import Path

from brushexp.errors import UserError
from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp.strokes.catalogue import check_strokes
from brushexp.strokes.saved import json_lines
from brushexp.system.files import write_text


@register("to", "json")
class Json(Exporter):
    """Writes ``strokes.json``: the whole catalogue as editable text, which can be loaded with catalogue=strokes.json.

    It contains exactly the data in ``catalogue.h5``, in the units stated in the file, with one stroke per line.
    ``depth`` is a stroke's rank, 0 at the bottom; if no stroke has a ``depth``, the first stroke is at the bottom.
    """

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        path = folder / "strokes.json"
        try:
            check_strokes(job.strokes)
        except UserError as error:
            raise UserError(f"to=json cannot store this size ({error}); choose another resolution") from error
        write_text(path, json_lines(job.saved))
        return [path]
