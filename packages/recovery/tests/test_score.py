"""Scores of small scenes that were computed by hand, files of anybody's strokes, and a round trip of the truth."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from brushexp_recovery.calibration import auc_of, calibration_of, join_reliability
from brushexp_recovery.given import Given, given_catalogue, given_labels, read_given
from brushexp_recovery.outlines import lengths_of, part_of
from brushexp_recovery.score import score
from brushexp_recovery.truth import Truth, drawn_truth, painted_part, read_truth, write_truth
from PIL import Image

from brushexp.errors import UserError
from brushexp.strokes.bezier import strokes_along
from brushexp.strokes.storage import Saved, save_catalogue

SIZE = (40, 60)


def line(start, end) -> np.ndarray:
    start, end = np.array(start, float), np.array(end, float)
    return np.stack([start, 0.5 * (start + end), end])


def scene() -> tuple[Truth, np.ndarray]:
    """Four level strokes, of which the bottom one is hidden but for a little."""
    curve = np.stack(
        [line((10, 10), (50, 10)), line((20, 20), (40, 20)), line((10, 30), (50, 30)), line((20, 19), (40, 19))]
    )
    color = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]], float)
    order = [1, 0, 2, 3]
    return drawn_truth(curve[order], np.array([6.0, 6, 6, 6]), color[order], SIZE, np.ones(3))


def as_given(truth: Truth, **changes) -> Given:
    given = Given(truth.labels, truth.curve, truth.width, truth.seen, truth.area)
    return replace(given, **changes)


def test_the_truth_itself_has_no_errors():
    truth, image = scene()
    assert truth.counts.tolist() == [False, True, True, True]
    assert truth.pairs.tolist() == [[0, 3]]
    assert truth.share[1:] == pytest.approx([1, 1, 1])
    np.testing.assert_allclose(image[10, 30], [1, 0, 0])
    figures = score(truth, as_given(truth, confidence=np.full(4, 0.9)))
    perfect = {"f1": 1, "recall": 1, "precision": 1, "best_iou": 1, "iou": 1, "split": 1, "joined": 1, "truth": 3}
    errors = dict.fromkeys(("direction_deg", "length_rel", "width_rel", "color_de00", "field_direction_deg"), 0)
    for name, value in (perfect | errors).items():
        assert figures[name] == pytest.approx(value, abs=1e-6), name
    assert figures["predicted"] == 3
    assert figures["reliability"] == [(pytest.approx(0.9), 1, 3)]


def test_halves_joins_misses_and_strokes_on_the_ground_count_as_they_should():
    labels = np.full((20, 40), -1, np.int32)
    labels[2:6, 2:38], labels[8:12, 2:38], labels[14:18, 2:20] = 0, 1, 2
    curve = np.stack([line((4, 4), (36, 4)), line((4, 10), (36, 10)), line((4, 16), (18, 16))])
    counts = dict(color=np.zeros((3, 3)), seen=np.zeros((3, 3)), depth=np.arange(3), share=np.ones(3))
    truth = Truth(labels, curve, np.full(3, 4.0), area=np.array([144.0, 144, 72]), pairs=np.array([[0, 1]]), **counts)
    found = np.full_like(labels, -1)
    found[2:6, 2:12] = 0  # 40 of 144: an intersection over union of 0.28
    found[2:6, 12:38] = 1  # 104 of 144: 0.72, a match
    found[8:12, 2:38], found[14:18, 2:20] = 2, 2  # 144 of 216: 0.67, a match
    found[18:20, 20:40] = 3  # 40 pixels on bare ground: not asked
    found[14:18, 20:23] = 4  # 12 pixels on bare ground
    given = replace(given_labels(found), confidence=np.array([0.2, 0.9, 0.8, 0.1, 0.1]))
    figures = score(truth, given)
    assert (figures["truth"], figures["predicted"]) == (3, 5)
    assert figures["recall"] == pytest.approx(2 / 3)
    assert figures["precision"] == pytest.approx(2 / 3)  # of strokes 0, 1 and 2
    assert figures["f1"] == pytest.approx(2 / 3)
    assert figures["iou"] == pytest.approx((104 / 144 + 144 / 216) / 2)
    assert figures["best_iou"] == pytest.approx((104 / 144 + 144 / 216 + 72 / 216) / 3)
    assert figures["recall_soft"] == pytest.approx(2 / 3)
    assert figures["split"] == pytest.approx(1)  # of 1.67, 1 and 1
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
    figures = score(truth, as_given(truth, curve=turned, width=1.2 * truth.width, color=0.9 * truth.seen))
    assert figures["direction_deg"] == pytest.approx(5)
    assert figures["width_rel"] == figures["width_bias"] == pytest.approx(0.2)
    assert figures["length_rel"] == pytest.approx(np.median(1.2 / (lengths_of(truth.curve[1:]) + 6)), abs=1e-6)
    assert figures["color_de00"] > 1
    assert figures["field_direction_deg"] == pytest.approx(5, abs=1e-6)
    assert figures["field_width_rel"] == pytest.approx(0.2)


@pytest.mark.parametrize(("order", "tau", "agreement"), [([0, 1], 1, 1), ([1, 0], -1, 0)])
def test_the_order_of_strokes_that_cross_is_compared(order, tau, agreement):
    curve = np.stack([line((10, 20), (50, 20)), line((30, 4), (30, 36))])
    truth, _ = drawn_truth(curve, np.full(2, 6.0), np.eye(3)[:2], SIZE, np.ones(3))
    labels = np.where(truth.labels >= 0, np.argsort(order)[truth.labels], -1)
    given = Given(labels, curve[order], np.full(2, 6.0), truth.seen[order], truth.area[order])
    figures = score(truth, given)
    assert (figures["f1"], figures["order_tau"], figures["order_pairs"]) == (1, tau, 1)
    assert figures["order_agreement"] == agreement


def test_nothing_found_and_nothing_to_find_have_figures():
    truth, image = scene()
    nothing = given_labels(np.full(SIZE, -1), image)
    figures = score(truth, nothing)
    assert (figures["f1"], figures["predicted"]) == (0, 0)
    bare, _ = drawn_truth(np.zeros((0, 3, 2)), np.zeros(0), np.zeros((0, 3)), SIZE, np.ones(3))
    assert score(bare, as_given(truth))["f1"] == 0


def test_a_confidence_is_compared_with_what_is_right():
    hit = np.array([True, False, True, True])
    figures = calibration_of(np.array([0.95, 0.15, 0.55, 0.55]), hit)
    assert figures["reliability"] == [(pytest.approx(0.15), 0, 1), (pytest.approx(0.55), 1, 2), (0.95, 1, 1)]
    assert figures["ece"] == pytest.approx((0.15 + 2 * 0.45 + 0.05) / 4)
    assert figures["auc"] == 1
    assert auc_of(np.array([0.5, 0.7]), np.array([0.5])) == pytest.approx(0.75)
    joined = join_reliability([figures["reliability"], [(0.51, 0.0, 2)]])
    assert joined[1] == (pytest.approx(0.53), pytest.approx(0.5), 4)


def test_curves_are_cut_to_their_paint():
    curve = line((0, 0), (10, 0))[None]
    np.testing.assert_allclose(part_of(curve, np.array([0.2]), np.array([0.7])), line((2, 0), (7, 0))[None])
    cut, width = painted_part(
        line((0, 0), (100, 0))[None], np.array([0.1]), np.array([0.6]), np.array([50 * 8 - 0.215 * 64])
    )
    assert width == pytest.approx(8, rel=0.01)
    assert lengths_of(cut) == pytest.approx(50 - 0.9 * width)


def test_anybodys_files_are_read(tmp_path):
    truth, image = scene()
    write_truth(tmp_path / "truth.npz", truth)
    again = read_truth(tmp_path / "truth.npz")
    np.testing.assert_array_equal(again.labels, truth.labels)
    np.save(tmp_path / "a.npy", truth.labels)
    Image.fromarray((truth.labels + 1).astype(np.uint8)).save(tmp_path / "a.png")
    colors = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9], [9, 9, 9]], np.uint8)
    Image.fromarray(colors[truth.labels + 1]).save(tmp_path / "b.png")
    np.savez(tmp_path / "c.npz", curve=truth.curve, width=truth.width, confidence=np.ones(4))
    np.savez(tmp_path / "d.npz", labels=truth.labels)
    strokes = strokes_along(
        *(torch.tensor(x, dtype=torch.float32) for x in (truth.curve, truth.width, truth.color)), 1.0
    )
    depth = torch.arange(4, dtype=torch.int32)
    half = Saved(strokes.moved(zoom=0.5), depth, (20, 30), torch.ones(3), "analytic")
    save_catalogue(tmp_path / "catalogue.h5", half)
    for name in ("a.npy", "a.png", "b.png", "c.npz", "d.npz", "catalogue.h5", "truth.npz"):
        figures = score(truth, read_given(tmp_path / name, SIZE, image))
        assert figures["f1"] == 1, name
        assert figures["color_de00"] < (100 if name == "c.npz" else 8), name
    assert given_catalogue(half, SIZE).curve == pytest.approx(truth.curve, abs=1e-4)


def test_files_that_will_not_do_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((3, 3), int))
    np.savez(tmp_path / "b.npz", color=np.zeros(3))
    np.savez(tmp_path / "c.npz", labels=np.full(SIZE, 3), curve=np.zeros((1, 3, 2)), width=np.ones(1))
    (tmp_path / "d.png").write_bytes(b"no picture")
    for name, words in {
        "a.npy": r"whole numbers of shape \(40, 60\)", "b.npz": "neither labels nor curve",
        "c.npz": "number them from 0", "d.png": "cannot be read", "e.txt": "give labels as .png",
        "f.npz": "there is no file",
    }.items():  # fmt: skip
        with pytest.raises(UserError, match=words):
            read_given(tmp_path / name, SIZE)
    with pytest.raises(UserError, match="has no labels"):
        read_truth(tmp_path / "b.npz")
