"""Test that runs from any folders are compared at equal time, at equal quality, and by their Pareto front."""

import shlex
import warnings
from pathlib import Path

import numpy as np
import pytest
from brushexp_studies import task
from brushexp_studies.anytime import quality_at, time_to, write_anytime
from brushexp_studies.pareto import EVERY_RUN, Trade, front, front_table, trade_of, write_front
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refuses
from sweeps import collect, make_run, read_csv, write_words
from test_paired import MEASURED

from brushexp.results.anytime_curves import curve_from, leaders, mean_curve
from brushexp.results.runs import frame_of, gather

NUMBERS = {"psnr": 25.0, "perceptual": 0.2, "seconds": 2.0, "anytime": [[0.1, 15.0], [2.0, 25.0]]}


def single_run(folder: Path, *words: str, **numbers: object) -> Path:
    """Write the files of one run."""
    make_run(folder.parent, {}, name=folder.name, target=100, **(NUMBERS | numbers))
    write_words(folder, *words)
    return folder


def sweep(folder: Path, *settings: str, **numbers: object) -> None:
    """Write the files of a sweep with one job per setting."""
    for k, setting in enumerate(settings):
        single_run(folder / str(k), setting, loss="mse", **numbers)


def test_quality_at_a_time_time_to_a_quality_and_curves_are_those_of_the_numbers():
    assert [quality_at(MEASURED, t) for t in (1, 1.5, 2, 3, 4, 5)] == pytest.approx([10, 15, 20, 20, 20, 30])
    assert quality_at(MEASURED, 0.9) is quality_at(MEASURED, 5.1) is None
    assert [time_to(MEASURED, p) for p in (9.9, 10, 15, 20, 25, 30)] == pytest.approx([1, 1, 1.5, 2, 4.5, 5])
    assert time_to(MEASURED, 30.1) is None
    for noted in (None, [], [[1.0, 20.0]], [[1, None], [2, 3]], "x", [["a", 1], [2, 3]], [1, 2, 3]):
        assert curve_from(noted) is None
    seconds, psnr = curve_from([[2, 25.0], [1, 20.0], [3, None]])
    assert (seconds.tolist(), psnr.tolist()) == ([1.0, 2.0], [20.0, 25.0])
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


@pytest.mark.parametrize(("name", "reason"), [("missing", "no such folder"), ("empty", "no finished run")])
def test_a_folder_without_runs_is_explained(tmp_path, name, reason):
    (tmp_path / "empty").mkdir()
    words = rf"runs=.*{name}: there is {reason}; give the folder of a run or of a sweep"
    refuses(words, gather, [tmp_path / name], tmp_path)


@pytest.fixture
def compare(tmp_path, config):
    """Return a function that runs the task in this process and returns its folder and metrics."""
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
    words = r"1 of 2 runs are finished paintings, and no two .*'runs=\[\.\.\.\]'"
    refuses(words, compare, f"runs=[{tmp_path}/a/0,{tmp_path}/b]")


COSTS = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=1, max_size=20)


def make_sweep(folder: Path) -> None:
    """Write a sweep of four settings: steps=2 beats steps=3 in PSNR, and all others beat steps=4 in every metric."""
    rows = ((4, 8.0, 15, 0.4), (1, 1.0, 20, 0.3), (2, 2.0, 25, 0.2), (3, 4.0, 24, 0.1))
    for steps, seconds, psnr, perceptual in rows:
        numbers = {"seconds": seconds, "psnr": psnr, "perceptual": perceptual}
        make_run(folder, {"steps": str(steps), "frames": "0"}, target=100, **numbers)


@settings(deadline=None)
@given(COSTS)
def test_nothing_beats_the_front_and_the_front_beats_the_rest(costs):
    on = front(costs)
    best = [cost for cost, first in zip(costs, on, strict=True) if first]
    for cost, first in zip(costs, on, strict=True):
        assert first != any(other[0] <= cost[0] and other[1] <= cost[1] and other != cost for other in best)


def test_both_fronts_are_marked_and_sorted_by_seconds_and_unfinished_runs_left_out(tmp_path):
    make_sweep(tmp_path)
    for k, status in enumerate(("failed", "interrupted", "completed")):
        psnr = None if status == "completed" else 20.0
        make_run(tmp_path, {"steps": str(90 + k)}, status=status, psnr=psnr, seconds=0.1, target=100)
    frame = collect(tmp_path)
    table = front_table(frame, trade_of(frame))
    assert table["overrides"].str.partition(" ")[0].tolist() == ["steps=1", "steps=2", "steps=3", "steps=4"]
    assert table["front_psnr"].tolist() == [True, True, False, False]
    assert table["front_perceptual"].tolist() == [True, True, True, False]
    assert table["number"].tolist() == [1, 2, 3, 4]


def test_numbers_are_means_over_seeds(tmp_path):
    for steps, seed, psnr in ((1, 0, 20.0), (1, 1, 22.0), (2, 0, 30.0)):
        make_run(tmp_path, {"steps": str(steps), "seed": str(seed)}, psnr=psnr, seconds=float(seed + steps))
    table = front_table(collect(tmp_path), Trade("seconds", ("psnr",)))
    assert table[["psnr", "seconds", "runs"]].to_numpy().tolist() == [[21.0, 1.5, 2], [30.0, 2.0, 1]]


def test_the_cost_is_cpu_seconds_where_every_run_has_them_or_what_a_key_says(tmp_path):
    rows = ((1, 9.0, 1.0, 100), (2, 2.0, 2.0, 50), (3, 3.0, 3.0, 200))
    for steps, seconds, cpu, n in rows:
        numbers = {"seconds": seconds, "cpu_seconds": cpu, "n_strokes": n, "psnr": 20.0 + steps, "l1": 0.1 * steps}
        make_run(tmp_path, {"steps": str(steps)}, target=100, **numbers)
    frame = collect(tmp_path)
    assert trade_of(frame) == Trade("cpu_seconds", ("psnr",))
    assert front_table(frame, trade_of(frame))["front_psnr"].tolist() == [True] * 3
    by_strokes = front_table(frame, trade_of(frame, "n_strokes", ["l1"]))  # 100 strokes have the smallest error
    assert list(zip(by_strokes["overrides"], by_strokes["front_l1"], strict=True)) == [
        ("steps=2", True), ("steps=1", True), ("steps=3", False),
    ]  # fmt: skip
    assert write_front(tmp_path, frame, "n_strokes", ["l1"]).read_text().startswith("Cost: strokes painted, means")
    refuses("no run has fid_effl0; choose from psnr, l1, ", trade_of, frame, None, ["fid_effl0"])
    make_run(tmp_path, {"steps": "4"}, target=100, psnr=30.0, seconds=1.0)
    assert trade_of(collect(tmp_path)).cost == "seconds"


def test_networks_have_a_front_of_quality_against_speed(tmp_path, compare):
    (tmp_path / "networks").mkdir()
    for size, speed, fid in (("16", 900.0, 30.0), ("32", 500.0, 20.0), ("48", 400.0, 25.0)):
        words = {"task": "evaluate", "renderer.width": size}
        make_run(tmp_path / "networks", words, fid_effl0=fid, strokes_per_second=speed)
    frame = collect(tmp_path / "networks")
    assert trade_of(frame) == Trade("strokes_per_second", ("fid_effl0",))
    folder, _ = compare(f"runs={tmp_path}/networks")
    rows = [(row["picture"], row["front_fid_effl0"]) for row in read_csv(folder / "pareto.csv")]
    assert rows == [(EVERY_RUN, "True"), (EVERY_RUN, "True"), (EVERY_RUN, "False")]


@pytest.mark.parametrize(("loss", "is_told"), [("[mse,perceptual]", True), ("mse", False)])
def test_a_loss_that_is_measured_in_its_own_features_is_remarked(tmp_path, loss, is_told):
    for k, chosen in enumerate(("l1", loss)):
        numbers = {"psnr": 20.0, "perceptual": 0.2, "seconds": 1.0 + k}
        make_run(tmp_path, {"loss": chosen}, target=100, **numbers)
    text = write_front(tmp_path, collect(tmp_path)).read_text()
    assert ("Settings with loss=perceptual minimise the features of perceptual distance." in text) == is_told


def test_pictures_are_never_mixed(tmp_path):
    for target, image in ((100, "a.png"), (200, "b.png")):
        for steps in (1, 2):
            numbers = {"psnr": target + steps, "seconds": float(steps)}
            make_run(tmp_path, {"image": image, "steps": str(steps)}, target=target, **numbers)
    write_front(tmp_path, collect(tmp_path))
    rows = [(row["picture"], row["overrides"], row["front_psnr"]) for row in read_csv(tmp_path / "pareto.csv")]
    assert rows == [(f"{name}.png, 30 x 20 pixels", f"steps={k}", "True") for name in "ab" for k in (1, 2)]


@pytest.mark.parametrize(("images", "targets", "names"), [
    ("aa", (100, 101), ["a.png, 30 x 20 pixels", "a.png, 30 x 20 pixels (2)"]),
    ("ab", (None, None), ["a.png", "b.png"]),  # targets were not kept
])  # fmt: skip
def test_pictures_have_names_of_their_own(tmp_path, images, targets, names):
    for image, target in zip(images, targets, strict=True):
        make_run(tmp_path, {"image": f"{image}.png"}, target=target, psnr=20.0, seconds=1.0)
    assert collect(tmp_path)["run", "image"].tolist() == names


def test_the_tables_say_how_to_repeat_a_run(tmp_path):
    make_sweep(tmp_path)
    words = ["experiment=x", "steps=2", "frames=0", "output=there"]
    write_words(tmp_path / "2", *words)
    write_front(tmp_path, collect(tmp_path))
    commands = [row["command"] for row in read_csv(tmp_path / "pareto.csv")]
    assert commands[0] == "brushexp steps=1 frames=0"
    assert shlex.split(commands[1]) == ["brushexp", *words[:3], "hydra.mode=RUN"]
    lines = (tmp_path / "pareto.md").read_text().splitlines()
    assert "| 3 | 4.00 | 24.00 | 0.1000 | 1 | perceptual | steps=3 |" in lines
    assert "   3: brushexp steps=3 frames=0" in lines
    assert "| 4 | 8.00 | 15.00 | 0.4000 | 1 |  | steps=4 |" in lines
    assert not any(line.startswith("   4:") for line in lines)


@pytest.mark.parametrize("numbers", [{"psnr": 20.0, "seconds": 1.0}, {"l2": 0.1}, {}])
def test_one_setting_has_no_front(tmp_path, numbers):
    for seed in "01":
        make_run(tmp_path, {"seed": seed}, **numbers)
    assert write_front(tmp_path, collect(tmp_path)) is None
    assert not list(tmp_path.glob("pareto.*"))


@pytest.mark.parametrize("rows", [
    [(0.0, 15.0, None), (2.0, 25.0, None)],
    [(1.0, 20.0, 0.2), (1.0, 20.0, 0.2)],
    [(1e-3, 5.0, 0.9), (1.0, 30.0, 0.2), (1.01, 30.1, 0.19), (4e4, 8.0, 5.0)],
    [(1.0, 20.0, 0.2), (1.5, 21.0, None)],
    [(1.0 + k / 50, 20.0 + k / 10, 0.3 - k / 200) for k in range(40)],
])  # fmt: skip
def test_every_front_is_drawn_and_the_same_every_time(tmp_path, rows):
    results = {}
    for k, (seconds, psnr, perceptual) in enumerate(rows):
        chosen = {"image": "a.png", "a$_^{": "画" * k, "some.very_long.key": f"[{'x,' * 3 * k}]"}
        numbers = {"seconds": seconds, "psnr": psnr, "perceptual": perceptual}
        results[str(k)] = {"status": "completed", "overrides": chosen} | numbers
    frame = frame_of(tmp_path, results)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_front(tmp_path, frame)
    before = (tmp_path / "pareto.png").read_bytes()
    if len(rows) == 3:
        write_front(tmp_path, frame)
        assert (tmp_path / "pareto.png").read_bytes() == before
