"""Test that strokes are exported as polygons for maps (GeoJSON) and as picture annotations (IIIF)."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest
import torch
from brushexp_exports.annotations import Annotations
from brushexp_exports.geojson import GeoJson
from brushexp_exports.stroke_outlines import outline_lines
from skimage.draw import polygon2mask

from brushexp.contracts import UserError, build_named
from brushexp.contracts.families import ExportJob
from brushexp.contracts.strokes import Saved, strokes_along

SIZE = (60, 80)


def job_of(*ends: tuple[tuple[float, float], tuple[float, float]], width: float = 6.0) -> ExportJob:
    """Make a painting of straight red strokes, with the first stroke of the catalogue on top."""
    curve = torch.tensor([[a, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2], b] for a, b in ends]).reshape(-1, 3, 2)
    count = len(curve)
    color = torch.tensor([[1.0, 0, 0]]).expand(count, 3)
    strokes = strokes_along(curve.float(), torch.full((count,), width), color, 0.5)
    depth = torch.arange(count - 1, -1, -1, dtype=torch.int32)
    parts = [build_named(*part, {}) for part in (("renderer", "analytic"), ("blend", "tiled"), ("color", "rgb"))]
    return ExportJob(Saved(strokes, depth, SIZE, torch.ones(3), "analytic"), *parts, source="a/x.png")


def test_an_outline_lies_half_a_width_around_the_curve():
    curve = np.array([[[20.0, 40], [40, 0], [60, 40]], [[30.3, 30.2]] * 3])
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    t = np.linspace(0, 1, 400)[:, None]
    for outline, points in zip(outline_lines(torch.from_numpy(curve), np.array([8.0, 10])), curve, strict=True):
        places = (1 - t) ** 2 * points[0] + 2 * t * (1 - t) * points[1] + t**2 * points[2]
        distance = np.sqrt(((np.stack([x, y], -1)[:, :, None] - places) ** 2).sum(-1)).min(2)
        mask = distance <= (4 if len(np.unique(points)) > 2 else 5)
        drawn = polygon2mask(SIZE, outline[:, ::-1])
        assert (drawn ^ mask).sum() < 0.07 * mask.sum()


def test_maps_have_polygons_in_millimetres_with_y_upwards(tmp_path):
    job = job_of(((20, 10), (60, 10)), ((20, 50), (20, 30)))
    (path,) = GeoJson(width_cm=8).write(job, tmp_path)  # a pixel is a millimetre
    data = json.loads(path.read_text())
    assert (data["unit"], data["name"]) == ("mm", "x.png")
    bottom, top = data["features"]
    assert [one["properties"]["stroke"] for one in (bottom, top)] == [1, 0]
    assert top["properties"]["length"] == pytest.approx(46, abs=0.01)
    assert top["properties"]["direction"] == pytest.approx(0, abs=0.01)
    assert bottom["properties"]["direction"] == pytest.approx(90, abs=0.01)
    ring = np.array(top["geometry"]["coordinates"][0])
    assert (ring[0] == ring[-1]).all()
    assert ring.min(0) == pytest.approx([17, 47], abs=0.1)
    assert ring.max(0) == pytest.approx([63, 53], abs=0.1)
    x, y = ring.T
    assert (x[:-1] * y[1:] - x[1:] * y[:-1]).sum() > 0, "the outer ring is counterclockwise"


def test_annotations_are_outlines_on_the_canvas(tmp_path):
    canvas = "https://museum.example/canvas/1"
    (path,) = Annotations(canvas=canvas).write(job_of(((20, 10), (60, 10))), tmp_path)
    page = json.loads(path.read_text())
    assert page["type"] == "AnnotationPage"
    assert page["@context"].startswith("http://iiif.io/api/presentation/3")
    (one,) = page["items"]
    assert one["target"]["source"] == canvas
    assert "length 46.0 px, width 6.0 px, direction 0°" in one["body"]["value"]
    svg = ElementTree.fromstring(one["target"]["selector"]["value"])
    assert svg.get("viewBox") == "0 0 80 60"
    assert svg[0].get("d").startswith("M")
    with pytest.raises(UserError, match="give the address of the canvas"):
        Annotations(canvas="").check(1, SIZE)


@pytest.mark.parametrize("exporter", [GeoJson(), Annotations()])
def test_a_painting_without_strokes_is_written_too(exporter, tmp_path):
    (path,) = exporter.write(job_of(), tmp_path)
    data = json.loads(path.read_text())
    assert data.get("features", data.get("items")) == []
