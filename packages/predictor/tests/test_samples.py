"""Test that samples find visible strokes, are summarised correctly, and give intervals with the desired coverage."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from brushexp_predictor.lay.network import PREDICTORS, SHIPPED_NAME, StrokePredictor
from brushexp_predictor.lay.predicting import paint_samples
from brushexp_predictor.samples import calibrate_task, conformal
from brushexp_predictor.samples import task as sample_task
from brushexp_predictor.samples.calibrate_task import FEWEST_RESTARTS, restart
from brushexp_predictor.samples.conformal import Doubt, deviation_from, holds, summarise_samples
from brushexp_predictor.samples.coverage import KINDS, Evidence, coverage_of, lattice, measure_at, seen_places, topmost
from brushexp_predictor.samples.figure import certainty_of
from brushexp_predictor.samples.kinds import PAINTING_KINDS, STROKE_KINDS, measure_each, measure_painting
from brushexp_predictor.samples.known import PICTURES, known_painting
from brushexp_predictor.samples.sampled import Interval, sample_brushwork
from brushexp_predictor.train.subjects import SAMPLES
from PIL import Image
from refusals import refuses
from scenes import random_strokes, straight

from brushexp.cli.program import expand_arguments
from brushexp.config.tasks import task_for
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Strokes

SIZE = (40, 60)
PLAIN, ANGLE = PAINTING_KINDS["colors"], STROKE_KINDS["direction"]


@pytest.fixture
def checkpoint(tmp_path) -> str:
    torch.manual_seed(3)
    PREDICTORS.save(tmp_path / f"{SHIPPED_NAME}.safetensors", SHIPPED_NAME, StrokePredictor(), {"options": {}})
    return str(tmp_path / f"{SHIPPED_NAME}.safetensors")


def test_the_uppermost_stroke_agrees_with_the_obvious_search():
    strokes = random_strokes(30, SIZE, width=(0.1, 0.3))
    strokes = replace(strokes, opacity=torch.where(torch.arange(30) % 4 == 0, 0.3, 0.9))
    curve, half = curve_of(strokes.map(torch.Tensor.double)).numpy(), half_width_of(strokes).double().numpy()
    t = np.linspace(0, 1, 4001)[:, None]
    weights = np.concatenate([(1 - t) ** 2, 2 * t * (1 - t), t**2], 1)
    places = lattice(SIZE, 2.5).flatten(0, 1)
    gap = np.stack([
        np.linalg.norm(places.numpy()[:, None] - weights @ one, axis=2).min(1) - width
        for one, width in zip(curve, half, strict=True)
    ])  # fmt: skip
    on = (gap <= 0) & (strokes.opacity.numpy()[:, None] >= 0.5)
    expected = np.where(on.any(0), 29 - on[::-1].argmax(0), -1)
    clear = np.abs(gap).min(0) > 1e-3
    assert clear.mean() > 0.9
    np.testing.assert_array_equal(topmost(strokes, places)[clear], expected[clear])


def test_what_lies_above_is_seen_what_is_faint_is_not_and_an_empty_place_has_nothing():
    level, upright = straight((10, 20), (50, 20), width=6), straight((30, 5), (30, 35), width=6)
    places = torch.tensor([[30.0, 20], [12, 20], [30, 8], [55, 38]])
    assert topmost(Strokes.join(level, upright), places).tolist() == [1, 0, 1, -1]
    faint = replace(upright, opacity=torch.tensor([0.2]))
    assert topmost(Strokes.join(level, faint), places).tolist() == [0, 0, -1, -1]
    assert topmost(Strokes.none(), places).tolist() == [-1] * 4
    told = measure_at([level, Strokes.join(level, upright)], places)
    assert told["direction"][1, :3] == pytest.approx([90, 0, 90], abs=1e-3)
    assert told["length"][0, :2] == pytest.approx([40, 40])
    assert np.isnan(told["width"][:, 3]).all()


def test_places_are_the_middles_of_equal_cells_and_directions_across_the_turn_are_near_each_other():
    assert lattice((4, 6), 2.0)[:, :, 0].tolist() == [[1, 3, 5], [1, 3, 5]]
    assert lattice((4, 6), 2.0)[:, 0, 1].tolist() == [1, 3]
    assert lattice((1, 1), 5.0).shape == (1, 1, 2)
    doubt = summarise_samples(np.array([[178.0], [2.0], [179.0], [1.0]]), axial=True)
    assert min(doubt.middle[0], 180 - doubt.middle[0]) == pytest.approx(0, abs=1e-9)
    assert doubt.spread[0] == pytest.approx(1.5)
    assert holds(np.array([179.5]), doubt, axial=True).all()
    assert not holds(np.array([90.0]), doubt, axial=True).any()
    assert deviation_from(np.array([1.0, 179.0, 90.0]), np.array([179.0, 1.0, 0.0]), axial=True).tolist() == [
        2,
        -2,
        -90,
    ]
    assert sample_task.texts_of("direction", Interval(30.0, -60.0, 120.0))["low"] == "any"
    assert sample_task.texts_of("direction", Interval(30.0, 20.0, 40.0))["low"] == "20"
    assert sample_task.texts_of("length", Interval(math.nan, math.nan, math.nan))["value"] == "–"


def test_two_samples_one_and_none_say_what_they_can_and_intervals_stay_where_there_are_values():
    doubt = summarise_samples(np.array([[1.0, 5.0, np.nan], [3.0, np.nan, np.nan]]), axial=False)
    np.testing.assert_allclose(doubt.middle, [2, 5, np.nan])
    np.testing.assert_allclose(doubt.spread, [1, 0, np.nan])
    np.testing.assert_allclose([doubt.low[0], doubt.high[0]], [-0.9, 0.9])
    assert holds(np.array([2.5, 5.0, 1.0]), doubt, axial=False).tolist() == [True, True, False]
    assert np.isnan(summarise_samples(np.full((2, 1), np.nan), axial=True).middle).all()
    doubt = Doubt(np.array([0.9]), np.array([0.2]), np.array([-0.1]), np.array([0.1]))
    share = conformal.Scaling(0.0, 1.0, 0.0, 2.0)(doubt, PAINTING_KINDS["coherence"])
    assert (share.middle + share.high)[0] == pytest.approx(1)
    assert share.low[0] == pytest.approx(-0.4)
    any_way = conformal.Scaling(0.0, 1.0, 0.0, 1000.0)(doubt, ANGLE)
    assert (any_way.low[0], any_way.high[0]) == (-90, 90)


@pytest.mark.parametrize("axial", [False, True])
def test_scaled_intervals_hold_nine_truths_of_ten_where_those_of_the_samples_do_not(axial):
    random = np.random.default_rng(0)
    kind = ANGLE if axial else STROKE_KINDS["width"]

    def evidence(paintings: int) -> Evidence:
        painting = np.repeat(np.arange(paintings), random.integers(1, 20, paintings))
        middle, spread = random.uniform(0, 180 if axial else 4, len(painting)), random.uniform(1, 3, len(painting))
        error = (4 if axial else 0.5) * spread * random.normal(size=len(painting))
        truth = (middle + error) % 180 if axial else 0.7 + 0.8 * middle + error
        return Evidence(truth, Doubt(middle, spread, -spread, spread), painting)

    fitted, tested = evidence(400), evidence(400)
    scaling = conformal.fit_scaling(*fitted, axial=axial)
    scaled = tested._replace(doubt=scaling(tested.doubt, kind))
    assert coverage_of(scaled, kind).share == pytest.approx(0.9, abs=0.03)
    if axial:
        assert coverage_of(tested, kind).share < 0.4
        assert (scaling.offset, scaling.slope) == (0, 1)
    else:
        assert (scaling.offset, scaling.slope) == pytest.approx((0.7, 0.8), abs=0.1)


@pytest.mark.parametrize("level", [0.0, 0.3, 0.5, 0.9, 1.0, 1.7])
def test_the_weighted_quantile_is_that_of_repeated_values(level):
    values, weight = np.array([3.0, 1.0, 2.0, 5.0]), np.array([2, 1, 3, 4])
    repeated = np.sort(np.repeat(values, weight))
    expected = repeated[min(max(math.ceil(level * 10) - 1, 0), 9)]
    assert conformal.weighted_quantile(values, weight.astype(float), level) == expected


def test_a_stroke_has_its_measures_and_is_asked_about_where_most_of_it_is_seen():
    one = {name: values[0] for name, values in measure_each(straight((10, 30), (40, 0), width=4)).items()}
    assert one == pytest.approx({"direction": 135, "length": 30 * math.sqrt(2), "width": 4})
    comb = Strokes.join(*(straight((10, y), (50, y), width=3) for y in range(4, 40, 4)))
    hidden = straight((30, 12), (30, 28), width=2)
    whole = measure_painting(Strokes.join(hidden, *[straight((10, 20), (50, 20), width=30)], comb), SIZE)
    assert min(whole["direction"], 180 - whole["direction"]) == pytest.approx(0, abs=1e-3)
    assert (whole["agreement"], whole["length"], whole["width"]) == pytest.approx((1, 40, 3))
    assert whole["colors"] == pytest.approx(0, abs=1e-4)
    assert np.isnan(list(measure_painting(Strokes.none(), SIZE).values())).all()
    assert measure_painting(comb[:1], SIZE)["length"] == pytest.approx(40)
    below, above = straight((10, 20), (50, 20), width=8), straight((38, 20), (55, 20), width=16)
    which, places = seen_places(Strokes.join(below, above), SIZE)
    assert which.tolist() == [0, 1]
    assert places[0].tolist() == pytest.approx([18, 20], abs=3)
    covered = Strokes.join(straight((40, 20), (50, 20), width=4), above)
    assert seen_places(covered, SIZE)[0].tolist() == [1]


def test_known_paintings_are_decided_by_seed_and_number_and_are_of_pictures_not_learnt_from():
    first, again, other = (known_painting(0, number, 64) for number in (2, 2, 14))
    assert torch.equal(first.picture, again.picture)
    assert torch.equal(first.strokes.position, again.strokes.position)
    assert not torch.equal(first.picture, other.picture)
    assert max(first.size) == 64
    assert not {*SAMPLES} & {*PICTURES}


def test_samples_differ_as_the_network_says_restarts_too_and_are_the_same_again():
    torch.manual_seed(0)
    network, target = StrokePredictor().requires_grad_(False), torch.rand(3, 24, 32)
    one, other = paint_samples(network, target, 12, 2)
    assert len(one.strokes) == 12
    assert not torch.equal(one.strokes.position, other.strokes.position)
    again = list(paint_samples(network, target, 12, 2))
    assert torch.equal(again[1].painting, other.painting)
    cold = list(paint_samples(network, target, 12, 2, temperature=0.0))
    assert torch.equal(cold[0].painting, cold[1].painting)
    samples = list(restart(torch.rand(3, 24, 32), 6, seconds=0.0, steps=2))
    assert len(samples) == FEWEST_RESTARTS
    assert not torch.equal(samples[0].strokes.position, samples[1].strokes.position)


def test_intervals_are_read_as_written_and_refused_for_other_weights(tmp_path):
    one = conformal.Scaling(0.1, 0.9, 0.01, 3.0)
    scalings = {("strokes", "length"): one, ("paintings", "width"): replace(one, factor=2.0)}
    path, kinds = tmp_path / "a.json", list(scalings)
    conformal.write_scalings(path, scalings, {"hash": "abc"})
    assert conformal.read_scalings(path, {"hash": "abc"}, kinds) == scalings
    words = r"a different hash than xyz; fit them with task=calibrate"
    refuses(words, conformal.read_scalings, path, {"hash": "xyz"}, kinds)
    refuses("lacks an interval", conformal.read_scalings, path, {}, [("strokes", "width")])
    data = json.loads(path.read_text())
    data["strokes"]["length"]["factor"] = None
    for text in (json.dumps(data), "[]", "{"):
        path.write_text(text)
        refuses(r"a\.json", conformal.read_scalings, path, {}, kinds)


def test_one_key_makes_analyse_sample_a_picture_and_python_has_the_same_face(tmp_path, checkpoint):
    Image.new("RGB", (64, 64)).save(tmp_path / "a.png")
    picture = str(tmp_path / "a.png")
    assert task_for("analyse", {"image": picture, "samples": "3"}) == "sample"
    assert task_for("analyse", {"image": picture}) == "measure"
    for image in (picture, "astronaut"):
        words = expand_arguments(["analyse", image, "samples=3"])
        assert {"task=sample", "samples=3"} <= {*words}
        assert any(word.startswith("image=") for word in words)
    brushwork = sample_brushwork(torch.rand(3, 30, 40), samples=2, strokes=5, checkpoint=checkpoint)
    assert [len(sample.strokes) for sample in brushwork.samples] == [5, 5]
    assert brushwork.strokes["direction"].value.shape == brushwork.places.shape[:2]
    assert not brushwork.is_calibrated
    known = np.isfinite(brushwork.strokes["width"].value)
    half = certainty_of(brushwork, "width")
    assert (half[known] >= 1).all()
    assert np.isnan(half[~known]).all()


def test_intervals_are_fitted_by_one_command_and_used_by_the_next(tmp_path, run_task, checkpoint, caplog):
    options = ("samples=3", f"checkpoint={checkpoint}", "threads=1")
    picture = "image=chelsea", "resolution=40", "strokes=12"
    plain = run_task(sample_task, "task=sample", *options, *picture)
    assert "fit them with brushexp calibrate" in caplog.text
    assert json.loads((tmp_path / "brushwork.json").read_text())["calibrated"] is False
    fit = run_task(calibrate_task, "task=calibrate", *options, "paintings=8", "side=40", "keep=true")
    assert 0 <= fit["coverage_strokes_width"] <= 1
    assert fit["psnr_spread"] >= 0
    table = (tmp_path / "coverage.md").read_text()
    assert table.count("\n") == 2 + len(KINDS)
    scaled = run_task(sample_task, "task=sample", *options, *picture)
    data = json.loads((tmp_path / "brushwork.json").read_text())
    assert data["calibrated"] is True
    assert set(data["measures"]) == set(PAINTING_KINDS)
    assert data["measures"]["width"]["low"] <= data["measures"]["width"]["value"] <= data["measures"]["width"]["high"]
    assert scaled["psnr"] == plain["psnr"] >= plain["psnr_worst"]
    with Image.open(tmp_path / "brushwork.png") as sheet:
        assert np.asarray(sheet).std() > 5
    refuses("different temperature", run_task, sample_task, "task=sample", *options, *picture, "temperature=2")
