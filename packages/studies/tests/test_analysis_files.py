"""Test that an analysis writes readable tables and all figures, and marks sizes that a setting has fixed."""

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from brushexp_studies.analysis import figures, summary
from brushexp_studies.analysis import task as analyse
from brushexp_studies.analysis.summary import analysis_of, summary_of
from brushexp_studies.analysis.summary_text import strokes_csv, three_digits, write_summary
from PIL import Image
from refusals import refuses
from scenes import straight
from test_analysis import analysis_of_random, combed, painting, saved

from brushexp.reporting.tables import escape_markdown
from brushexp.results.stroke_table import (
    MEASURES,
)
from brushexp.strokes.storage import load_catalogue, save_catalogue


def test_the_table_can_be_read_back_and_what_is_not_defined_is_empty_null_or_a_dash(tmp_path):
    one = analysis_of_random()
    rows = list(csv.DictReader(io.StringIO(strokes_csv(one))))
    assert len(rows) == 60
    assert [int(row["stroke"]) for row in rows] == one.number.tolist()
    assert [float(row["length [px]"]) for row in rows] == pytest.approx(one.measures.length.tolist(), rel=1e-5)
    angles = [float(row["orientation [deg]"]) for row in rows]
    assert angles == pytest.approx(np.degrees(one.measures.orientation), rel=1e-5)
    assert {"area [px^2]", "curvature [deg]", "visible", "x [px]"} <= rows[0].keys()
    numbers = summary_of(one)["measures"]
    for key, power in (("length", 1), ("area", 2)):
        assert numbers[key]["in_pitches"]["median"] == pytest.approx(numbers[key]["median"] / one.pitch**power)
    assert "in_pitches" not in numbers["straightness"]
    write_summary(tmp_path, [analysis_of(saved(straight((20, 20), (40, 30))), "single", "single.h5")])
    (row,) = csv.DictReader(io.StringIO((tmp_path / "brushwork.csv").read_text()))
    assert row["coherence"] == ""
    assert json.loads((tmp_path / "summary.json").read_text())["measures"]["coherence"]["mean"] is None
    text = (tmp_path / "summary.md").read_text()
    assert "–" in text
    assert "nan" not in text.replace("hidden", "").replace("means", "")
    assert three_digits(12345.6) == "12,346"


PAINTED = "painter: {_target_: brushexp.plugins.painter.gradient.GradientDescent}\n"
INIT = "init: {_target_: brushexp.plugins.init.grid.Grid}\n"


@pytest.mark.parametrize(("config", "setter"), [
    ("seed: 0\n", ""), (INIT, "init=grid"), (PAINTED + INIT, "init=grid"),
    (PAINTED + INIT + "catalogue: a.h5\n", "catalogue=a.h5"),
    (PAINTED + INIT + "style: {brushwork: b.h5}\n", "style.brushwork=b.h5"),
    ("painter: {_target_: brushexp_painters.hertzmann.Hertzmann}\n" + INIT, "painter=hertzmann"), ("[", ""),
])  # fmt: skip
def test_sizes_that_a_setting_gave_are_marked_as_such_everywhere(config, setter, tmp_path):
    one = analysis_of(replace(painting(), config=config), "a", "a.h5")
    assert one.sizes_by == setter
    write_summary(tmp_path, [one])
    data = json.loads((tmp_path / "summary.json").read_text())
    assert data["sizes_set_by"] == (setter or None)
    (row, *_) = csv.DictReader(io.StringIO((tmp_path / "brushwork.csv").read_text()))
    assert row["sizes_set_by"] == setter
    for key, measure in MEASURES.items():
        is_marked = bool(setter) and key in ("length", "width", "area", "elongatedness")
        assert ("set_by" in data["measures"][key]) == is_marked
        name = f"{measure.name} (set by {setter})" if is_marked else measure.name
        assert f"| {escape_markdown(name)} |" in (tmp_path / "summary.md").read_text()


@pytest.mark.parametrize("rows", [
    lambda: [analysis_of_random(name="a $ b"), analysis_of_random(30, 1, "名", size=(90, 40))],
    lambda: [analysis_of(saved(straight((20, 20), (20, 20))), "dot", "dot")],
    lambda: [analysis_of(saved(combed(20)), "no neighbours", "combed", radius=0.0), analysis_of_random(size=(300, 2))],
])  # fmt: skip
def test_the_sheet_can_be_drawn(rows, tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "PRINT_DPI", 40)
    monkeypatch.setattr(figures, "STROKES_SIDE", 200)
    with Image.open(figures.write_figure(tmp_path / "brushwork.png", rows())) as sheet:
        assert sheet.width == 560
        assert np.asarray(sheet).std() > 5


def test_the_map_of_coherence_says_nothing_where_no_strokes_are():
    strokes = combed(100)
    strokes = replace(strokes, position=strokes.position * torch.tensor([0.3, 1.0]))
    one = analysis_of(saved(replace(strokes, opacity=torch.ones(100))), "a", "a", radius=9)
    points, mean = figures.coherence_map(one, 30)
    assert points.shape == (20, 30, 2)
    assert np.hypot(*mean[10, 3]) == pytest.approx(1)
    assert np.isnan(mean[10, 29]).all()


def test_the_task_writes_all_files_and_names_a_missing_one(run_task, tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "PRINT_DPI", 40)
    monkeypatch.setattr(figures, "STROKES_SIDE", 200)
    for name, seed in (("a", 0), ("b", 1)):
        (tmp_path / name).mkdir()
        save_catalogue(tmp_path / name / "catalogue.h5", painting(40, seed))
    paths = [str(tmp_path / name / "catalogue.h5") for name in "ab"]
    result = run_task(analyse, "task=analyse", f"catalogue={paths[0]}", f"against={paths[1]}", "radius=20")
    assert (result["status"], result["n_strokes"]) == ("completed", 40)
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} == {
        "brushwork.csv", "brushwork_against.csv", "summary.json", "summary.md", "brushwork.png", "metrics.json",
    }  # fmt: skip
    with Image.open(tmp_path / "brushwork.png") as sheet:
        assert sheet.width == 560
    numbers = json.loads((tmp_path / "summary.json").read_text())
    assert numbers["catalogue"] == paths[0]
    assert (numbers["name"], numbers["against"]["name"], numbers["radius"]) == ("a", "b", 20)
    one = analysis_of(load_catalogue(Path(paths[0])), "a", "a", radius=20)
    assert numbers["measures"]["length"]["mean"] == pytest.approx(summary.statistics_of(one.values("length"))["mean"])
    words = r"there is no file nowhere.h5; .* against="
    refuses(words, run_task, analyse, "task=analyse", f"catalogue={paths[0]}", "against=nowhere.h5")
    for paths, names in (
        ("/x/sky/catalogue.h5 /y/sea.h5", ["sky", "sea"]),
        ("/x/a/catalogue.h5 /y/a/catalogue.h5", ["x/a", "y/a"]),
        ("/x/a.h5 /x/a.h5", ["a (1)", "a (2)"]),
    ):
        assert analyse.names_of(paths.split()) == names
