"""Write the catalogue as text."""

from pathlib import Path

from brushexp.errors import UserError
from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.registry import register
from brushexp.strokes.catalogue import check_strokes
from brushexp.strokes.saved import json_lines
from brushexp.system.files import write_text


@register("to", "json")
class Json(Exporter):
    """``strokes.json``: the whole catalogue as text, one stroke a line, to edit and give back: catalogue=strokes.json.

    It holds what ``catalogue.h5`` holds, to the last bit, in the units that it names. Strokes are numbered by their
    lines; ``depth`` ranks them, 0 is the bottom one, or is left out of all of them: then the first is the bottom one.
    """

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        path = folder / "strokes.json"
        try:
            check_strokes(job.strokes)
        except UserError as error:
            raise UserError(f"to=json cannot hold this size ({error}); choose another resolution") from error
        write_text(path, json_lines(job.saved))
        return [path]
