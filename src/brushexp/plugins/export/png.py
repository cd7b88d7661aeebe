"""Write the painting as a picture of any size."""

import struct
from dataclasses import dataclass
from pathlib import Path

from brushexp.pictures.credits import chunks_about, credits_of
from brushexp.plugins.export._prints import CM, RGB, RGBA, SIGNATURE, Compression, SheetExporter, chunk, header
from brushexp.plugins.export.base import ExportJob
from brushexp.registry import register
from brushexp.system.files import replacing


@register("to", "png")
@dataclass(kw_only=True)
class Png(SheetExporter):
    """Writes ``painting.png``, sharp at any ``resolution``, because strokes rather than pixels are scaled.

    It is painted and compressed in bands, so memory does not grow with the picture. For print, set
    ``to.png.size_cm=60x40``.

    Args:
        compression: compression level, 1 (fast) to 9 (small).
    """

    compression: Compression = 6

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        sheet = self.sheet(job)
        path, (height, width) = folder / "painting.png", sheet.size
        # Pillow needs the whole picture in memory, at four bytes per pixel.
        with replacing(path) as temporary, temporary.open("wb") as file:
            file.write(SIGNATURE + header(width, height, RGB if job.saved.alpha is None else RGBA))
            file.writelines(chunk(*one) for one in chunks_about(credits_of(job.source)))
            if self.density:
                metre = round(100 * self.density / CM)
                file.write(chunk(b"pHYs", struct.pack(">IIB", metre, metre, 1)))  # unit 1: per metre
            file.writelines(
                chunk(b"IDAT", piece)
                for piece in self.pack_rows(self.rows(sheet, transparent=True), self.compression)
                if piece
            )
            file.write(chunk(b"IEND", b""))
        return [path]
