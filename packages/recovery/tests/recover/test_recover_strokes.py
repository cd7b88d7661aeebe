"""Test that a small painting's strokes are recovered, that any picture is accepted, and that results are stored."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from brushexp_recovery.curves.fit import StrokeCurves
from brushexp_recovery.recover.pipeline import catalogue_of, recover, recover_with
from brushexp_recovery.recover.storage import Recovered, read_recovered, write_recovered
from recovery_scenes import bristles, f1_of, shipped, silent

from brushexp.errors import UserError
from brushexp.strokes.storage import load_catalogue, save_catalogue


@pytest.mark.parametrize("size", [(1, 1), (1200, 3), (40, 56)])
@pytest.mark.parametrize("kind", ["one colour", "grey noise"])
def test_any_picture_can_be_looked_at(size, kind):
    image = np.full((*size, 3), 0.3, np.float32)
    if kind == "grey noise":
        image[:] = np.random.default_rng(0).random((*size, 1))
    recovered = recover_with(shipped(), image, 1.0, 1, silent)
    assert recovered.labels.shape == size
    assert len(recovered.confidence) == len(recovered.saved.strokes)
    assert not (recovered.ground & (recovered.labels >= 0)).any()
    recovered.saved.check()


def test_most_strokes_of_a_small_painting_are_found_again():
    painting = bristles((176, 208), 5)
    recovered = recover(painting.image, copies=1)
    assert f1_of(recovered.labels, painting.labels.astype(int)) > 0.5


def some_strokes(n: int, random: np.random.Generator) -> Recovered:
    """Make recovered strokes at random."""
    labels = random.integers(-1, n, (20, 30)).astype(np.int32)
    fitted = StrokeCurves(random.random((n, 3, 2)) * 30, random.random(n) * 5 + 1, random.random((n, 3)))
    image = random.random((20, 30, 3)).astype(np.float32)
    return catalogue_of(labels, fitted, random.random(n), random.permutation(n), image)


@pytest.mark.parametrize("n", [0, 5])
def test_what_was_recovered_is_read_as_it_was_written(n, tmp_path):
    recovered = some_strokes(n, np.random.default_rng(n))
    write_recovered(tmp_path / "catalogue.h5", recovered)
    assert read_recovered(tmp_path / "catalogue.h5").ground is None
    recovered = replace(recovered, ground=recovered.labels < 0)
    write_recovered(tmp_path / "catalogue.h5", recovered)
    again = read_recovered(tmp_path / "catalogue.h5")
    np.testing.assert_array_equal(again.ground, recovered.ground)
    np.testing.assert_array_equal(again.labels, recovered.labels)
    np.testing.assert_array_equal(again.confidence, recovered.confidence)
    color = load_catalogue(tmp_path / "catalogue.h5").strokes.color
    torch.testing.assert_close(color, recovered.saved.strokes.color)


def test_a_painted_catalogue_is_not_one_that_was_recovered(tmp_path):
    save_catalogue(tmp_path / "catalogue.h5", some_strokes(3, np.random.default_rng(0)).saved)
    with pytest.raises(UserError, match=r"give the catalogue.h5 of task=recover"):
        read_recovered(tmp_path / "catalogue.h5")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"confidence": np.array([0.5, 1.5, 0.2], np.float32)}, "confidence is not between 0 and 1"),
        ({"labels": np.full((20, 30), 3, np.int32)}, "labels name strokes that do not exist"),
    ],
)
def test_a_catalogue_whose_labels_or_confidence_make_no_sense_is_refused(change, words, tmp_path):
    recovered = some_strokes(3, np.random.default_rng(0))
    write_recovered(tmp_path / "catalogue.h5", Recovered(**{**vars(recovered), **change}))
    with pytest.raises(UserError, match=words):
        read_recovered(tmp_path / "catalogue.h5")
