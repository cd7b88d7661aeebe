"""The plots of a sweep show the right numbers, and no label, failure or gap stops them."""

import json
import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from brushexp_studies.anytime import MOST_CURVES, write_curves
from brushexp_studies.effect import effects, write_effect
from PIL import Image
from sweeps import collect, make_grid, make_run, note, write_words

from brushexp.results.runs import shorten
from brushexp.runs.sweep_report import renew

SEEDS = {"seed": ["0", "1"]}
CURVE = [[0.2, 20.0], [0.4, 22.0], [0.6, 23.0]]


def drawn(folder: Path) -> Path | None:
    return write_effect(folder, collect(folder))


def means(folder: Path) -> dict[str, dict[object, float]]:
    return {name: one["mean"]["psnr"].dropna().to_dict() for name, one in effects(collect(folder)).items()}


def test_runs_are_grouped_by_all_but_the_seed(tmp_path):
    make_grid(tmp_path, {"init": ["grid", "slic"], "loss": ["mse", "kl", "l1"], **SEEDS})
    assert means(tmp_path) == {
        "init=grid": {"mse": 20.5, "kl": 22.5, "l1": 24.5},
        "init=slic": {"mse": 26.5, "kl": 28.5, "l1": 30.5},
    }
    table = effects(collect(tmp_path))["init=grid"]
    assert (table.index.name, list(table.index)) == ("loss", ["mse", "kl", "l1"])
    assert table["std"]["psnr"].tolist() == pytest.approx([math.sqrt(0.5)] * 3)
    assert list(table["mean"]) == ["psnr", "perceptual", "seconds"]
    (tmp_path / "more").mkdir()
    make_grid(tmp_path / "more", {"a": ["1", "2"], "image": ["/x/y/a.png", "/x/y/b.png"], "lr": ["1", "2", "3"]})
    assert list(means(tmp_path / "more")) == [f"a={a} image={name}.png" for a in "12" for name in "ab"]
    for size in ("64", "128"):
        run = {"psnr_alpha": 20.0, "fid_effl0": 90.0, "l2": 0.001, "seconds": 3.0}
        make_run(tmp_path / "training", {"engine.window": size}, name=size, **run)
    assert list(effects(collect(tmp_path / "training"))["default"]["mean"]) == ["psnr_alpha", "fid_effl0", "seconds"]


def test_numbers_are_put_in_order(tmp_path):
    make_grid(tmp_path, {"lr": ["1e-1", "0.003", "2"]})
    assert means(tmp_path) == {"default": {0.003: 21.0, 0.1: 20.0, 2.0: 22.0}}
    for value in ("inf", "null", ""):
        write_words(tmp_path / "0", f"lr={value}")
        assert list(means(tmp_path)["default"]) == [value, "0.003", "2"]


def test_failed_and_interrupted_runs_are_left_out_but_not_those_that_stopped_early(tmp_path):
    make_grid(tmp_path, {"init": ["grid", "slic", "fill"], **SEEDS})
    for number, status in ((1, "failed"), (3, "stopped early"), (4, "failed"), (5, "interrupted")):
        note(tmp_path, number, status=status)
    assert means(tmp_path) == {"default": {"grid": 20.0, "slic": 22.5}}
    assert drawn(tmp_path)


@pytest.mark.parametrize("runs", [
    [({}, 20.0)],
    [({"seed": "0"}, 20.0), ({"seed": "1"}, 21.0)],
    [({"lr": "1"}, 20.0), ({"lr": "2"}, None)],
    [({"lr": "1"}, None), ({"lr": "2"}, None)],
    [(chosen, 20.0) for chosen in ({}, *({key: value} for key in "abc" for value in "12"))],  # a list, no grid
])  # fmt: skip
def test_nothing_to_compare_gives_no_plot(tmp_path, runs):
    for chosen, psnr in runs:
        make_run(tmp_path, chosen, psnr=psnr)
    (tmp_path / "effect.png").touch()  # of the first jobs
    assert drawn(tmp_path) is None
    assert write_curves(tmp_path, collect(tmp_path)) is None
    assert list(tmp_path.glob("*.png")) == []


@pytest.mark.parametrize(("axes", "heights"), [
    ({"lr": ["0.001", "0.01", "0.1"], **SEEDS}, (500, 500)),
    ({"ring": ["0", "128"], "patch": ["160", "320"]}, (500, 500)),
    ({"loss": ["mse", "[mse,perceptual,kl,width]", "", "画$x$\n" + "long/" * 40], **SEEDS}, (500, 500)),
    ({"loss": [f"loss_number_{k}+perceptual+width" for k in range(14)], "init": ["a", "b", "c"]}, (700, 1400)),
    ({"some.very.long_setting" * 3: ["value" * 12 + str(k) for k in range(3)], "b": ["x" * 90, "y" * 90]}, None),
])  # fmt: skip
def test_every_plot_is_drawn_whole(tmp_path, axes, heights):
    make_grid(tmp_path, axes)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the layout never gives up
        path = drawn(tmp_path)
    with Image.open(path) as picture:
        pixels = np.asarray(picture.convert("L"))
    assert pixels.shape[1] == 1400
    if heights:
        assert heights[0] <= pixels.shape[0] <= heights[1]
        for edge in (pixels[:2], pixels[-2:], pixels[:, :2], pixels[:, -2:]):
            assert edge.min() > 250, "there is white all around"


def test_values_are_shortened_as_long_as_they_differ():
    assert list(shorten(["/a/x/b.png", "/a/y/b.png"]).values()) == ["x/b.png", "y/b.png"]
    assert list(shorten(["[sets/a]", "[sets/b]"]).values()) == ["[a]", "[b]"]
    assert list(shorten(["a" * 50]).values()) == ["..." + "a" * 40]
    both = ["1" + "a" * 50, "2" + "a" * 50]
    assert list(shorten(both).values()) == both


@pytest.mark.parametrize("count", [2, MOST_CURVES + 1])
def test_every_image_has_its_own_curves_however_many(tmp_path, count):
    make_grid(tmp_path, {"optimizer": [f"o{k}" for k in range(count)], "image": ["a.png", "b.png"][:count], **SEEDS})
    for run in list(tmp_path.iterdir()):
        note(tmp_path, run.name, anytime=[*CURVE[:2], [0.6 + int(run.name), 23.0]])
    with Image.open(write_curves(tmp_path, collect(tmp_path))) as picture:
        assert picture.size == (1400, 1000)


def test_a_report_has_its_plots(tmp_path):
    make_grid(tmp_path, {"init": ["grid", "slic"]}, anytime=CURVE)
    before = drawn(tmp_path).read_bytes()
    renew(tmp_path)
    assert (tmp_path / "effect.png").read_bytes() == before, "the same every time"
    assert {path.name for path in tmp_path.glob("*.png")} == {"effect.png", "curves.png", "pareto.png"}
    assert {path.name for path in tmp_path.glob("*.md")} == {"table.md", "anytime.md", "pareto.md"}
    assert json.loads((tmp_path / "0" / "metrics.json").read_text())["psnr"] == 20.0
