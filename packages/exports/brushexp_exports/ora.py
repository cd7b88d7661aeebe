"""Export the painting as layers (OpenRaster 0.0.6) for Krita, GIMP, MyPaint and other programs."""

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Annotated
from xml.sax.saxutils import quoteattr
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np
from PIL import Image

from brushexp.contracts import between, register
from brushexp.contracts.families import ExportJob
from brushexp.contracts.files import replacing
from brushexp.contracts.members import PrintExporter
from brushexp_exports.layers import Layer, layers_of

THUMBNAIL = 256  # maximum longer side in pixels
LAYER = (
    '  <layer name={} src="data/{}.png" x="0" y="0" opacity="1.0" composite-op="svg:src-over" visibility="visible"/>\n'
)


@register("to", "ora")
@dataclass(kw_only=True)
class OpenRaster(PrintExporter):
    """Writes ``painting.ora``: the ground, layers of strokes from bottom to top, light and paper.

    Together, the layers show the painting to within two 8-bit levels, and each layer can be edited or hidden. The top
    layer, ``light and paper``, contains the effects that strokes alone cannot show: light, paper, and paint that is not
    mixed in RGB (``color=``). With ``background=transparent``, all layers are transparent where the picture is
    transparent. The whole painting is held in memory.

    Args:
        layers: number of stroke layers, with equal numbers of strokes.
    """

    layers: Annotated[int, between(1, 64)] = 5

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        job = self.scale_to_paper(job)
        finished, layers = layers_of(job, self.layers)
        with replacing(folder / "painting.ora") as temporary, ZipFile(temporary, "w") as archive:
            _add(archive, "mimetype", b"image/openraster", ZIP_STORED)
            _add(archive, "stack.xml", self._stack(job, layers).encode())
            for number, layer in enumerate(layers):
                _add(archive, f"data/{number}.png", png_of(layer.pixels))
            _add(archive, "mergedimage.png", png_of(finished))
            small = Image.fromarray(finished)
            small.thumbnail((THUMBNAIL, THUMBNAIL))
            _add(archive, "Thumbnails/thumbnail.png", png_of(np.asarray(small)))
        return [folder / "painting.ora"]

    def _stack(self, job: ExportJob, layers: list[Layer]) -> str:
        """Format the list of layers, top to bottom, as the XML that OpenRaster requires."""
        height, width = job.size
        dots = f' xres="{self.density:.0f}" yres="{self.density:.0f}"' if self.density else ""
        rows = [LAYER.format(quoteattr(layer.name), number) for number, layer in enumerate(layers)]
        head = f'<?xml version="1.0" encoding="UTF-8"?>\n<image version="0.0.6" w="{width}" h="{height}"{dots}>\n'
        return f"{head} <stack>\n{''.join(reversed(rows))} </stack>\n</image>\n"


def png_of(pixels: np.ndarray) -> bytes:
    """Encode pixels as a PNG."""
    Image.fromarray(pixels).save(file := BytesIO(), "PNG")
    return file.getvalue()


def _add(archive: ZipFile, name: str, data: bytes, packing: int = ZIP_DEFLATED) -> None:
    """Add a file without a timestamp, so that equal paintings result in equal archives."""
    archive.writestr(ZipInfo(name), data, packing)
