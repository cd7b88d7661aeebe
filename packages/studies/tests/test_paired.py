"""Test that paired differences agree with SciPy's paired t-test, and that verdicts and plots follow from them."""

import json
import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from brushexp_studies.anytime import MOST_CURVES, write_curves
from brushexp_studies.effect import effects, write_effect
from brushexp_studies.paired import (
    Difference,
    interval,
    paired_differences,
    paired_table,
    rule_for,
    write_differences,
)
from PIL import Image
from scipy.stats import ttest_rel
from sweeps import collect, make_grid, make_run, note, read_csv, write_words

from brushexp.results.runs import shorten
from brushexp.runs.sweep_report import renew_sweep_report

A, B, C = (30.0, 25.0, 28.0, 33.0), (30.5, 25.2, 29.1, 33.2), (29.0, 25.5, 27.0, 33.1)
PICTURES = ("a", "b", "c", "d")


def make_study(folder, psnr=(A, B, C), units=PICTURES, key="image", **noted):
    """Write a sweep with one setting for each row of ``psnr``, over pictures or seeds; None stands for a failed job."""
    for unit, *values in zip(units, *psnr, strict=True):
        for k, value in enumerate(values):
            numbers = {"psnr": value, "seconds": 2.0 + k} if value is not None else {"status": "failed"}
            target = 10 * units.index(unit) if key == "image" else 7
            make_run(folder, {"order": f"o{k}", key: str(unit)}, target=target, **(numbers | noted))
    return folder


def gap(*gains, unit="picture", metric="psnr", confidence=0.95):
    named = {chr(97 + k): gain for k, gain in enumerate(gains)}
    return Difference("x", "y", metric, unit, named, *interval(gains, confidence))


@pytest.mark.parametrize(("key", "units"), [("image", PICTURES), ("seed", ("0", "1", "2", "3"))])
def test_differences_are_those_of_a_paired_t_test(tmp_path, key, units):
    table = paired_table(collect(make_study(tmp_path, units=units, key=key)))
    assert table.index.names == ["option", "picture" if key == "image" else "seed"]
    first, second, *_ = paired_differences(table, metrics=["psnr"])
    assert (first.option, first.reference, list(first.gains)) == ("order=o1", "order=o0", list(units))
    expected = ttest_rel(B, A).confidence_interval(1 - 0.05 / 2)  # two comparisons
    assert (first.low, first.high) == pytest.approx((expected.low, expected.high))
    assert second.mean == pytest.approx(np.mean(C) - np.mean(A))
    swapped = paired_differences(table, "order=o1", ["psnr"])[0]
    assert (swapped.option, swapped.mean) == ("order=o0", pytest.approx(-first.mean))


def test_ratios_are_of_logarithms_and_less_is_better(tmp_path):
    table = paired_table(collect(make_study(tmp_path)))
    slower = paired_differences(table, metrics=["seconds"])[1]
    assert slower.mean == pytest.approx(-math.log(2))
    assert slower.sentence == "worse: x 2.00 [x 2.00, x 2.00]"


@pytest.mark.parametrize(("larger", "names"), [
    (0, ("a.png", "a.png (2)")), (1, ("a.png, 30 x 20 pixels", "a.png, 31 x 20 pixels")),
])  # fmt: skip
def test_two_pictures_of_one_name_are_two(tmp_path, larger, names):
    for k, values in enumerate(((20.0, 21.0), (30.0, 33.0))):
        for option, value in enumerate(values):
            chosen, size = {"order": f"o{option}", "image": f"{k}/a.png"}, (20, 30 + k * larger)
            make_run(tmp_path, chosen, target=9 * k, size=size, psnr=value, seconds=2.0)
    (difference,) = paired_differences(paired_table(collect(tmp_path)), metrics=["psnr"])
    assert difference.gains == pytest.approx(dict(zip(names, (1, 3), strict=True)))


def test_one_picture_at_several_sizes_is_one(tmp_path):
    for k, value in enumerate((20.0, 21.0, 22.0, 25.0)):
        side, seed = (20, 30)[k % 2], str(k // 2)
        chosen = {"resolution": str(side), "image": "a.png", "seed": seed}
        make_run(tmp_path, chosen, target=9, size=(side, side), psnr=value, seconds=2.0)
    (difference,) = paired_differences(paired_table(collect(tmp_path)), metrics=["psnr"])
    assert (difference.unit, difference.gains) == ("seed", pytest.approx({"0": 1, "1": 3}))


def test_a_picture_without_one_of_the_two_is_left_out(tmp_path):
    table = paired_table(collect(make_study(tmp_path, psnr=(A, (30.5, None, 29.1, 33.2)))))
    (difference,) = paired_differences(table, metrics=["psnr"])
    assert difference.gains == pytest.approx({"a": 0.5, "c": 1.1, "d": 0.2})


@pytest.mark.parametrize(
    ("psnr", "units"), [((A,), PICTURES), (((1.0,), (2.0,)), ("a",)), (((None,), (None,)), ("a",))]
)
def test_one_setting_or_one_picture_is_no_study(tmp_path, psnr, units):
    assert paired_table(collect(make_study(tmp_path, psnr, units))) is None
    assert write_differences(tmp_path, collect(tmp_path)) == []


@pytest.mark.parametrize(("gains", "verdict"), [
    ((0.5, 0.6, 0.4, 0.5), "better"),
    ((-0.5, -0.6, -0.4, -0.5), "worse"),
    ((0.0, 0.0, 0.0), "same"),  # ties
    ((0.3, 0.3, 0.3), "better"),  # no spread
    ((0.01, -0.01, 0.02, -0.02), "same"),
    ((0.5, -0.4, 0.3, 0.1), "not decided"),
    ((1.0, 1.0, 1.0, -1.0, -1.0, -1.0), "depends"),
    ((1.0, 1.1, 1.2, 1.0, 0.9, 1.0, 1.1, -0.2, -0.2, -0.2), "depends"),  # although the mean is better
    ((0.05, 0.05, 0.05, -0.05, -0.05, -0.05), "same"),  # differences too small to matter
    ((0.05, 0.06, 0.04, 0.05), "same"),  # significant, but too small to matter
    ((0.11, 0.12, 0.13, 0.12), "better"),
    ((*(17 * (1.0,)), *(3 * (-1.0,))), "better"),  # 3 of 20 are too few for "depends"
    ((*(16 * (1.0,)), *(4 * (-1.0,))), "depends"),
    ((0.5, 0.6), "not decided"),  # too few units
    ((0.5,), "not decided"),
])  # fmt: skip
def test_verdicts_keep_to_the_rule(gains, verdict):
    assert gap(*gains).verdict == verdict


def test_a_verdict_is_told_with_its_numbers():
    many = gap(0.5, 1.5, metric="seconds", confidence=1 - 0.05 / 200)  # one degree of freedom: exp overflows
    assert many.bounds == "[x 0.00, x inf]"
    unknown = gap(*3 * (1e-9,), *3 * (-1e-9,), metric="style_poly")  # a metric without a known difference that matters
    assert unknown.verdict == "not decided"
    assert gap(0.5, 0.6, 0.4, 0.5).sentence == "better: +0.50 [+0.37, +0.63]"
    assert gap(0.01, 0.0, 0.02).sentence == "no difference that matters: +0.01 [-0.01, +0.03]"
    assert gap(0.5).sentence == "not decided, 1 picture"
    odd = gap(1.0, 1.0, 1.0, -1.0, -1.0, -1.0)
    assert odd.sentence.startswith("depends on the picture: better on a, b, c; worse on d, e, f; ")
    assert gap(1.0, 1.0, 1.0, -1.0, -1.0, -1.0, unit="seed").verdict == "not decided"
    depends = "decides: a difference *depends on the picture* if, in each direction, at least 3 pictures and 20%"
    assert depends in rule_for("picture")
    assert "decides: there is *no difference that matters* if the interval allows none" in rule_for("seed")


def test_tables_and_plot_are_written(tmp_path):
    write_differences(tmp_path, collect(make_study(tmp_path)))
    text = (tmp_path / "differences.md").read_text()
    assert "Against `order=o0`, paired by picture." in text
    assert "| order=o1 | PSNR, dB | +0.50 |" in text
    rows = read_csv(tmp_path / "differences.csv")
    assert rows[0] == {"setting": "order=o1", "against": "order=o0", "metric": "psnr", "picture": "a", "gain": "0.5"}
    with Image.open(tmp_path / "differences.png") as picture:
        assert picture.width == 1400


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
    [(chosen, 20.0) for chosen in ({}, *({key: value} for key in "abc" for value in "12"))],  # a list, not a grid
])  # fmt: skip
def test_nothing_to_compare_gives_no_plot(tmp_path, runs):
    for chosen, psnr in runs:
        make_run(tmp_path, chosen, psnr=psnr)
    (tmp_path / "effect.png").touch()  # written for the first jobs
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
        warnings.simplefilter("error")  # layout warnings would raise errors
        path = drawn(tmp_path)
    with Image.open(path) as picture:
        pixels = np.asarray(picture.convert("L"))
    assert pixels.shape[1] == 1400
    if heights:
        assert heights[0] <= pixels.shape[0] <= heights[1]
        for edge in (pixels[:2], pixels[-2:], pixels[:, :2], pixels[:, -2:]):
            assert edge.min() > 250, "the border is white"


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
    renew_sweep_report(tmp_path)
    assert (tmp_path / "effect.png").read_bytes() == before, "the file is byte-identical every time"
    assert {path.name for path in tmp_path.glob("*.png")} == {"effect.png", "curves.png", "pareto.png"}
    assert {path.name for path in tmp_path.glob("*.md")} == {"table.md", "anytime.md", "pareto.md"}
    assert json.loads((tmp_path / "0" / "metrics.json").read_text())["psnr"] == 20.0


MEASURED = (np.array([1.0, 2.0, 4.0, 5.0]), np.array([10.0, 20.0, 18.0, 30.0]))
