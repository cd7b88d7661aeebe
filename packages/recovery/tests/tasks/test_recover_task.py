"""task=recover writes a catalogue, pictures, a table and a page of the strokes of a photograph."""

import json

from brushexp_recovery.recover.storage import read_recovered
from brushexp_recovery.tasks import recover
from PIL import Image
from recovery_scenes import bars


def test_a_photograph_becomes_a_catalogue_with_a_page(run_task, tmp_path, caplog):
    Image.fromarray(bars().image).save(tmp_path / "bars.png")
    result = run_task(recover, "task=recover", f"image={tmp_path / 'bars.png'}", "scale=1", "width_cm=12.8")
    found = read_recovered(tmp_path / "catalogue.h5")
    assert result["n_strokes"] == len(found.confidence) > 0
    assert result["covered"] == (found.labels >= 0).mean()
    names = {path.name for path in tmp_path.iterdir()}
    assert names >= {"strokes.csv", "strokes.html", "painting.png", "regions.png", "target.png", "metrics.json"}
    assert json.loads((tmp_path / "metrics.json").read_text())["status"] == "completed"
    assert "length [mm]" in (tmp_path / "strokes.csv").read_text()
