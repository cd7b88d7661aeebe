"""Test that recovery errors are fitted, that they correct measures, and that intervals cover true values."""

import numpy as np
import pytest
from brushexp_recovery.measure.intervals import intervals_of
from brushexp_recovery.measure.measures import MEASURES
from brushexp_recovery.measure.recovery_error import FILE, SAMPLES, log_odds, move, read_errors
from brushexp_recovery.model.recovery_model import CHECKPOINTS, SHIPPED_WEIGHTS
from brushexp_recovery.train.errors_of_measures import error_between, fit_error, fit_errors, write_errors

KINDS = ("dry", "wet", "thick", "thin", "flat", "round")


def known_paintings(count, seed):
    """Simulate true and measured values whose errors are larger at low confidence and differ between kinds."""
    random = np.random.default_rng(seed)
    names = [f"{KINDS[number % len(KINDS)]}-{number}" for number in range(count)]
    confidence = random.uniform(0.3, 0.9, count)
    of_kind = dict(zip(KINDS, 0.15 * np.random.default_rng(5).normal(size=len(KINDS)), strict=True))
    true, measured = {}, {}
    for name, measure in MEASURES.items():
        error = np.array([of_kind[painting.rpartition("-")[0]] for painting in names])
        error = error + 0.6 - 0.2 * log_odds(confidence) + 0.1 * random.normal(size=count)
        if measure.axial:
            error = 10 * random.normal(size=count)
        measured[name] = random.uniform(0.2, 0.7, count) if measure.share else random.uniform(20, 80, count)
        true[name] = move(measured[name], error, measure)
    return true, measured, confidence, names


def holds(interval, true, measure):
    if measure.axial:
        true = interval.value + (true - interval.value + 90) % 180 - 90
    return interval.low <= true <= interval.high


def test_intervals_hold_the_truth_of_new_paintings_only_with_the_errors():
    errors = fit_errors(*known_paintings(60, 0), "hash")
    true, measured, confidence, names = known_paintings(60, 1)
    random, corrected_holds, found_holds = np.random.default_rng(2), [], []
    for place in range(len(names)):
        draws = {name: values[place] * (1 + 0.01 * random.normal(size=(3, 20))) for name, values in measured.items()}
        corrected = errors.correct(draws, np.full(7, confidence[place]))
        figures, found = intervals_of(draws, None, corrected), intervals_of(draws)
        for name, measure in MEASURES.items():
            corrected_holds.append(holds(figures[name], true[name][place] * measure.factor(None), measure))
            found_holds.append(holds(found[name], true[name][place] * measure.factor(None), measure))
            assert figures[name].found == pytest.approx(found[name].value)
            assert figures[name].over_views == pytest.approx(found[name].over_views)
    assert 0.87 < np.mean(corrected_holds) < 0.95
    assert np.mean(found_holds) < 0.3


@pytest.mark.parametrize("name", ["length", "covered", "direction", "strokes"])
def test_a_figure_moved_by_its_error_is_the_true_one(name):
    true, measured = np.array([0.3, 0.9, 0.5]), np.array([0.6, 0.2, 0.5])
    if not MEASURES[name].share:
        true, measured = 190 * true, 190 * measured
    error = error_between(true, measured, MEASURES[name])
    moved = move(measured, error, MEASURES[name])
    assert (moved if name != "direction" else moved % 180) == pytest.approx(true % 180 if name == "direction" else true)


def test_directions_err_across_the_turn():
    assert error_between(np.array([2.0]), np.array([178.0]), MEASURES["direction"]) == pytest.approx([4])
    assert move(np.array([178.0]), np.array([4.0]), MEASURES["direction"]) == pytest.approx([2])


def test_ends_and_missing_figures_stay():
    errors = fit_errors(*known_paintings(12, 0), "hash")
    draws = {name: np.array([[0.0, np.nan]]) for name in MEASURES} | {"covered": np.array([[0.0, 1.0]])}
    draws["elongatedness"] = np.array([[2.0, np.nan]])
    corrected = errors.correct(draws, np.array([0.5]))
    assert corrected["strokes"][0, :SAMPLES].tolist() == [0] * SAMPLES
    assert np.isnan(corrected["length"][0, SAMPLES:]).all()
    assert set(corrected["covered"][0]) == {0.0, 1.0}
    assert errors.correct(draws, np.empty(0)) is draws, "no strokes were found"


def test_the_rest_of_a_kind_is_told_by_other_kinds():
    """The residuals of one kind of painting are computed from a fit to the other kinds."""
    error, kinds = np.repeat([0.0, 0.0, 1.0], 4), np.repeat(["a", "b", "c"], 4)
    predictors = np.tile([[0.0, 1.0], [1.0, 1.0], [0.0, 3.0], [1.0, 3.0]], (3, 1))
    fitted = fit_error(error, predictors, kinds, MEASURES["length"])
    assert fitted.rest == pytest.approx(np.repeat([-0.5, -0.5, 1.0], 4))
    assert fitted.mean == pytest.approx(1 / 3)
    assert fitted.slopes == pytest.approx([0, 0], abs=1e-9)


def test_predictors_beyond_the_known_ones_count_as_the_nearest():
    true, measured, confidence, names = known_paintings(24, 0)
    errors = fit_errors(true, measured, confidence, names, "hash")
    draws = {name: np.full((1, 1), values[0]) for name, values in measured.items()}
    least, less = (errors.correct(draws, np.array([share])) for share in (confidence.min(), 0.05))
    assert less["length"] == pytest.approx(least["length"])
    more = errors.correct(draws, np.array([confidence.max()]))
    assert np.median(more["length"]) < 0.9 * np.median(least["length"]), "recovery loses less of what it is sure of"


def test_errors_come_back_from_their_file(tmp_path):
    errors = fit_errors(*known_paintings(12, 0), "hash")
    write_errors(tmp_path / "errors.json", errors)
    again = read_errors(tmp_path / "errors.json")
    assert (again.weights, again.paintings) == (errors.weights, errors.paintings)
    for name, one in errors.errors.items():
        assert again.errors[name].rest == pytest.approx(one.rest, abs=1e-4)
        assert again.errors[name].mean == pytest.approx(one.mean, abs=1e-4)
        assert again.errors[name].slopes == pytest.approx(one.slopes, abs=1e-4)
    assert again.predictors == pytest.approx(errors.predictors, abs=1e-4)


def test_the_shipped_errors_belong_to_the_shipped_weights():
    errors = read_errors(FILE)
    assert errors.weights == CHECKPOINTS.read_recipe(CHECKPOINTS.path_of(SHIPPED_WEIGHTS))["hash"]
    assert set(errors.errors) == set(MEASURES)
    assert {len(one.rest) for one in errors.errors.values()} == {len(errors.paintings)}
