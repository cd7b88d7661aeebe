"""Export strokes as polygons for geographic information systems (GeoJSON, RFC 7946, 2016)."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from brushexp.contracts import above, register
from brushexp.contracts.families import Exporter, ExportJob
from brushexp.contracts.files import write_text
from brushexp_exports.stroke_outlines import OutlinedStroke, outlined_strokes


@register("to", "geojson")
@dataclass(kw_only=True)
class GeoJson(Exporter):
    """Writes ``strokes.geojson``: strokes as polygons with measurements, bottom to top, for QGIS, R and GeoPandas.

    As on maps, coordinates start at the lower left corner, with x to the right and y upwards. They are in pixels, or in
    millimetres with ``width_cm``. Unlike in RFC 7946, they are positions on the canvas, not on the Earth. Each polygon
    has the properties ``stroke``, the number of the stroke in the catalogue; ``order``, which is 0 for the bottom
    stroke; ``length`` from tip to tip; ``width``; ``direction`` in degrees clockwise from horizontal; ``color``; and
    ``opacity``.

    Args:
        width_cm: width of the canvas in cm; null = coordinates in pixels.
    """

    width_cm: Annotated[float, above(0, 100_000, typical=60)] | None = None

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        path = folder / "strokes.geojson"
        write_text(path, self._lines(job))
        return [path]

    def _lines(self, job: ExportJob) -> Iterator[str]:
        height, width = job.size
        unit = 1.0 if self.width_cm is None else 10 * self.width_cm / width
        head = {"name": Path(job.source).name, "unit": "px" if self.width_cm is None else "mm"}
        yield '{"type": "FeatureCollection", ' + json.dumps(head)[1:-1] + ', "features": ['
        between = "\n"
        for stroke in outlined_strokes(job):
            yield between + json.dumps(feature_of(stroke, height, unit))
            between = ",\n"
        yield "\n]}\n"


def feature_of(stroke: OutlinedStroke, height: int, unit: float) -> dict[str, object]:
    """Make the feature for a stroke on a canvas ``height`` pixels high; ``unit`` is the size of a pixel."""
    ring = [[round(unit * x, 3), round(unit * (height - y), 3)] for x, y in stroke.outline.tolist()]
    return {
        "type": "Feature",
        "id": stroke.number,
        "properties": {
            "stroke": stroke.number,
            "order": stroke.order,
            "length": round(unit * stroke.length, 3),
            "width": round(unit * stroke.width, 3),
            "direction": round(stroke.direction, 2),
            "color": stroke.color,
            "opacity": round(stroke.opacity, 4),
        },
        "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]},
    }
