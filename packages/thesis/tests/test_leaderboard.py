"""Test that the leaderboard averages over the same pictures for all painters.

It also lists other people's paintings, and keeps published figures apart from measured ones.
"""

import re

import numpy as np
import pytest
from browser import NARROW
from brushexp_thesis import leaderboard as task
from brushexp_thesis.leaderboard import write_leaderboard_page, write_standings_plot
from brushexp_thesis.published import read_published
from brushexp_thesis.standings import entries_of, sections_of
from brushexp_thesis.standings_tables import at_equal_seconds, by_picture, table_cells
from PIL import Image
from program import ended
from refusals import refuses
from scipy import stats
from sweeps import make_run, read_csv

from brushexp.results.runs import gather
from brushexp.system.files import write_picture, write_text
from brushexp.tasks import paint

PUBLISHED = """
sets:
  pair: {pictures: the pair, size: [30, 20], names: [a, b]}
  larger: {pictures: the pair enlarged, size: [60, 40], names: [a, b]}
  all: {pictures: all of them, size: [30, 20], names: [a, b, c]}
figures:
  - {set: pair, painter: Theirs, source: "Somebody, 2020, table 1", primitives: 9, what: blobs, psnr: 99}
  - {set: larger, painter: Theirs, source: "Somebody, 2020, table 2", psnr: 98}
  - {set: all, painter: Theirs, source: "Somebody, 2020, table 3", psnr: 97}
"""


def sections_in(folder, published=None):
    return sections_of(entries_of(gather([folder], folder)), read_published(published) if published else ())


def paint_run(folder, image, psnr, strokes, painter=None, **noted):
    """Write the files of a fake run; runs whose pictures have the same name share a target."""
    chosen = {"image": f"{image}.png", "strokes": str(strokes), "frames": str(ord(image))}
    numbers = {"psnr": psnr, "l1": 0.1, "seconds": 2.0, "cpu_seconds": 3.0, "n_strokes": strokes}
    numbers |= {"anytime": [[1, psnr - 4], [2, psnr]]} | ({"painter": painter} if painter else {})
    return make_run(folder, chosen | noted.pop("chosen", {}), target=ord(image), color=7, **(numbers | noted))


@pytest.fixture
def runs(tmp_path):
    """Write the runs of two painters, with 50 strokes on pictures a and b, and with 90 strokes on picture a.

    One of the painters has two seeds. Some runs are unfinished or invalid.
    """
    folder = tmp_path / "runs"
    folder.mkdir()
    write_text(tmp_path / "published.yaml", PUBLISHED)
    for image, psnr in (("a", 20.0), ("b", 30.0)):
        paint_run(folder, image, psnr, 50, chosen={"seed": "0"})
        paint_run(folder, image, psnr + 2, 50, chosen={"seed": "1"})
        paint_run(folder, image, psnr - 5 + (image == "a"), 50, "greedy", anytime=[[0.5, psnr - 9], [1, psnr - 4]])
    paint_run(folder, "a", 25.0, 90)
    paint_run(folder, "a", 24.0, 90, "greedy", chosen={"painter": "greedy_fast"})  # a preset
    make_run(folder, {"task": "train"}, psnr=1.0)
    spoilt = {"psnr": "much", "l1": 0.1, "seconds": 2.0}
    make_run(folder, {"image": "a.png", "strokes": "90", "painter": "zou"}, target=ord("a"), color=7, **spoilt)
    paint_run(folder, "a", 1.0, 50, status="failed")
    return folder


def test_means_are_of_the_same_pictures_and_differences_are_paired(runs, tmp_path):
    both, alone = sections_in(runs, tmp_path / "published.yaml")
    assert [len(section.pictures) for section in (both, alone)] == [2, 1]
    ours, greedy = both.rows
    assert (ours.painter, greedy.painter) == ("gradient", "greedy")
    assert ours.numbers["psnr"].tolist() == [21, 31]  # averaged over seeds first
    assert both.against_best(ours) is None
    mean, low, high = both.against_best(greedy)
    assert (mean, low, high) == pytest.approx((-5.5, *stats.t.interval(0.95, 1, loc=-5.5, scale=0.5)))
    names = [(row.painter, row.strokes) for row in alone.rows]
    assert names == [("gradient", 50), ("greedy", 50), ("gradient", 90), ("greedy_fast", 90)]
    assert [one.source[-1] for one in both.published] == ["1", "3"]  # figures for another size are left out
    assert ours.psnr_at(0.5) == []
    assert (ours.psnr_at(2), greedy.psnr_at(2)) == ([21, 31], [16, 26])  # finished paintings keep their value


def test_paintings_of_other_versions_are_told(runs, run_task, tmp_path, caplog):
    assert run_task(task, "task=leaderboard", f"runs={runs}")["paintings"]
    assert "These runs differ" not in caplog.text
    for version in ("2.8.0", "2.9.0"):
        paint_run(runs, "b", 21.0, 50, chosen={"seed": version}, provenance={"torch": version})
    run_task(task, "task=leaderboard", f"runs={runs}", "overwrite=true")
    remark = "These runs differ in PyTorch (2.8.0, 2.9.0)."
    assert remark in caplog.text
    for name in ("report.html", "leaderboard.md"):
        assert any(remark in path.read_text().replace("\\", "") for path in tmp_path.rglob(name)), name


def test_unknown_numbers_of_strokes_are_not_equal_ones(tmp_path):
    for painter, psnr in (("greedy", 20.0), ("zou", 25.0)):
        make_run(tmp_path, {"image": "a.png"}, target=9, color=7, psnr=psnr, l1=0.1, seconds=2.0, painter=painter)
    (section,) = sections_in(tmp_path)
    assert [(row.strokes, section.against_best(row)) for row in section.rows] == [(None, None), (None, None)]


def test_settings_that_all_have_are_left_out_and_those_with_spaces_stay_whole(tmp_path):
    for image, style, color in (("a", "my photo.jpg", "rgb"), ("a", "my photo.jpg", "oklab"), ("a", "her.jpg", "rgb")):
        paint_run(tmp_path, image, 20.0, 50, chosen={"style.image": style, "color": color})
    for color in ("rgb", "oklab"):
        paint_run(tmp_path, "b", 20.0, 50, chosen={"style.image": "my photo.jpg", "color": color})
    both, alone = sections_in(tmp_path)
    assert sorted(row.settings for row in both.rows) == ["color=oklab", "color=rgb"]
    settings = ("her.jpg color=rgb", "my photo.jpg color=oklab", "my photo.jpg color=rgb")
    assert {row.settings for row in alone.rows} == {f"style.image={one}" for one in settings}


def test_published_figures_stand_beside_and_say_what_they_are_of(runs, tmp_path):
    both, *_ = sections_in(runs, tmp_path / "published.yaml")
    cells = table_cells(both)
    assert [row["pictures"] for row in cells] == [
        "these", "these", "the same pictures at 30 x 20", "all of them (2 pictures here) at 30 x 20",
    ]  # fmt: skip
    assert cells[0]["PSNR, dB"] == f"26.00 ± {stats.t.interval(0.95, 1, scale=5)[1]:.2f}"
    assert cells[2] | {"PSNR, dB": "99", "strokes": "9 blobs", "optimisation, s": "–"} == cells[2]
    assert [row["psnr"] for row in by_picture(both) if row["picture"] == "a"] == ["21.00", "16.00"]
    assert [row["1 s"].split(" ± ")[0] for row in at_equal_seconds(both)] == ["22.00", "21.00"]


def test_the_page_fits_sorts_and_asks_nothing(runs, tmp_path, opened):
    sections = sections_in(runs, tmp_path / "published.yaml")
    with Image.open(write_standings_plot(runs, sections)) as picture:
        assert np.asarray(picture.convert("RGB")).std() > 1
    watched = opened(write_leaderboard_page(runs, sections, sections[0].published, "On <one> machine."), NARROW)
    assert not watched.is_too_wide()
    column = watched.page.locator("#section-1 table").first.locator("th", has_text="PSNR")
    column.get_by_role("button").click()
    names = "[...document.querySelector('#section-1 tbody').rows].map(row => row.cells[0].textContent)"
    assert watched.evaluate(names) == ["Theirs", "Theirs", "gradient", "greedy (after Fogleman)"]
    style = "getComputedStyle(document.querySelector('.published').cells[0]).fontStyle"
    assert watched.evaluate(style) == "italic"
    assert watched.page.get_by_text("On <one> machine.").is_visible()
    assert not watched.errors
    assert not watched.foreign


def test_what_ships_has_sources_and_is_refused_when_it_is_wrong(tmp_path):
    published = read_published()
    assert len({one.painter for one in published}) >= 8
    assert all(re.search(r"\d{4}|docs/|issue", one.source) and one.figures for one in published)
    for old, new, reason in (
        ("source:", "sauce:", "entry 1 of figures: sauce: Key 'sauce' not in .*; its keys are set, painter, source"),
        ("psnr: 99", "psnr: high", "entry 1 of figures: psnr: Value 'high'"),
        ("psnr: 99", "psnr: .nan", "entry 1 of figures has no figure, or one is not a number"),
        ("names: [", "names: [[1], ", r"sets has names with \[1\]"),
        (", psnr: 98", "", "entry 2 of figures has no figure"),
        ("set: pair", "set: par", "entry 1 of figures: set is par; choose one of pair, larger, all"),
        ("sets:", "lists:", "the file has lists, figures; its keys are sets"),
        ("painter: Theirs", "painter: '${oc.env:HOME}'", "refers to something else; write the value itself"),
    ):
        write_text(tmp_path / "wrong.yaml", PUBLISHED.replace(old, new, 1))
        refuses(reason, read_published, tmp_path / "wrong.yaml")


def test_paintings_by_others_are_measured_as_ours(run_task, tmp_path, caplog, monkeypatch):
    monkeypatch.chdir(tmp_path)
    caplog.set_level("INFO")
    ours = run_task(paint, "image=coffee", "resolution=32", "strokes=12", "steps=2", "frames=0", "report=false")
    assert ours["cpu_seconds"] > 0
    run, theirs, photos, twins, broken = (tmp_path / name for name in ("run", "theirs", "photos", "twins", "broken"))
    for folder in (run, theirs, photos, twins, broken):
        folder.mkdir()
    for name in ("painting.png", "target.png", "metrics.json", "catalogue.h5"):
        (tmp_path / name).rename(run / name)
    (run / "painting.png").rename(theirs / "x.png")
    write_picture(run / "painting.png", np.zeros((21, 32, 3), np.uint8))
    (photos / "x.png").write_bytes((run / "target.png").read_bytes())
    (broken / "metrics.json").write_text("text")
    words = (f"runs=[{run},{broken}]", "name=Theirs", f"published={tmp_path}/published.yaml")
    write_text(tmp_path / "published.yaml", PUBLISHED)
    result = run_task(task, "task=leaderboard", *words, f"add={theirs}", f"target={photos}", "seconds=3")
    assert result["paintings"] == 2
    assert "not finished paintings: broken" in caplog.text
    assert "leaderboard.md: 2 paintings in 1 sections" in caplog.messages, "paths are shown as typed"
    rows = [row for row in read_csv(tmp_path / "leaderboard.csv") if row["from"] == "measured"]
    assert {row["painter"] for row in rows} == {"Theirs", "gradient"}
    assert [float(row["psnr"]) for row in rows] == pytest.approx([ours["psnr"]] * 2)
    assert not (tmp_path / "anytime.png").exists()  # there is only one curve
    page = (tmp_path / "report.html").read_text()
    assert page.count("Theirs") > 2
    assert '<tr class="published">' in page
    page = (tmp_path / "leaderboard.md").read_text()
    assert "Somebody, 2020, table 1" in (tmp_path / "leaderboard.csv").read_text()
    assert "L1" not in page.partition("## How to read the tables")[0]
    assert [row["picture"] for row in read_csv(tmp_path / "pictures.csv")] == ["picture"] * 2
    assert r"\toprule" in (tmp_path / "leaderboard.tex").read_text()
    run_task(task, "task=leaderboard", "name=Again", f"add={run}/catalogue.h5", f"target={photos}/x.png")
    again = gather([tmp_path / "added" / "catalogue"], tmp_path)
    assert again["metric", "psnr"].tolist() == [pytest.approx(ours["psnr"])]
    assert again["metric", "n_strokes"].tolist() == [12]
    for name in ("x.jpg", "x.png"):
        (twins / name).write_bytes((run / "target.png").read_bytes())
    for wrong, reason in (
        ((), "nothing to compare; try runs=outputs, or add=painting.png target=photo.jpg name=theirs"),
        ((f"add={theirs}",), "needs the painted picture; give target=photo.jpg"),
        ((f"add={theirs}/x.png", "target=coffee"), "metrics compare pictures of equal size"),
        ((f"add={theirs}", f"target={run}"), "has no picture x for add="),
        ((f"add={twins}", f"target={photos}"), "x.png and x.jpg both show x; remove one of them"),
    ):
        refuses(re.escape(reason), run_task, task, "task=leaderboard", *wrong)


def test_the_task_begins_from_the_command_line(tmp_path):
    (tmp_path / "none").mkdir()
    code, output = ended(tmp_path, "task=leaderboard", "runs=none")
    assert (code, output) == (
        1,
        "brushexp: runs=none: there is no finished run; give the folder of a run or of a sweep\n",
    )
