"""The same painting in another photograph, smaller, turned, compressed, has the same figures: with shipped weights."""

import numpy as np
import pytest
from brushexp_recovery.measure import compare, draws_of, intervals_of, is_apart, sight
from brushexp_recovery.measure_views import View, views_of
from brushexp_recovery.model import load_model
from brushexp_recovery.recover import recover_with
from brushexp_recovery.synthesis import Hand, lay_strokes
from brushexp_recovery.synthesis_canvas import Mixing, compose
from brushexp_recovery.synthesis_looks import Look, draw_strokes

VIEWS, SMALLER, TURN = 3, 0.8, 2.0


def painting() -> np.ndarray:
    """Some 50 strokes of bristles, 14 pixels wide, on 208 x 240 px."""
    random = np.random.default_rng(6)
    rows, columns = np.mgrid[:208, :240] / 200
    picture = np.stack([0.5 + 0.4 * np.sin(4 * rows + 3 * columns + k) for k in range(3)], 2).astype(np.float32)
    laid = lay_strokes(picture, 50, Hand(), random)
    drawn = draw_strokes(laid, Look("renderer", "textured", {}), 0)
    image: np.ndarray = compose(drawn, laid, Mixing(4.0, np.ones(50), np.zeros(50)), np.full((208, 240, 3), 0.6)).image
    return image.astype(np.float32)


def measured(image: np.ndarray) -> np.ndarray:
    """Draws of the figures of a photograph, each stroke looked at once."""
    model = load_model()

    def recover(picture):
        return recover_with(model, np.asarray(picture, np.float32), None, 1, lambda *_: None)

    seen = [sight(image, view, recover) for view in views_of(VIEWS, 0)]
    return draws_of(seen, {"whole": np.ones(image.shape[:2], bool)}, 20, 0)["whole"]


def test_a_photograph_taken_anew_gives_the_same_figures():
    image = painting()
    one, other = measured(image), measured(View(zoom=SMALLER, turn=TURN, quality=85).of(image))
    scales = 1.0, 1 / SMALLER  # millimetres of a pixel
    figures = [intervals_of(draws, mm) for draws, mm in zip((one, other), scales, strict=True)]
    gaps = compare(one, other, scales, 0)
    for name in ("length", "width"):
        assert not is_apart(gaps[name])
        assert figures[1][name].value == pytest.approx(figures[0][name].value, rel=0.05)
    assert gaps["direction"].low < -TURN < gaps["direction"].high
    assert gaps["direction"].value == pytest.approx(-TURN, abs=2)
