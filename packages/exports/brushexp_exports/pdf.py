"""Export the painting as a PDF page for print (ISO 32000-1) that contains only the picture."""

import logging
from dataclasses import dataclass
from pathlib import Path

from brushexp.contracts import register
from brushexp.contracts.families import ExportJob
from brushexp.contracts.files import replacing
from brushexp.contracts.members import CM, DPI, Compression, Sheet, SheetExporter

log = logging.getLogger(__name__)
POINTS = 72  # points in an inch
PREDICTOR = 12  # PDF's code for rows with the PNG filter "up"


@register("to", "pdf")
@dataclass(kw_only=True)
class Pdf(SheetExporter):
    """Writes ``painting.pdf``: one page with the lossless picture at a given size, ``to.pdf.size_cm=60x40``.

    The page's trim box excludes the bleed, if any. As with PNG export, the picture is painted and compressed in bands.

    Args:
        compression: compression level, 1 (fast) to 9 (small).
    """

    compression: Compression = 6

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        sheet = self.sheet(job)
        path, (height, width) = folder / "painting.pdf", sheet.size
        self._say_size(sheet)
        points = POINTS / (self.density or DPI)
        across, up = (f"{points * side:.4f}" for side in (width, height))
        content = f"{across} 0 0 {up} 0 0 cm /Picture Do".encode()
        image = f"/Type /XObject /Subtype /Image /Width {width} /Height {height} /ColorSpace /DeviceRGB"
        image += " /BitsPerComponent 8 /Interpolate false /Length 6 0 R /Filter /FlateDecode /DecodeParms"
        image += f" << /Predictor {PREDICTOR} /Colors 3 /BitsPerComponent 8 /Columns {width} >>"
        page = f"/Type /Page /Parent 2 0 R /MediaBox [0 0 {across} {up}] /Contents 4 0 R"
        page += " /Resources << /XObject << /Picture 5 0 R >> >>"
        if sheet.bleed:
            trim = (sheet.bleed, sheet.bleed, width - sheet.bleed, height - sheet.bleed)
            page += f" /BleedBox [0 0 {across} {up}] /TrimBox [{' '.join(f'{points * side:.4f}' for side in trim)}]"
        objects = ["/Type /Catalog /Pages 2 0 R", "/Type /Pages /Kids [3 0 R] /Count 1", page]
        with replacing(path) as temporary, temporary.open("wb") as file:
            file.write(b"%PDF-1.5\n%\xe2\xe3\xcf\xd3\n")
            places = []
            for number, text in enumerate([*objects, f"/Length {len(content)}", image], start=1):
                places.append(file.tell())
                file.write(f"{number} 0 obj\n<< {text} >>\n".encode())
                if number == 4:
                    file.write(b"stream\n" + content + b"\nendstream\n")
                if number == 5:
                    file.write(b"stream\n")
                    length = sum(file.write(piece) for piece in self.pack_rows(self.rows(sheet), self.compression))
                    file.write(b"\nendstream\n")
                file.write(b"endobj\n")
            places.append(file.tell())
            file.write(f"6 0 obj\n{length}\nendobj\n".encode())
            table = "".join(f"{place:010d} 00000 n \n" for place in places)
            end = f"xref\n0 7\n0000000000 65535 f \n{table}trailer\n<< /Size 7 /Root 1 0 R >>\n"
            start = file.tell()
            file.write(f"{end}startxref\n{start}\n%%EOF\n".encode())
        return [path]

    def _say_size(self, sheet: Sheet) -> None:
        """Log the printed size and, if it is determined by the number of pixels, how to choose another size."""
        dpi = self.density or DPI
        height, width = (CM * (side - 2 * sheet.bleed) / dpi for side in sheet.size)
        bleed = f", plus {self.bleed:g} mm of bleed" if sheet.bleed else ""
        cure = "" if self.size_cm else f"; {self.key}.size_cm=60x40 paints it larger"
        log.info("painting.pdf: %.1f x %.1f cm at %g dpi%s%s", width, height, dpi, bleed, cure)
