"""The catalogue as text."""

from pathlib import Path

import torch

from brushexp.errors import UserError
from brushexp.plugins.export.base import Exporter, Work
from brushexp.registry import register
from brushexp.strokes.catalogue import check_strokes
from brushexp.strokes.text import json_lines
from brushexp.system.files import replacing


@register("to", "json")
class Json(Exporter):
    """``strokes.json``: the whole catalogue as text, one stroke a line, to edit and give back: catalogue=strokes.json.

    It holds what ``catalogue.h5`` holds, to the last bit, in the units that it names. Strokes are numbered by their
    lines; ``depth`` ranks them, 0 is the bottom one, or is left out of all of them: then the first is the bottom one.
    """

    def __init__(self) -> None: ...

    def write(self, work: Work, folder: Path) -> list[Path]:
        path = folder / "strokes.json"
        attributes = {
            "height": work.size[0],
            "width": work.size[1],
            "renderer": work.name,
            "renderer_hash": work.renderer.weights_hash,
            "seed": work.seed,
        }
        strokes = work.strokes.map(lambda value: value.detach().to("cpu", torch.float32))
        try:
            check_strokes(strokes)
        except UserError as error:
            raise UserError(f"to=json cannot hold this size ({error}); choose another resolution") from error
        text = json_lines(strokes, work.depth, work.background.float(), work.config, attributes)
        with (
            replacing(path) as temporary,
            temporary.open("w", encoding="utf-8", errors="backslashreplace", newline="\n") as file,
        ):
            file.writelines(text)
        return [path]
