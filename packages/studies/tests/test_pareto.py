"""The front of speed and quality: what is on it, how it is told, and that it is drawn whatever lies on it."""

import shlex
import warnings
from pathlib import Path

import pytest
from brushexp_studies.pareto import front, front_table, write_front
from hypothesis import given, settings
from hypothesis import strategies as st
from sweeps import collect, make_run, read_csv, write_words

from brushexp.results.runs import frame_of

COSTS = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=1, max_size=20)


def make_sweep(folder: Path) -> None:
    """Four settings; steps=3 is beaten in PSNR by steps=2, and steps=4 in all by everything."""
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
    table = front_table(collect(tmp_path))
    assert table["overrides"].str.partition(" ")[0].tolist() == ["steps=1", "steps=2", "steps=3", "steps=4"]
    assert table["front_psnr"].tolist() == [True, True, False, False]
    assert table["front_perceptual"].tolist() == [True, True, True, False]
    assert table["number"].tolist() == [1, 2, 3, 4]


def test_numbers_are_means_over_seeds(tmp_path):
    for steps, seed, psnr in ((1, 0, 20.0), (1, 1, 22.0), (2, 0, 30.0)):
        make_run(tmp_path, {"steps": str(steps), "seed": str(seed)}, psnr=psnr, seconds=float(seed + steps))
    table = front_table(collect(tmp_path))
    assert table[["psnr", "seconds", "runs"]].to_numpy().tolist() == [[21.0, 1.5, 2], [30.0, 2.0, 1]]


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
    ("ab", (None, None), ["a.png", "b.png"]),  # the targets were not kept
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
