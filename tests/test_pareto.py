"""The front of speed and quality: what is on it, how it is told, and that its labels can be read."""

import csv
import shlex
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from brushexp.results.labels import place
from brushexp.results.pareto import front, in_lines, points_of, write_front
from brushexp.results.runs import by_picture, command_of, paintings
from brushexp.results.table import collect
from brushexp.system.files import write_json, write_picture, write_text

COSTS = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=1, max_size=20)


def make_run(folder: Path, chosen: dict[str, str], target: int | None = 100, **metrics: object) -> Path:
    run = folder / str(len(list(folder.iterdir())))
    run.mkdir()
    write_json(run / "result.json", {"status": "completed", "overrides": chosen} | metrics)
    if target is not None:
        write_picture(run / "target.png", np.full((20, 30, 3), target, np.uint8))
    return run


def make_sweep(folder: Path) -> None:
    """Four settings; steps=3 is beaten in PSNR by steps=2, and steps=4 in all by everything."""
    for steps, seconds, psnr, perceptual in (
        (1, 1.0, 20, 0.3),
        (2, 2.0, 25, 0.2),
        (3, 4.0, 24, 0.1),
        (4, 8.0, 15, 0.4),
    ):
        make_run(folder, {"steps": str(steps), "frames": "0"}, seconds=seconds, psnr=psnr, perceptual=perceptual)


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@settings(deadline=None)
@given(COSTS)
def test_nothing_beats_the_front_and_the_front_beats_the_rest(costs):
    on = front(costs)
    best = [cost for cost, first in zip(costs, on, strict=True) if first]
    for cost, first in zip(costs, on, strict=True):
        beaten = any(other[0] <= cost[0] and other[1] <= cost[1] and other != cost for other in best)
        assert first != beaten


def test_both_fronts_are_marked_and_sorted_by_seconds(tmp_path):
    make_sweep(tmp_path)
    (picture,) = by_picture(tmp_path, collect(tmp_path)[::-1])
    points = points_of(picture)
    assert [p.setting.label for p in points] == ["steps=1", "steps=2", "steps=3", "steps=4"]
    assert [p.first for p in points] == [("psnr", "perceptual"), ("psnr", "perceptual"), ("perceptual",), ()]
    assert [p.number for p in points] == [1, 2, 3, 4]


def test_numbers_are_means_over_seeds(tmp_path):
    for steps, seed, psnr in ((1, 0, 20.0), (1, 1, 22.0), (2, 0, 30.0)):
        make_run(tmp_path, {"steps": str(steps), "seed": str(seed)}, psnr=psnr, seconds=float(seed + steps))
    (picture,) = by_picture(tmp_path, collect(tmp_path))
    assert [(p.psnr, p.seconds, len(p.setting.runs)) for p in points_of(picture)] == [(21.0, 1.5, 2), (30.0, 2.0, 1)]


def test_pictures_are_never_mixed(tmp_path):
    for target, image in ((100, "a.png"), (200, "b.png")):
        for steps in (1, 2):
            make_run(tmp_path, {"image": image, "steps": str(steps)}, target, psnr=target + steps, seconds=float(steps))
    write_front(tmp_path)
    rows = read(tmp_path / "pareto.csv")
    assert [row["front_psnr"] for row in rows] == ["True"] * 4
    assert {row["picture"] for row in rows} == {"a.png, 30 x 20 pixels", "b.png, 30 x 20 pixels"}
    assert {row["overrides"] for row in rows} == {"steps=1", "steps=2"}


def test_two_versions_of_a_picture_have_two_names(tmp_path):
    for target in (100, 200):
        make_run(tmp_path, {"image": "a.png"}, target, psnr=20.0, seconds=1.0)
    names = [picture.name for picture in by_picture(tmp_path, collect(tmp_path))]
    assert names == ["a.png, 30 x 20 pixels", "a.png, 30 x 20 pixels (2)"]


def test_without_a_kept_target_the_overrides_tell_pictures_apart(tmp_path):
    for image in ("a.png", "b.png"):
        make_run(tmp_path, {"image": image}, None, psnr=20.0, seconds=1.0)
    assert [picture.name for picture in by_picture(tmp_path, collect(tmp_path))] == ["a.png", "b.png"]


def test_the_tables_say_how_to_repeat_a_run(tmp_path):
    make_sweep(tmp_path)
    words = ["experiment=x", "loss=[mse,kl]", "+a.b=1", "output=there"]
    (tmp_path / "1" / ".hydra").mkdir()
    write_text(tmp_path / "1" / ".hydra" / "overrides.yaml", "".join(f"- {word}\n" for word in words))
    write_front(tmp_path)
    commands = [row["command"] for row in read(tmp_path / "pareto.csv")]
    assert commands[0] == "python run.py steps=1 frames=0"
    assert shlex.split(commands[1]) == ["python", "run.py", *words[:3], "hydra.mode=RUN"]
    lines = (tmp_path / "pareto.md").read_text().splitlines()
    assert "| 3 | 4.00 | 24.00 | 0.1000 | 1 | perceptual | steps=3 |" in lines
    assert "   3: steps=3 frames=0" in lines
    assert "| 4 | 8.00 | 15.00 | 0.4000 | 1 |  | steps=4 |" in lines
    assert not any(line.startswith("   4:") for line in lines)


def test_a_removed_key_is_repeated_as_such(tmp_path):
    run = make_run(tmp_path, {"a": "(removed)", "b": "1"})
    assert command_of(run, collect(tmp_path)[0]) == "python run.py '~a' b=1"


@pytest.mark.parametrize("status", ["failed", "interrupted"])
def test_unfinished_runs_are_left_out(tmp_path, status):
    make_sweep(tmp_path)
    make_run(tmp_path, {"steps": "9"}, status=status, psnr=50.0, seconds=0.1)
    make_run(tmp_path, {"steps": "8"}, psnr=None, seconds=0.1)
    make_run(tmp_path, {"steps": "7"}, status="stopped early", psnr=20.0, seconds=0.1)
    assert len(paintings(collect(tmp_path))) == 5


def test_one_setting_has_no_front(tmp_path):
    for seed in "01":
        make_run(tmp_path, {"seed": seed}, psnr=20.0, seconds=1.0)
    assert write_front(tmp_path) is None
    assert not list(tmp_path.glob("pareto.*"))


@pytest.mark.parametrize(
    "rows",
    [
        [(0.0, 15.0, None), (2.0, 25.0, None)],
        [(1.0, 20.0, 0.2), (1.0, 20.0, 0.2)],
        [(1e-3, 5.0, 0.9), (1.0, 30.0, 0.2), (1.01, 30.1, 0.19), (4e4, 8.0, 5.0)],
        [(1.0, 20.0, 0.2), (1.5, 21.0, None)],
        [(1.0 + k / 50, 20.0 + k / 10, 0.3 - k / 100) for k in range(14)],
    ],
)
def test_every_front_is_drawn_and_the_same_every_time(tmp_path, rows):
    for k, (seconds, psnr, perceptual) in enumerate(rows):
        chosen = {"image": "a.png", "a$_^{": "画" * k, "some.very_long.key": f"[{'x,' * 3 * k}]"}
        make_run(tmp_path, chosen, seconds=seconds, psnr=psnr, perceptual=perceptual)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        path = write_front(tmp_path)[2]
    before = path.read_bytes()
    assert write_front(tmp_path)[2].read_bytes() == before
    with Image.open(path) as picture:
        assert picture.size == (1400, 700)


def test_more_pictures_make_a_taller_plot(tmp_path):
    for target in (1, 2, 3):
        for steps in (1, 2):
            make_run(tmp_path, {"steps": str(steps)}, target, psnr=20.0, seconds=1.0)
    with Image.open(write_front(tmp_path)[2]) as picture:
        assert picture.size == (1400, 2100)


PIXEL = st.floats(0, 400)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(PIXEL, PIXEL), min_size=1, max_size=15), st.lists(st.tuples(PIXEL, PIXEL), max_size=20))
def test_labels_cover_nothing_and_stay_inside(points, others):
    taken = [(x - 4, y - 4, x + 4, y + 4) for x, y in [*points, *others]]
    boxes = place(points, [(90.0, 24.0)] * len(points), taken, (0, 0, 400, 400), 200)
    shown = [box for box in boxes if box[0] < box[2]]
    for k, box in enumerate(shown):
        assert box[0] >= 0
        assert box[1] >= 0
        assert box[2] <= 400
        assert box[3] <= 400
        for other in [*taken, *shown[:k]]:
            assert box[0] > other[2] or box[2] < other[0] or box[1] > other[3] or box[3] < other[1]
    assert shown or len(taken) > 3, "an empty plot has room"


def test_a_label_stands_as_near_as_it_can():
    (box,) = place([(200.0, 200.0)], [(50.0, 10.0)], [(195, 195, 205, 205)], (0, 0, 400, 400), 200)
    away = np.hypot(max(box[0] - 200, 200 - box[2], 0), max(box[1] - 200, 200 - box[3], 0))
    assert 8 <= away < 15


def test_lines_break_between_overrides_first():
    assert in_lines(("steps=100", "strokes=4000", "blend=topk_4"), 26) == "steps=100 strokes=4000\nblend=topk_4"
    assert in_lines(("a=" + "x" * 30,), 26) == "a=\n" + "x" * 26 + "\nxxxx"
