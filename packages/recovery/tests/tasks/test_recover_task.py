"""Test that task=recover writes a catalogue, pictures, a table and a page of a photograph's strokes."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest
from brushexp_recovery.find.photograph import size_of_photograph
from brushexp_recovery.recover.storage import read_recovered
from brushexp_recovery.tasks import recover
from PIL import Image
from recovery_scenes import bars

from brushexp.errors import UserError


def test_a_photograph_becomes_a_catalogue_with_a_page(run_task, tmp_path, caplog):
    Image.fromarray(bars().image).save(tmp_path / "bars.png")
    result = run_task(recover, "task=recover", f"image={tmp_path / 'bars.png'}", "scale=1", "width_cm=12.8")
    found = read_recovered(tmp_path / "catalogue.h5")
    assert result["n_strokes"] == len(found.confidence) > 0
    assert result["covered"] == (found.labels >= 0).mean()
    names = {path.name for path in tmp_path.iterdir()}
    assert names >= {"strokes.csv", "strokes.html", "painting.png", "regions.png", "target.png", "metrics.json"}
    assert json.loads((tmp_path / "metrics.json").read_text())["status"] == "completed"
    graph = ElementTree.parse(tmp_path / "order.graphml").getroot()
    name = "{http://graphml.graphdrawing.org/xmlns}"
    assert len(graph.findall(f".//{name}node")) == len(found.confidence)
    edges = graph.findall(f".//{name}edge")
    assert len(edges) == len(found.meetings) > 0
    assert all(0.5 <= float(edge.findtext(f"{name}data")) <= 1 for edge in edges)
    surest = int(np.abs(found.chance_above - 0.5).argmax())
    lower, upper = found.meetings[surest][:: 1 if found.chance_above[surest] > 0.5 else -1]
    assert lower < upper, "rows are bottom to top, and no evidence contradicts the most certain pair"
    assert (edges[surest].get("source"), edges[surest].get("target")) == (str(lower), str(upper))
    assert "length [mm]" in (tmp_path / "strokes.csv").read_text()


def test_a_photograph_of_more_than_100_megapixels_is_refused_with_advice_that_can_be_followed(tmp_path):
    Image.new("1", (12000, 9000)).save(tmp_path / "huge.png")
    with pytest.raises(UserError, match="in at most 100 megapixels; save it at 11547 x 8660 pixels") as refusal:
        size_of_photograph(str(tmp_path / "huge.png"))
    assert "resolution=" not in str(refusal.value)
    Image.new("1", (12000, 8000)).save(tmp_path / "large.png")
    assert size_of_photograph(str(tmp_path / "large.png")) == (8000, 12000)
