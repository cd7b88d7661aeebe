"""The plots of a sweep show the right numbers, and no label, failure or gap stops them."""

import json
import math
import warnings
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from brushexp.results.curves import MOST, write_curves
from brushexp.results.effect import effects, mean_and_spread, write_effect
from brushexp.results.plotting import as_number, is_wide, named, plain, spaced, wrapped
from brushexp.results.sweep import renew
from brushexp.results.table import collect
from brushexp.system.files import write_json

SEEDS = {"seed": ["0", "1"]}


def make_run(folder: Path, number: int, chosen: dict[str, str], **metrics: object) -> Path:
    run = folder / str(number)
    run.mkdir(parents=True)
    write_json(run / "result.json", {"status": "completed", "overrides": chosen} | metrics)
    return run


def make_sweep(folder: Path, axes: dict[str, list[str]]) -> None:
    """Run number k has a PSNR of 20 + k dB."""
    for k, values in enumerate(product(*axes.values())):
        numbers = {"psnr": 20.0 + k, "perceptual": 1 / (k + 2), "seconds": 2.0 + k}
        make_run(folder, k, dict(zip(axes, values, strict=True)), **numbers)


def size_of(path: Path) -> tuple[int, int]:
    with Image.open(path) as picture:
        picture.load()
        return picture.size


# effects


def test_runs_are_grouped_by_all_but_the_seed(tmp_path):
    make_sweep(tmp_path, {"init": ["grid", "slic"], "loss": ["mse", "kl", "l1"], **SEEDS})
    found = effects(collect(tmp_path))
    assert (found.across, found.values, found.others, found.series) == (
        "loss",
        ["mse", "kl", "l1"],
        ["init"],
        ["grid", "slic"],
    )
    assert found.found["psnr"] == {
        ("grid", "mse"): [20.0, 21.0],
        ("grid", "kl"): [22.0, 23.0],
        ("grid", "l1"): [24.0, 25.0],
        ("slic", "mse"): [26.0, 27.0],
        ("slic", "kl"): [28.0, 29.0],
        ("slic", "l1"): [30.0, 31.0],
    }
    assert list(found.found) == ["psnr", "perceptual", "seconds"]
    assert found.places is None


def test_mean_and_spread_are_those_of_a_sample():
    assert mean_and_spread([20.0, 21.0, 25.0]) == (22.0, pytest.approx(math.sqrt(7)))
    assert mean_and_spread([20.0]) == (20.0, 0.0)


def test_numbers_are_put_in_order(tmp_path):
    make_sweep(tmp_path, {"lr": ["1e-1", "0.003", "2"]})
    found = effects(collect(tmp_path))
    assert (found.values, found.places) == (["0.003", "1e-1", "2"], [0.003, 0.1, 2.0])


def test_several_other_settings_name_one_series_each(tmp_path):
    make_sweep(tmp_path, {"a": ["1", "2"], "image": ["/x/y/a.png", "/x/y/b.png"], "lr": ["1", "2", "3"]})
    found = effects(collect(tmp_path))
    assert found.across == "lr"
    assert found.series == ["a=1, image=a.png", "a=1, image=b.png", "a=2, image=a.png", "a=2, image=b.png"]


def test_failed_and_interrupted_runs_are_left_out(tmp_path):
    make_sweep(tmp_path, {"init": ["grid", "slic", "fill"], **SEEDS})
    for number, status in ((1, "failed"), (4, "failed"), (5, "interrupted")):
        path = tmp_path / str(number) / "result.json"
        write_json(path, json.loads(path.read_text()) | {"status": status})
    assert effects(collect(tmp_path)).found["psnr"] == {("", "grid"): [20.0], ("", "slic"): [22.0, 23.0]}


def test_metrics_of_training_are_found_too(tmp_path):
    for k, size in enumerate(("64", "128")):
        make_run(tmp_path, k, {"engine.window": size}, psnr_alpha=20.0 + k, fid_effl0=90.0, l2=0.001, seconds=3.0)
    assert list(effects(collect(tmp_path)).found) == ["psnr_alpha", "fid_effl0", "seconds"]


@pytest.mark.parametrize(
    "runs",
    [
        [({}, 20.0)],
        [({"seed": "0"}, 20.0), ({"seed": "1"}, 21.0)],
        [({"lr": "1"}, 20.0), ({"lr": "2"}, None)],
        [({"lr": "1"}, None), ({"lr": "2"}, None)],
    ],
)
def test_nothing_to_compare_gives_no_plot(tmp_path, runs):
    for k, (chosen, psnr) in enumerate(runs):
        make_run(tmp_path, k, chosen, psnr=psnr)
    assert write_effect(tmp_path) is None
    assert write_curves(tmp_path) is None
    assert list(tmp_path.glob("*.png")) == []


# pictures


@pytest.mark.parametrize(
    "axes",
    [
        {"lr": ["0.001", "0.01", "0.1"], **SEEDS},
        {"ring": ["0", "128"], "patch": ["160", "320"]},
        {"init": ["grid", "slic"]},
        {"loss": ["mse", "[mse,perceptual,kl,width,discriminator,lpips]", "", "画$x$\n" + "long/" * 40], **SEEDS},
    ],
)
def test_a_plot_is_the_same_every_time(tmp_path, axes):
    make_sweep(tmp_path, axes)
    path = write_effect(tmp_path)
    assert path == tmp_path / "effect.png"
    assert size_of(path) == (1400, 500)
    before = path.read_bytes()
    assert write_effect(tmp_path).read_bytes() == before


def test_many_values_get_a_taller_plot_and_nothing_is_cut(tmp_path):
    make_sweep(tmp_path, {"loss": [f"loss_number_{k}+perceptual+width" for k in range(14)], "init": ["a", "b", "c"]})
    path = write_effect(tmp_path)
    width, height = size_of(path)
    assert width == 1400
    assert 700 < height < 1400
    with Image.open(path) as picture:
        pixels = np.asarray(picture.convert("L"))
    for edge in (pixels[:2], pixels[-2:], pixels[:, :2], pixels[:, -2:]):
        assert edge.min() > 250, "there is white all around"


def test_the_layout_never_gives_up(tmp_path):
    make_sweep(
        tmp_path, {"some.very.long_setting" * 3: ["value" * 12 + str(k) for k in range(3)], "b": ["x" * 90, "y" * 90]}
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_effect(tmp_path)


def test_labels_are_broken_after_signs():
    assert wrapped("mse+perceptual+width", 15) == "mse+perceptual+\nwidth"
    assert wrapped("a" * 25, 10, most=2) == "aaaaaaaaaa\naaaaaaa..."
    assert wrapped("", 10) == ""
    assert plain("a$b$\n画 é") == r"a\$b\$ ? é"
    assert named({"a": {"1": "one"}}, ["1"]) == "one"
    assert named({"a": {"": ""}, "b": {"2": "two"}}, ["", "2"]) == "a=not set, b=two"


def test_numbers_are_told_from_words():
    assert [as_number(text) for text in ("1e-3", "-2", "inf", "nan", "null", "")] == [
        0.001,
        -2.0,
        None,
        None,
        None,
        None,
    ]
    assert is_wide([0.01, 1.0])
    assert not is_wide([0.0, 100.0])
    assert not is_wide([])
    assert spaced([0.0, 0.05, 0.5, 0.52], [0.1] * 4) == [0, 2]


# curves


def add_curve(run: Path, seconds: list[float], psnr: list[float]) -> None:
    path = run / "result.json"
    write_json(path, json.loads(path.read_text()) | {"anytime": list(zip(seconds, psnr, strict=True))})


@pytest.mark.parametrize("count", [1, 2, MOST, MOST + 1])
def test_curves_are_drawn_however_many(tmp_path, count):
    make_sweep(tmp_path, {"optimizer": [f"o{k}" for k in range(count)], "seed": ["0", "1"] if count == 2 else ["0"]})
    for run in list(tmp_path.iterdir()):
        add_curve(run, [0.2, 0.4, 0.6 + int(run.name)], [20.0, 22.0, 23.0])
    path = write_curves(tmp_path)
    assert (path is not None) == (count > 1)
    if path is not None:
        assert size_of(path) == (1400, 500)


def test_a_broken_plot_does_not_lose_the_table(tmp_path, monkeypatch):
    make_sweep(tmp_path, {"init": ["grid", "slic"]})

    def broken(folder: Path) -> None:
        raise RuntimeError("no plot today")

    monkeypatch.setattr("brushexp.results.sweep.write_effect", broken)
    with pytest.raises(RuntimeError):
        renew(tmp_path)
    assert (tmp_path / "table.md").is_file()


def test_a_report_has_its_plots(tmp_path):
    make_sweep(tmp_path, {"init": ["grid", "slic"]})
    for run in list(tmp_path.iterdir()):
        add_curve(run, [0.2, 0.4], [20.0, 22.0])
    renew(tmp_path)
    assert {path.name for path in tmp_path.glob("*.png")} == {"effect.png", "curves.png", "pareto.png"}
    assert {path.name for path in tmp_path.glob("*.md")} == {"table.md", "anytime.md", "pareto.md"}


def test_a_list_of_settings_has_no_plot_of_the_effect(tmp_path):
    make_sweep(tmp_path, {"a": ["", "1", "2", "3"], "b": ["", "1", "2"], "c": ["", "1", "2"]})
    for run in list(tmp_path.iterdir()):
        chosen = json.loads((run / "result.json").read_text())["overrides"]
        if sum(value != "" for value in chosen.values()) > 1:
            (run / "result.json").unlink()
    assert len(collect(tmp_path)) == 8
    (tmp_path / "effect.png").touch()  # of the first jobs
    assert write_effect(tmp_path) is None
    assert not (tmp_path / "effect.png").exists()


def test_runs_that_stopped_early_are_compared(tmp_path):
    make_sweep(tmp_path, {"init": ["grid", "slic"]})
    path = tmp_path / "1" / "result.json"
    write_json(path, json.loads(path.read_text()) | {"status": "stopped early"})
    assert effects(collect(tmp_path)).found["psnr"] == {("", "grid"): [20.0], ("", "slic"): [21.0]}
