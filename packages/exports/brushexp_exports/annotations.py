"""Export strokes as annotations on a picture (W3C Web Annotation Data Model, 2017; IIIF Presentation 3)."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from brushexp.contracts import UserError, register
from brushexp.contracts.families import Exporter, ExportJob
from brushexp.contracts.files import write_text
from brushexp_exports.stroke_outlines import OutlinedStroke, outlined_strokes

CONTEXT = "http://iiif.io/api/presentation/3/context.json"


@register("to", "annotations")
@dataclass(kw_only=True)
class Annotations(Exporter):
    """Writes ``strokes.annotations.json``: each stroke as an annotation, for Mirador and other IIIF viewers.

    The file is an annotation page according to IIIF Presentation 3. The target of each annotation is an outline (SVG)
    on the canvas, in pixels of the export; the body states the stroke's length, width, direction and colour. Strokes
    are listed from bottom to top.

    Args:
        canvas: address of the annotated canvas in the manifest, or of the picture.
    """

    canvas: str = "painting.png"

    def check(self, count: int, size: tuple[int, int]) -> None:
        if not self.canvas:
            raise UserError("to.annotations.canvas is empty; give the address of the canvas in your manifest")

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        path = folder / "strokes.annotations.json"
        write_text(path, self._lines(job))
        return [path]

    def _lines(self, job: ExportJob) -> Iterator[str]:
        head = {"@context": CONTEXT, "id": f"{self.canvas}#strokes", "type": "AnnotationPage"}
        yield json.dumps(head)[:-1] + ', "items": ['
        between = "\n"
        for stroke in outlined_strokes(job):
            yield between + json.dumps(annotation_of(stroke, self.canvas, job.size))
            between = ",\n"
        yield "\n]}\n"


def annotation_of(stroke: OutlinedStroke, canvas: str, size: tuple[int, int]) -> dict[str, object]:
    """Make the annotation for a stroke on a canvas of ``size`` (H, W)."""
    height, width = size
    places = " ".join(f"{x:.1f},{y:.1f}" for x, y in stroke.outline.tolist())
    svg = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}">'
        f'<path d="M{places}Z" fill="none" stroke="{stroke.color}"/></svg>'
    )
    words = (
        f"Stroke {stroke.number}: length {stroke.length:.1f} px, width {stroke.width:.1f} px, "
        f"direction {stroke.direction:.0f}° clockwise from horizontal, colour {stroke.color}"
    )
    return {
        "id": f"{canvas}#stroke-{stroke.number}",
        "type": "Annotation",
        "motivation": "tagging",
        "body": {"type": "TextualBody", "value": words, "format": "text/plain", "language": "en"},
        "target": {
            "type": "SpecificResource",
            "source": canvas,
            "selector": {"type": "SvgSelector", "value": svg},
        },
    }
