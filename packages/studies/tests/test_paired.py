"""Paired differences: the numbers are those of SciPy's paired t test, and the verdicts keep to their rule."""

import math

import numpy as np
import pytest
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
from sweeps import collect, make_run, read_csv

A, B, C = (30.0, 25.0, 28.0, 33.0), (30.5, 25.2, 29.1, 33.2), (29.0, 25.5, 27.0, 33.1)
PICTURES = ("a", "b", "c", "d")


def make_study(folder, psnr=(A, B, C), units=PICTURES, key="image", **noted):
    """A sweep of as many settings as there are rows, over pictures or seeds; None is a job that failed."""
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
    ((1.0, 1.1, 1.2, 1.0, 0.9, 1.0, 1.1, -0.2, -0.2, -0.2), "depends"),  # though the mean is better
    ((0.05, 0.05, 0.05, -0.05, -0.05, -0.05), "same"),  # by less than matters
    ((0.05, 0.06, 0.04, 0.05), "same"),  # for sure, but too little to matter
    ((0.11, 0.12, 0.13, 0.12), "better"),
    ((*(17 * (1.0,)), *(3 * (-1.0,))), "better"),  # 3 of 20 are too few for an answer that depends on the picture
    ((*(16 * (1.0,)), *(4 * (-1.0,))), "depends"),
    ((0.5, 0.6), "not decided"),  # too few
    ((0.5,), "not decided"),
])  # fmt: skip
def test_verdicts_keep_to_the_rule(gains, verdict):
    assert gap(*gains).verdict == verdict


def test_a_verdict_is_told_with_its_numbers():
    many = gap(0.5, 1.5, metric="seconds", confidence=1 - 0.05 / 200)  # with one degree of freedom: exp overflows
    assert many.bounds == "[x 0.00, x inf]"
    unknown = gap(*3 * (1e-9,), *3 * (-1e-9,), metric="style_poly")  # of which no difference is known to matter
    assert unknown.verdict == "not decided"
    assert gap(0.5, 0.6, 0.4, 0.5).sentence == "better: +0.50 [+0.37, +0.63]"
    assert gap(0.0, 0.0, 0.0).sentence == "no difference larger than 0.00"
    assert gap(0.5).sentence == "not decided, 1 picture"
    odd = gap(1.0, 1.0, 1.0, -1.0, -1.0, -1.0)
    assert odd.sentence.startswith("depends on the picture: better on a, b, c; worse on d, e, f; ")
    assert gap(1.0, 1.0, 1.0, -1.0, -1.0, -1.0, unit="seed").verdict == "not decided"
    assert "In this order: a difference *depends on the picture* if at least 3, and 20%, of them" in rule_for("picture")
    assert "In this order: there is *no difference larger than* what the interval allows" in rule_for("seed")


def test_tables_and_plot_are_written(tmp_path):
    write_differences(tmp_path, collect(make_study(tmp_path)))
    text = (tmp_path / "differences.md").read_text()
    assert "Against `order=o0`, paired by picture." in text
    assert "| order=o1 | PSNR, dB | +0.50 |" in text
    rows = read_csv(tmp_path / "differences.csv")
    assert rows[0] == {"setting": "order=o1", "against": "order=o0", "metric": "psnr", "picture": "a", "gain": "0.5"}
    with Image.open(tmp_path / "differences.png") as picture:
        assert picture.width == 1400
