"""Test that the shipped weights give the same measures for a smaller, rotated and compressed photograph."""

import numpy as np
import pytest
from brushexp_recovery.measure.areas import WHOLE, areas_of
from brushexp_recovery.measure.draws import Draws, draw_figures, sight
from brushexp_recovery.measure.intervals import difference_of, intervals_of, is_apart
from brushexp_recovery.measure.views import View, choose_views
from brushexp_recovery.recover.pipeline import recover_with
from brushexp_recovery.recover.storage import Recovered
from recovery_scenes import bristles, picture_of, shipped, silent

VIEWS, SMALLER, TURN = 3, 0.8, 2.0


def recover(picture: np.ndarray) -> Recovered:
    """Recover strokes with one copy in each look."""
    return recover_with(shipped(), np.asarray(picture, np.float32), None, 1, silent)


def draws_of(image: np.ndarray) -> Draws:
    sightings = [sight(image, view, recover) for view in choose_views(VIEWS, 0)]
    return draw_figures(sightings, areas_of(None, image.shape[:2]), 20, 0)[WHOLE]


def test_a_photograph_taken_anew_gives_the_same_figures():
    image = picture_of(bristles((208, 240), 6))  # strokes of 14 pixels
    one, other = draws_of(image), draws_of(View(zoom=SMALLER, turn=TURN, quality=85).of(image))
    scales = 1.0, 1 / SMALLER  # millimetres per pixel
    figures, figures_again = (intervals_of(draws, mm) for draws, mm in zip((one, other), scales, strict=True))
    gaps = difference_of(one, other, scales, 0)
    for name in ("length", "width"):
        assert not is_apart(gaps[name])
        assert figures_again[name].value == pytest.approx(figures[name].value, rel=0.1)
    assert gaps["direction"].low < -TURN < gaps["direction"].high
    assert gaps["direction"].value == pytest.approx(-TURN, abs=2)
