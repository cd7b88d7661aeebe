"""Test that the scores for small scenes agree with hand calculations, and that files of strokes and truth are read."""

from dataclasses import replace

import numpy as np
import pytest
from brushexp_recovery.benchmark.prediction import Prediction, prediction_from_catalogue, prediction_from_labels
from brushexp_recovery.benchmark.prediction_files import read_prediction
from brushexp_recovery.benchmark.score import score
from brushexp_recovery.benchmark.truth import Truth, draw_truth, read_truth, write_truth
from brushexp_recovery.curves.bezier import arc_lengths
from brushexp_recovery.raster.npz import read_npz, write_npz
from PIL import Image
from recovery_scenes import saved_strokes, straight

from brushexp.errors import UserError
from brushexp.strokes.storage import save_catalogue

SIZE = (40, 60)


def scene() -> tuple[Truth, np.ndarray]:
    """Draw four horizontal strokes; the bottom one is almost completely hidden."""
    curve = straight(((10, 10), (50, 10)), ((20, 20), (40, 20)), ((10, 30), (50, 30)), ((20, 19), (40, 19)))
    color = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]], float)
    order = [1, 0, 2, 3]
    return draw_truth(curve[order], np.array([6.0, 6, 6, 6]), color[order], SIZE, np.ones(3))


def spell_paths(truth: Truth, **changes) -> Prediction:
    """Make a prediction that consists of the known strokes with the given changes."""
    found = Prediction(truth.labels, truth.curve, truth.width, truth.seen, truth.area)
    return replace(found, **changes)


def test_the_truth_itself_has_no_errors():
    truth, image = scene()
    assert truth.counts.tolist() == [False, True, True, True]
    assert truth.pairs.tolist() == [[0, 3]]
    assert truth.share[1:] == pytest.approx([1, 1, 1])
    np.testing.assert_allclose(image[10, 30], [1, 0, 0])
    figures = score(truth, spell_paths(truth, confidence=np.full(4, 0.9)))
    perfect = {"f1": 1, "recall": 1, "precision": 1, "best_iou": 1, "iou": 1, "split": 1, "joined": 1, "truth": 3}
    errors = dict.fromkeys(("direction_deg", "length_rel", "width_rel", "color_de00", "field_direction_deg"), 0)
    for name, value in (perfect | errors).items():
        assert figures[name] == pytest.approx(value, abs=1e-6), name
    assert figures["predicted"] == 3
    assert figures["reliability"] == [(pytest.approx(0.9), 1, 3)]


def test_halves_joins_misses_and_strokes_on_the_ground_count_as_they_should():
    labels = np.full((20, 40), -1, np.int32)
    labels[2:6, 2:38], labels[8:12, 2:38], labels[14:18, 2:20] = 0, 1, 2
    curve = straight(((4, 4), (36, 4)), ((4, 10), (36, 10)), ((4, 16), (18, 16)))
    counts = dict(color=np.zeros((3, 3)), seen=np.zeros((3, 3)), depth=np.arange(3), share=np.ones(3))
    truth = Truth(labels, curve, np.full(3, 4.0), area=np.array([144.0, 144, 72]), pairs=np.array([[0, 1]]), **counts)
    found = np.full_like(labels, -1)
    found[2:6, 2:12] = 0  # 40 of 144: an intersection over union of 0.28
    found[2:6, 12:38] = 1  # 104 of 144: 0.72, a match
    found[8:12, 2:38], found[14:18, 2:20] = 2, 2  # 144 of 216: 0.67, a match
    found[18:20, 20:40] = 3  # 40 pixels on bare ground: not judged
    found[14:18, 20:23] = 4  # 12 pixels on bare ground
    confidence = np.array([0.2, 0.9, 0.8, 0.1, 0.1])
    figures = score(truth, replace(prediction_from_labels(found), confidence=confidence))
    assert (figures["truth"], figures["predicted"]) == (3, 5)
    assert figures["recall"] == pytest.approx(2 / 3)
    assert figures["precision"] == pytest.approx(2 / 3)  # of the strokes 0, 1 and 2
    assert figures["f1"] == pytest.approx(2 / 3)
    assert figures["iou"] == pytest.approx((104 / 144 + 144 / 216) / 2)
    assert figures["best_iou"] == pytest.approx((104 / 144 + 144 / 216 + 72 / 216) / 3)
    assert figures["recall_soft"] == pytest.approx(2 / 3)
    assert figures["split"] == pytest.approx(1)  # median of 1.67, 1 and 1
    assert figures["joined"] == pytest.approx(1)
    assert np.isnan(figures["order_tau"])  # labels have no order
    assert figures["auc"] == 1
    assert np.isnan(figures["recall_little"])


def test_errors_are_measured_in_degrees_shares_and_ciede2000():
    truth, _ = scene()
    turned = truth.curve.copy()
    angle = np.radians(5)
    for k in range(4):
        middle = turned[k, 1]
        turned[k] = middle + (turned[k] - middle) @ np.array(
            [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
        )
    figures = score(truth, spell_paths(truth, curve=turned, width=1.2 * truth.width, color=0.9 * truth.seen))
    assert figures["direction_deg"] == pytest.approx(5)
    assert figures["width_rel"] == figures["width_bias"] == pytest.approx(0.2)
    assert figures["length_rel"] == pytest.approx(np.median(1.2 / (arc_lengths(truth.curve[1:]) + 6)), abs=1e-6)
    assert figures["color_de00"] > 1
    assert figures["field_direction_deg"] == pytest.approx(5, abs=1e-6)
    assert figures["field_width_rel"] == pytest.approx(0.2)


@pytest.mark.parametrize(("order", "tau", "agreement"), [([0, 1], 1, 1), ([1, 0], -1, 0)])
def test_the_order_of_strokes_that_cross_is_compared(order, tau, agreement):
    curve = straight(((10, 20), (50, 20)), ((30, 4), (30, 36)))
    truth, _ = draw_truth(curve, np.full(2, 6.0), np.eye(3)[:2], SIZE, np.ones(3))
    labels = np.where(truth.labels >= 0, np.argsort(order)[truth.labels], -1)
    found = Prediction(labels, curve[order], np.full(2, 6.0), truth.seen[order], truth.area[order])
    figures = score(truth, found)
    assert (figures["f1"], figures["order_tau"], figures["order_pairs"]) == (1, tau, 1)
    assert figures["order_agreement"] == agreement


def test_nothing_found_and_nothing_to_find_have_figures():
    truth, image = scene()
    nothing = prediction_from_labels(np.full(SIZE, -1), image)
    figures = score(truth, nothing)
    assert (figures["f1"], figures["predicted"]) == (0, 0)
    bare, _ = draw_truth(np.zeros((0, 3, 2)), np.zeros(0), np.zeros((0, 3)), SIZE, np.ones(3))
    assert score(bare, spell_paths(truth))["f1"] == 0


WRITERS = {
    "a.npy": lambda path, truth: np.save(path, truth.labels),
    "a.png": lambda path, truth: Image.fromarray((truth.labels + 1).astype(np.uint8)).save(path),
    "b.png": lambda path, truth: Image.fromarray(COLORS[truth.labels + 1]).save(path),
    "c.npz": lambda path, truth: np.savez(path, curve=truth.curve, width=truth.width, confidence=np.ones(4)),
    "d.npz": lambda path, truth: np.savez(path, labels=truth.labels),
    "catalogue.h5": lambda path, truth: save_catalogue(path, half_size(truth)),
    "truth.npz": write_truth,
}
COLORS = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9], [9, 9, 9]], np.uint8)


def half_size(truth: Truth):
    """Make a catalogue of the known strokes on a canvas of half the width and height."""
    return saved_strokes(0.5 * truth.curve, 0.5 * truth.width, truth.color, (20, 30))


@pytest.mark.parametrize("name", WRITERS)
def test_anybodys_files_are_read(name, tmp_path):
    truth, image = scene()
    WRITERS[name](tmp_path / name, truth)
    figures = score(truth, read_prediction(tmp_path / name, SIZE, image))
    assert figures["f1"] == 1
    assert figures["color_de00"] < (100 if name == "c.npz" else 8)  # strokes in c.npz are grey


def test_strokes_of_a_catalogue_are_enlarged_to_the_canvas():
    truth, _ = scene()
    assert prediction_from_catalogue(half_size(truth), SIZE).curve == pytest.approx(truth.curve, abs=1e-4)


def test_a_truth_is_read_as_it_was_written(tmp_path):
    truth, _ = scene()
    write_truth(tmp_path / "truth.npz", truth)
    again = read_truth(tmp_path / "truth.npz")
    for name, value in vars(truth).items():
        np.testing.assert_array_equal(getattr(again, name), value, name)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"area": np.zeros(3)}, r"area has shape \(3,\); \(4,\) is needed"),
        ({"labels": np.full(SIZE, 4)}, "labels must be a picture of numbers from -1 to 3"),
        ({"labels": None}, "has no labels; give the npz of a truth"),
    ],
)
def test_a_truth_that_makes_no_sense_is_refused(change, words, tmp_path):
    truth, _ = scene()
    write_truth(tmp_path / "truth.npz", truth)
    values = {**read_npz(tmp_path / "truth.npz"), **change}
    write_npz(tmp_path / "truth.npz", **{name: value for name, value in values.items() if value is not None})
    with pytest.raises(UserError, match=words):
        read_truth(tmp_path / "truth.npz")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a.npy", r"whole numbers of shape \(40, 60\)"),
        ("b.npz", "neither labels nor curve"),
        ("c.npz", "number them from 0"),
        ("d.png", "is damaged, or not a picture; get it again"),
        ("d.npy", "not an npy of plain numbers"),
        ("d.npz", "not an npz of plain numbers"),
        ("e.txt", "give labels as .png"),
        ("f.npz", "there is no file"),
    ],
)
def test_files_that_will_not_do_are_refused(name, words, tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((3, 3), int))
    np.savez(tmp_path / "b.npz", color=np.zeros(3))
    np.savez(tmp_path / "c.npz", labels=np.full(SIZE, 3), curve=np.zeros((1, 3, 2)), width=np.ones(1))
    for suffix in (".png", ".npy", ".npz"):
        (tmp_path / "d").with_suffix(suffix).write_bytes(b"no strokes")
    with pytest.raises(UserError, match=words):
        read_prediction(tmp_path / name, SIZE)
