"""What a trained network lays: exactly as many strokes as asked, on any canvas, as well as when it shipped."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
from brushexp_predictor import calibrate_task, conformal, sample_task, train_task
from brushexp_predictor.calibrate_task import LEAST, restart
from brushexp_predictor.colors import best_colors
from brushexp_predictor.conformal import Doubt, away_from, doubt_of, holds
from brushexp_predictor.coverage import KINDS, Evidence, coverage_of, lattice, seen_places, tell_at, topmost
from brushexp_predictor.decoding import FORMS, draw, strokes_of
from brushexp_predictor.kinds import OF_PAINTINGS, OF_STROKES, measure_each, measure_painting
from brushexp_predictor.known import PICTURES, known_painting
from brushexp_predictor.network import CELL, NAME, NUMBERS, PREDICTORS, REACH, StrokePredictor, load_predictor
from brushexp_predictor.predicted import Predicted
from brushexp_predictor.predicting import PART, paint_samples, partly, predict
from brushexp_predictor.pyramid import lay, levels_of
from brushexp_predictor.sample_figure import certainty_of
from brushexp_predictor.sampled import Interval, sample_brushwork
from brushexp_predictor.subjects import SAMPLES, Subjects, load_subjects
from brushexp_predictor.training import PredictorData, PredictorModule, log_error, mean_of, refined
from PIL import Image
from refusals import refuses
from scenes import random_strokes, straight
from torch import Tensor

import brushexp
from brushexp.cli.program import expand_arguments
from brushexp.config.tasks import task_for
from brushexp.pictures.load import load_picture
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.catalogue import Strokes, check_strokes


def psnr(picture: Tensor, target: Tensor) -> float:
    return -10 * math.log10(float((picture.clamp(0, 1) - target).square().mean()))


def drawn(strokes: Strokes, target: Tensor) -> Tensor:
    return draw(FORMS["plain"], strokes, (target.shape[1], target.shape[2]), target.mean((1, 2)))


@pytest.mark.parametrize(("size", "n"), [
    ((1, 1), 1), ((3, 2), 6), ((1, 300), 300), ((40, 56), 1), ((40, 56), 2), ((56, 40), 333), ((90, 9), 17),
])  # fmt: skip
def test_exactly_as_many_strokes_as_asked_are_laid_on_any_canvas(size: tuple[int, int], n: int) -> None:
    target = torch.rand(3, *size, generator=torch.Generator().manual_seed(0))
    strokes = Predicted()(target, n, torch.Generator())
    assert len(strokes) == n
    check_strokes(strokes)


@pytest.mark.parametrize("n", [1, 5, 100, 2600])
def test_levels_become_finer_and_have_all_strokes(n: int) -> None:
    levels = levels_of((96, 128), n)
    assert sum(level.keep for level in levels) == n
    assert all(level.keep <= level.rows * level.columns for level in levels)
    assert all(first.rows <= second.rows for first, second in pairwise(levels))


def test_photographs_and_brushwork_are_painted_as_well_as_when_the_weights_shipped_by_levels_that_add_detail():
    values = []
    for name in ("astronaut", "coffee", "chelsea"):
        target = load_picture(name, 192)
        values.append(psnr(drawn(Predicted()(target, 400, torch.Generator()), target), target))
    assert sum(values) / 3 > 25.2  # measured: 25.7
    target = load_picture("coffee", 192)
    strokes = Predicted(checkpoint="brushed")(target, 400, torch.Generator())
    assert (strokes.opacity == 1).all()
    size = (target.shape[1], target.shape[2])
    assert psnr(draw(FORMS["brushed"], strokes, size, target.mean((1, 2))), target) > 25.2  # measured: 25.7
    target = load_picture("coffee", 160)
    stages = [psnr(drawn(strokes, target), target) for strokes in predict(load_predictor("plain"), target, 300)]
    assert stages == sorted(stages)


def test_large_pictures_are_looked_at_part_by_part_and_it_cannot_be_seen() -> None:
    network = load_predictor("plain")
    side = CELL * (PART + 2 * REACH + 3)
    target, canvas = torch.rand(2, 1, 3, CELL * 20, side, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        whole, parts = network(target, canvas), partly(network)(target, canvas)
    for one, other in zip(whole, parts, strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=2e-4)


def test_numbers_of_0_are_level_strokes_and_the_way_from_numbers_to_strokes_is_differentiable():
    form = FORMS["plain"]
    strokes = strokes_of(form, torch.zeros(1, NUMBERS), torch.full((1, 3), 0.25), torch.tensor([[20.0, 12.0]]), 8.0)
    half = 8 * form.half_length
    expected = torch.tensor([[20 - half, 12.0], [20.0, 12.0], [20 + half, 12.0]])
    torch.testing.assert_close(curve_of(strokes)[0], expected, rtol=0, atol=1e-4)
    assert float(strokes.width * strokes.scale) == pytest.approx(8 * form.width)
    assert strokes.color.tolist() == [[0.25] * 3]
    random = torch.Generator().manual_seed(1)
    numbers = (0.5 * torch.randn(3, NUMBERS, generator=random, dtype=torch.float64)).requires_grad_()
    mean = torch.full((3, 3), 0.5, dtype=torch.float64)
    middle = torch.rand(3, 2, generator=random, dtype=torch.float64)

    def values(numbers: Tensor) -> Tensor:
        strokes = strokes_of(FORMS["brushed"], numbers, mean, middle, 5.0)
        return torch.cat([value.flatten() for _, value in strokes.items()])

    assert torch.autograd.gradcheck(values, numbers)


def test_colors_are_those_of_least_squares() -> None:
    """Compared with the normal equations of a matrix that has the picture of each stroke alone as a column."""
    random = torch.Generator().manual_seed(0)
    target = torch.rand(3, 24, 24, generator=random)
    strokes = Predicted(color_rounds=0)(target, 6, torch.Generator())
    black, background = strokes.map(Tensor.detach), torch.full((3,), 0.5)

    def laid(given: Strokes) -> Tensor:
        return draw(FORMS["plain"], given, (24, 24), background)

    def painted(color: Tensor) -> Tensor:
        return laid(Strokes(**dict(black.items()) | {"color": color}))  # type: ignore[arg-type]

    bare = painted(torch.zeros(6, 3))
    columns = torch.stack([painted(torch.eye(6)[:, k : k + 1].expand(6, 3)) - bare for k in range(6)])[:, 0]
    matrix = columns.flatten(1).T.double()
    exact = torch.linalg.lstsq(matrix, (target - bare).flatten(1).T.double()).solution.clamp(0, 1)
    found = best_colors(strokes, target, laid, 40).color
    seen = matrix.square().sum(0) > 1.0
    torch.testing.assert_close(found[seen].double(), exact[seen], rtol=0, atol=5e-3)


def test_more_rounds_are_never_worse_strokes_go_where_the_focus_is_and_temperature_makes_others():
    target = load_picture("astronaut", 96)
    errors = [psnr(drawn(Predicted(color_rounds=k)(target, 150, torch.Generator()), target), target) for k in (0, 1, 4)]
    assert errors == sorted(errors)
    target = torch.rand(3, 64, 64, generator=torch.Generator().manual_seed(0))
    focus = torch.ones(64, 64)
    focus[:, :32] = 50
    strokes = Predicted()(target, 200, torch.Generator(), focus / focus.mean())
    assert (strokes.position[:, 0] < 32).float().mean() > 0.6
    target = load_picture("coffee", 96)
    warm = Predicted(temperature=1.0)
    one, again, other = (warm(target, 100, torch.Generator().manual_seed(seed)) for seed in (0, 0, 1))
    assert torch.equal(one.position, again.position)
    assert not torch.equal(one.position, other.position)


def test_a_flat_picture_is_painted_flat_by_levels_that_end_as_the_initialiser_and_in_range_untrained():
    target = torch.full((3, 40, 40), 0.3)
    assert psnr(drawn(Predicted()(target, 50, torch.Generator()), target), target) > 40
    painting = brushexp.paint("coffee", painter="predictor", look="plain", resolution=96, strokes=120)
    begun = brushexp.paint("coffee", init="predicted", steps=0, look="plain", resolution=96, strokes=120)
    assert len(painting.strokes) == 120
    assert painting.metrics["psnr"] == pytest.approx(begun.metrics["psnr"], abs=0.3)
    torch.manual_seed(0)
    *_, strokes = predict(StrokePredictor("brushed"), torch.rand(3, 33, 47), 60)
    assert len(strokes) == 60
    check_strokes(strokes)


@pytest.fixture(scope="module")
def subjects() -> Subjects:
    return Subjects([load_picture("coffee", 160), load_picture("chelsea", 120)], 0)


def test_pictures_to_learn_from_are_decided_by_seed_and_number_and_batches_go_on_where_they_were_left(subjects):
    pictures = [subjects(number, 48) for number in range(6)]
    for number, picture in enumerate(pictures):
        assert picture.shape == (3, 48, 48)
        assert 0 <= picture.min() <= picture.max() <= 1
        assert torch.equal(picture, Subjects(subjects.photographs, 0)(number, 48))
    assert len({float(picture.sum()) for picture in pictures}) == 6
    assert not torch.equal(pictures[0], Subjects(subjects.photographs, 1)(0, 48))
    data = PredictorData(subjects, 2)
    whole, later = data._training(0, 0), data._training(0, 2)
    batches = [next(whole) for _ in range(3)]
    again = next(later)
    assert again.levels == batches[2].levels
    assert all(map(torch.equal, again.targets, batches[2].targets))
    assert {"coins", "retina"} <= set(load_subjects(None))
    refuses(r"data=\[\] has no picture", load_subjects, [])


@pytest.mark.slow
def test_it_learns(subjects: Subjects) -> None:
    torch.manual_seed(0)
    module = PredictorModule(StrokePredictor(width=16, blocks=2), 3e-3, 0)
    batch = PredictorData(subjects, 2).held_out(0)
    small = batch._replace(targets=[target[:, :64, :64] for target in batch.targets])
    optimizer = torch.optim.Adam(module.network.parameters(), 3e-3)

    def error() -> Tensor:
        *_, done = lay(module.network, module.network.form, small.targets, small.levels)
        return mean_of(log_error, done, small.targets)

    first = float(error().detach())
    for _ in range(12):
        optimizer.zero_grad()
        error().backward()
        optimizer.step()
    assert float(error().detach()) < first - 0.25  # 1 dB; measured: 2 dB after 15 steps


def test_steps_of_the_optimiser_lower_the_error() -> None:
    target = load_picture("coffee", 64)
    strokes = brushexp.create("init", "slic")(target, 60, torch.Generator())

    def error(steps: int) -> float:
        moved = refined(strokes, target, drawn, steps)
        return float((drawn(moved) - target).square().mean())

    def drawn(strokes: Strokes) -> Tensor:
        return draw(FORMS["plain"], strokes, (target.shape[1], target.shape[2]), target.mean((1, 2)))

    assert error(20) < 0.5 * error(0)


@pytest.mark.slow
def test_the_task_writes_weights_that_paint(run_task: Callable[..., dict[str, object]], tmp_path: Path) -> None:
    words = ("task=train", "model=predictor", "data=[coffee]", "batch_size=2", "trainer.max_steps=2", "minutes=null")
    metrics = run_task(train_task, *words)
    assert metrics["status"] == "completed"
    assert metrics["psnr_10"] > metrics["psnr_0"] > 0
    options = {"look": "plain", "init": "predicted", "init.checkpoint": str(tmp_path / "plain.safetensors")}
    painting = brushexp.paint(np.full((24, 24, 3), 99, np.uint8), strokes=9, steps=0, **options)
    assert len(painting.strokes) == 9


SIZE = (40, 60)
PLAIN, ANGLE = OF_PAINTINGS["colors"], OF_STROKES["direction"]


@pytest.fixture
def checkpoint(tmp_path) -> str:
    torch.manual_seed(3)
    PREDICTORS.save(tmp_path / f"{NAME}.safetensors", NAME, StrokePredictor(), {"options": {}})
    return str(tmp_path / f"{NAME}.safetensors")


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
    told = tell_at([level, Strokes.join(level, upright)], places)
    assert told["direction"][1, :3] == pytest.approx([90, 0, 90], abs=1e-3)
    assert told["length"][0, :2] == pytest.approx([40, 40])
    assert np.isnan(told["width"][:, 3]).all()


def test_places_are_the_middles_of_equal_cells_and_directions_across_the_turn_are_near_each_other():
    assert lattice((4, 6), 2.0)[:, :, 0].tolist() == [[1, 3, 5], [1, 3, 5]]
    assert lattice((4, 6), 2.0)[:, 0, 1].tolist() == [1, 3]
    assert lattice((1, 1), 5.0).shape == (1, 1, 2)
    doubt = doubt_of(np.array([[178.0], [2.0], [179.0], [1.0]]), axial=True)
    assert min(doubt.middle[0], 180 - doubt.middle[0]) == pytest.approx(0, abs=1e-9)
    assert doubt.spread[0] == pytest.approx(1.5)
    assert holds(np.array([179.5]), doubt, axial=True).all()
    assert not holds(np.array([90.0]), doubt, axial=True).any()
    assert away_from(np.array([1.0, 179.0, 90.0]), np.array([179.0, 1.0, 0.0]), axial=True).tolist() == [2, -2, -90]
    assert sample_task.texts_of("direction", Interval(30.0, -60.0, 120.0))["low"] == "any"
    assert sample_task.texts_of("direction", Interval(30.0, 20.0, 40.0))["low"] == "20"
    assert sample_task.texts_of("length", Interval(math.nan, math.nan, math.nan))["value"] == "–"


def test_two_samples_one_and_none_say_what_they_can_and_intervals_stay_where_there_are_values():
    doubt = doubt_of(np.array([[1.0, 5.0, np.nan], [3.0, np.nan, np.nan]]), axial=False)
    np.testing.assert_allclose(doubt.middle, [2, 5, np.nan])
    np.testing.assert_allclose(doubt.spread, [1, 0, np.nan])
    np.testing.assert_allclose([doubt.low[0], doubt.high[0]], [-0.9, 0.9])
    assert holds(np.array([2.5, 5.0, 1.0]), doubt, axial=False).tolist() == [True, True, False]
    assert np.isnan(doubt_of(np.full((2, 1), np.nan), axial=True).middle).all()
    doubt = Doubt(np.array([0.9]), np.array([0.2]), np.array([-0.1]), np.array([0.1]))
    share = conformal.Scaling(0.0, 1.0, 0.0, 2.0)(doubt, OF_PAINTINGS["coherence"])
    assert (share.middle + share.high)[0] == pytest.approx(1)
    assert share.low[0] == pytest.approx(-0.4)
    any_way = conformal.Scaling(0.0, 1.0, 0.0, 1000.0)(doubt, ANGLE)
    assert (any_way.low[0], any_way.high[0]) == (-90, 90)


@pytest.mark.parametrize("axial", [False, True])
def test_scaled_intervals_hold_nine_truths_of_ten_where_those_of_the_samples_do_not(axial):
    random = np.random.default_rng(0)
    kind = ANGLE if axial else OF_STROKES["width"]

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
    assert len(samples) == LEAST
    assert not torch.equal(samples[0].strokes.position, samples[1].strokes.position)


def test_intervals_are_read_as_written_and_refused_for_other_weights(tmp_path):
    one = conformal.Scaling(0.1, 0.9, 0.01, 3.0)
    scalings = {("strokes", "length"): one, ("paintings", "width"): replace(one, factor=2.0)}
    path, kinds = tmp_path / "a.json", list(scalings)
    conformal.write_scalings(path, scalings, {"hash": "abc"})
    assert conformal.read_scalings(path, {"hash": "abc"}, kinds) == scalings
    words = r"another hash than xyz; fit them with task=calibrate"
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
    assert set(data["measures"]) == set(OF_PAINTINGS)
    assert data["measures"]["width"]["low"] <= data["measures"]["width"]["value"] <= data["measures"]["width"]["high"]
    assert scaled["psnr"] == plain["psnr"] >= plain["psnr_worst"]
    with Image.open(tmp_path / "brushwork.png") as sheet:
        assert np.asarray(sheet).std() > 5
    refuses("another temperature", run_task, sample_task, "task=sample", *options, *picture, "temperature=2")
