"""Runs from anywhere are compared: at equal time, at equal quality, and on one front."""

from pathlib import Path

import numpy as np
import pytest
from brushexp_studies import task
from brushexp_studies.anytime import quality_at, time_to, write_anytime
from sweeps import collect, make_run, write_words

from brushexp.errors import UserError
from brushexp.results.anytime_curves import curve_from, leaders, mean_curve
from brushexp.results.runs import gather

CURVE = (np.array([1.0, 2.0, 4.0, 5.0]), np.array([10.0, 20.0, 18.0, 30.0]))
NUMBERS = {"psnr": 25.0, "perceptual": 0.2, "seconds": 2.0, "anytime": [[0.1, 15.0], [2.0, 25.0]]}


def single_run(folder: Path, *words: str, **numbers: object) -> Path:
    """Write the files of a run."""
    make_run(folder.parent, {}, name=folder.name, target=100, **(NUMBERS | numbers))
    write_words(folder, *words)
    return folder


def sweep(folder: Path, *settings: str, **numbers: object) -> None:
    """Write the files of a sweep with one override a job."""
    for k, setting in enumerate(settings):
        single_run(folder / str(k), setting, loss="mse", **numbers)


def test_quality_at_a_time_is_the_best_so_far_and_time_to_a_quality_the_first():
    assert [quality_at(CURVE, t) for t in (1, 1.5, 2, 3, 4, 5)] == pytest.approx([10, 15, 20, 20, 20, 30])
    assert quality_at(CURVE, 0.9) is quality_at(CURVE, 5.1) is None
    assert [time_to(CURVE, p) for p in (9.9, 10, 15, 20, 25, 30)] == pytest.approx([1, 1, 1.5, 2, 4.5, 5])
    assert time_to(CURVE, 30.1) is None


def test_curves_are_read_in_order_and_a_run_without_one_is_passed_over():
    for noted in (None, [], [[1.0, 20.0]], [[1, None], [2, 3]], "x", [["a", 1], [2, 3]], [1, 2, 3]):
        assert curve_from(noted) is None
    seconds, psnr = curve_from([[2, 25.0], [1, 20.0], [3, None]])
    assert (seconds.tolist(), psnr.tolist()) == ([1.0, 2.0], [20.0, 25.0])


def test_a_run_that_has_ended_keeps_its_picture_in_the_mean_and_the_lead():
    curves = (([0.0, 1.0], [10.0, 20.0]), ([0.5, 2.0], [20.0, 30.0]))
    times, psnr = mean_curve([(np.array(times), np.array(psnr)) for times, psnr in curves])
    assert times.tolist() == [0.5, 1.0, 2.0]
    assert psnr.tolist() == pytest.approx([(15 + 20) / 2, (20 + 20 + 10 / 3) / 2, (20 + 30) / 2])
    fast = (np.array([0.0, 1.0]), np.array([10.0, 20.0]))
    slow = (np.array([0.5, 3.0, 4.0]), np.array([5.0, 20.05, 30.0]))
    assert leaders({"fast": fast, "slow": slow}) == [(0.0, "fast"), (4.0, "slow")]


def test_equal_time_and_equal_quality_are_told(tmp_path):
    for steps, curve in (("1", NUMBERS["anytime"]), ("2", [[0.2, 21.0], [1.2, 31.0]])):
        make_run(tmp_path, {"image": "chelsea", "steps": steps}, target=100, **(NUMBERS | {"anytime": curve}))
    lines = write_anytime(tmp_path, collect(tmp_path)).read_text().splitlines()
    assert "## chelsea, 30 x 20 pixels" in lines
    assert "| overrides | 0.1 s | 0.2 s | 0.5 s | 1 s | 2 s | end | best |" in lines
    assert "| steps=2 | – | 21.00 | 24.00 | 29.00 | – | 1.2 s | 31.00 |" in lines
    assert "| steps=1 | 0.10 | 1.05 | 2.00 | – | – |" in lines
    assert "| steps=2 | 0.20 | 0.20 | 0.60 | 0.90 | 1.10 |" in lines
    assert lines[-2:] == ["| 0.1 s | steps=1 |", "| 0.2 s | steps=2 |"]


def test_sweeps_and_single_runs_are_gathered(tmp_path):
    sweep(tmp_path / "sweep", *(f"steps={k}" for k in range(11)))
    single_run(tmp_path / "alone", "+a=1", "~b", "output=x")
    into = tmp_path / "new"
    frame = gather([tmp_path / "sweep", tmp_path / "alone", tmp_path / "sweep" / "3"], into)
    assert list(frame.index) == [*(f"../sweep/{k}" for k in range(11)), "../alone"]
    assert frame["run", "overrides"].iloc[-1] == {"a": "1", "b": "(removed)"}
    assert all(path.resolve().is_dir() for path in frame["run", "folder"])
    assert len(gather([tmp_path], into)) == 12


@pytest.mark.parametrize(("name", "reason"), [("missing", "no such folder"), ("empty", "no finished run in it")])
def test_a_folder_without_runs_is_explained(tmp_path, name, reason):
    (tmp_path / "empty").mkdir()
    with pytest.raises(UserError, match=rf"runs=.*{name}: there is {reason}; give the folder of a run or of a sweep"):
        gather([tmp_path / name], tmp_path)


@pytest.fixture
def compare(tmp_path, config):
    """Run the task in this process; it returns the folder and the figures."""
    folder = tmp_path / "compared"

    def run(*overrides: str):
        folder.mkdir(exist_ok=True)
        return folder, task.run(config("task=compare", *overrides), folder, 0.0)

    return run


def test_everything_is_written(tmp_path, compare):
    sweep(tmp_path / "a", "steps=1", "steps=2")
    single_run(tmp_path / "b", "steps=3", "loss=[mse,kl]", seconds=5.0, psnr=31.0)
    folder, numbers = compare(f"runs=[{tmp_path}/a,{tmp_path}/b]")
    assert numbers["runs"] == 3
    names = {"table.csv", "table.md", "table.tex", "pareto.md", "pareto.csv", "pareto.png", "anytime.md", "curves.png"}
    assert {path.name for path in folder.iterdir()} == names | {"report.html"}
    assert "brushexp steps=3 'loss=[mse,kl]'" in (folder / "pareto.csv").read_text()
    assert "| ../b | 3 |" in (folder / "table.md").read_text()


def test_other_and_unfinished_runs_are_left_out_and_nothing_to_compare_is_explained(tmp_path, compare, caplog):
    sweep(tmp_path / "a", "steps=1", "steps=2", anytime=None)
    single_run(tmp_path / "b", "task=train", psnr=None)
    single_run(tmp_path / "c", "steps=3", status="interrupted")
    with caplog.at_level("INFO"):
        folder, numbers = compare(f"runs={tmp_path}")
    assert numbers["runs"] == 2
    assert "2 of 4 runs are left out" in caplog.text
    assert not {"anytime.md", "curves.png"} & {path.name for path in folder.iterdir()}
    with pytest.raises(UserError, match=r"1 of 2 runs are finished paintings, and no two .*'runs=\[\.\.\.\]'"):
        compare(f"runs=[{tmp_path}/a/0,{tmp_path}/b]")
