"""Test that task=measure measures a photograph, compares it with another, and can use strokes recovered earlier."""

import csv
import json
from functools import partial

import numpy as np
import pytest
from brushexp_recovery.benchmark.prediction_files import read_prediction
from brushexp_recovery.benchmark.score import score
from brushexp_recovery.benchmark.truth import Truth, draw_truth
from brushexp_recovery.measure.figure_tables import format_number
from brushexp_recovery.measure.measures import MEASURES
from brushexp_recovery.recover.storage import read_recovered, write_recovered
from brushexp_recovery.tasks import measure
from PIL import Image
from recovery_scenes import recover_dark, straight

from brushexp.cli.program import expand_arguments
from brushexp.errors import UserError

SIZE = (60, 80)
recover = partial(recover_dark, confidence=0.8)


def painting(width: float) -> tuple[Truth, np.ndarray]:
    """Draw three dark horizontal strokes on a white ground."""
    curve = straight(*(((20, y), (60, y)) for y in (10, 30, 50)))
    return draw_truth(curve, np.full(3, width), np.zeros((3, 3)), SIZE, np.ones(3))


@pytest.fixture
def photographs(tmp_path, monkeypatch):
    monkeypatch.setattr(measure, "recover_picture", lambda image, show: recover(image))
    for name, width in (("a", 6), ("b", 12)):
        _, image = painting(width)
        Image.fromarray((255 * image).round().astype(np.uint8)).save(tmp_path / f"{name}.png")
    return tmp_path


def test_a_photograph_is_measured_compared_and_shown(photographs, run_task):
    run = partial(
        run_task, measure, "task=measure", f"image={photographs / 'a.png'}", "views=3", "draws=5", "correct=false"
    )
    beside = f"against={photographs / 'b.png'}", "against_size_cm=8x6"
    result = run("width_cm=8", *beside, "region=['0,0,80,20']")
    assert result["n_strokes"] == 3
    assert result["measured_width"] == pytest.approx(6, rel=0.1)  # a pixel is a millimetre
    data = json.loads((photographs / "measures.json").read_text())
    assert set(data["measures"]) == {"whole", "0,0,80,20"}
    assert data["measures"]["whole"]["length"]["unit"] == "mm"
    assert data["differences"]["width"]["apart"]
    assert data["differences"]["width"]["value"] == pytest.approx(-6, abs=1)
    html = (photographs / "strokes.html").read_text()
    assert "a.png minus b.png" in html
    assert "Measures: 0,0,80,20" in html
    again = read_recovered(photographs / "catalogue.h5")
    assert (again.labels >= 0).mean() > 0.1
    with pytest.raises(UserError, match=r"size_cm=9x2 does not have the shape"):
        run("size_cm=9x2")
    with pytest.raises(UserError, match=r"against_width_cm is the size of a second photograph; give against="):
        run("against_width_cm=2")


def test_figures_and_differences_include_the_error_of_recovery(photographs, run_task):
    run = partial(run_task, measure, "task=measure", f"image={photographs / 'a.png'}", "views=2", "draws=5")
    figures = []
    for words in ([], ["correct=false"]):
        run(f"against={photographs / 'b.png'}", *words)
        figures.append(json.loads((photographs / "measures.json").read_text()))
    (corrected, found) = (data["measures"]["whole"] for data in figures)
    for name in ("length", "width", "strokes"):
        assert corrected[name]["found"] == found[name]["value"] == found[name]["found"]
        width = corrected[name]["high"] - corrected[name]["low"]
        assert width > 0.1 * corrected[name]["value"] + found[name]["high"] - found[name]["low"]
    low, high = (data["differences"]["width"]["high"] - data["differences"]["width"]["low"] for data in figures[::-1])
    assert high > low + 1
    rows = list(csv.DictReader((photographs / "measures.csv").read_text().splitlines()))
    assert {row["found"] for row in rows if row["measure"] == MEASURES["width"].name} == {
        format_number(found["width"]["value"])
    }


def test_widths_of_several_photographs_are_in_a_table(photographs, run_task):
    run = partial(run_task, measure, "task=measure", "views=1", "draws=2", f"sizes={photographs / 'sizes.csv'}")
    table = photographs / "sizes.csv"
    table.write_text("file,width_cm\nx/a.png,16\nb.png,wide\n")
    run(f"image={photographs / 'a.png'}")
    assert json.loads((photographs / "measures.json").read_text())["mm_per_px"] == 2
    with pytest.raises(UserError, match=r"has no width in centimetres for b.png; write b.png,92"):
        run(f"image={photographs / 'b.png'}")
    with pytest.raises(UserError, match=r"sizes=, width_cm= and size_cm= say the same"):
        run(f"image={photographs / 'a.png'}", "width_cm=3")
    table.write_text("file,width_cm\nb.png,3\n")
    with pytest.raises(UserError, match=r"has 0 rows for a.png; give one: a.png,92"):
        run(f"image={photographs / 'a.png'}")
    table.write_text("a.png,3\n")
    with pytest.raises(UserError, match=r"its first line is file,width_cm"):
        run(f"image={photographs / 'a.png'}")


def test_what_was_recovered_is_taken_as_it_is_and_scored_with_its_confidence(photographs, run_task):
    truth, image = painting(6)
    found, path = recover(image), photographs / "found.h5"
    write_recovered(path, found)
    run = partial(run_task, measure, "task=measure", f"recovered={path}", "views=1", "draws=2")
    assert run(f"image={photographs / 'a.png'}")["n_strokes"] == 3
    (photographs / "run").mkdir()
    write_recovered(photographs / "run" / "catalogue.h5", found)
    again = run(f"image={photographs / 'a.png'}", f"recovered={photographs / 'run'}")
    assert again["n_strokes"] == 3, "the folder of a run stands for its catalogue"
    Image.fromarray(np.zeros((50, 50, 3), np.uint8)).save(photographs / "other.png")
    with pytest.raises(UserError, match="belongs to a picture of 80 x 60 pixels"):
        run(f"image={photographs / 'other.png'}")
    figures = score(truth, read_prediction(path, SIZE, image))
    assert figures["f1"] == 1
    assert figures["reliability"] == [(pytest.approx(0.8), 1, 3)]


def test_a_picture_without_strokes_has_no_direction(tmp_path, run_task, monkeypatch, caplog):
    monkeypatch.setattr(measure, "recover_picture", lambda image, show: recover(image))
    Image.fromarray(np.full((60, 80, 3), 255, np.uint8)).save(tmp_path / "white.png")
    with caplog.at_level("INFO"):
        result = run_task(measure, "task=measure", f"image={tmp_path / 'white.png'}", "views=1", "draws=2")
    assert result["n_strokes"] == 0
    assert {"strokes 0, 90 % between 0 and 0", "direction none"} <= set(caplog.messages)


def test_strokes_are_not_sought_in_so_few_pixels(tmp_path, run_task):
    Image.fromarray(np.zeros((9, 90, 3), np.uint8)).save(tmp_path / "tiny.png")
    with pytest.raises(UserError, match=r"has 90 x 9 pixels, too few to tell strokes apart; give a photograph of 48"):
        run_task(measure, "task=measure", f"image={tmp_path / 'tiny.png'}")


def test_a_photograph_to_analyse_is_measured(photographs, monkeypatch):
    monkeypatch.chdir(photographs)
    assert expand_arguments(["analyse", "a.png", "width_cm=60"]) == ["task=measure", "image=a.png", "width_cm=60"]
    assert expand_arguments(["measure", "a.png"]) == ["task=measure", "image=a.png"]
    several = expand_arguments(["analyse", "a.png", "b.png"])
    assert {"task=measure", "--multirun"} <= set(several)
    (photographs / "strokes.h5").touch()
    assert expand_arguments(["analyse", "strokes.h5"]) == ["task=analyse", "catalogue=strokes.h5"]
    assert expand_arguments(["analyse", "c.png"]) == ["task=analyse", "catalogue=c.png"]
    assert expand_arguments(["export", "a.png"]) == ["task=export", "catalogue=a.png"]
