"""An ink drawing has single lines where they suffice, leaves a margin, and softens washes at soft forms."""

import numpy as np
import pytest
import torch
from brushexp_media.init.drawing import EDGE, LOST, contours
from brushexp_media.picture.lines import find_apart

from brushexp.errors import UserError
from brushexp.registry import build_named


def drawn(target, n=300, **options):
    strokes = build_named("init", "drawing", options)(target, n, torch.Generator().manual_seed(0))
    return strokes[strokes.opacity > 0]


def line(y):
    return np.array([[10.0, y], [30.0, y], [50.0, y]])


def test_lines_beside_others_are_left_out():
    curves = np.stack([line(20.0), line(21.0), line(30.0), line(20.0) + np.array([30, 0])])
    assert find_apart(curves, (60, 90), 3.0).tolist() == [0, 2, 3]
    assert find_apart(curves[:0], (60, 90), 3.0).tolist() == []


def test_an_outline_is_drawn_once():
    picture = np.full((3, 90, 120), 0.9)
    picture[:, 45:] = 0.1
    strokes = contours(picture, 400, 20.0, 2.0, np.zeros(3))
    assert len(strokes) == 400
    length = (strokes.end - strokes.start).norm(dim=1) * strokes.scale / 2
    assert 100 < float(length[strokes.opacity > 0].sum()) < 300


def test_what_is_out_of_focus_has_no_contour():
    picture = np.full((3, 96, 240), 0.9)
    picture[:, :, 60:64] = picture[:, 24:72, 24:26] = 0.1
    slope = ((np.arange(240) - 130) / 80).clip(0, 1)  # a blurred edge, as dark as the sharp ones
    picture = picture - 0.85 * slope
    strokes = contours(picture.clip(0, 1), 400, 20.0, 2.0, np.zeros(3))
    across = strokes.position[strokes.opacity > 0, 0]
    assert int((across < 100).sum()) > 5
    assert not (across > 120).any()


def test_a_drawing_leaves_a_margin():
    places = drawn(torch.zeros(3, 90, 120), contours=0.0).position
    assert float(places.min()) > 1
    assert float((torch.tensor([120.0, 90.0]) - places).min()) > 1


@pytest.mark.parametrize(("soft", "expected"), [(0, EDGE), (40, EDGE + LOST)])
def test_washes_end_crisply_at_edges_and_are_lost_in_soft_forms(soft, expected):
    x = torch.arange(400) - 200.0
    dark = 0.5 + 0.3 * (x.sign() if not soft else torch.tanh(x / (10 * soft)))
    tones = (0.55, 0.98, 0.99)
    strokes = drawn((1 - dark).expand(3, 200, 400).contiguous(), contours=0.0, washes=1.0, wash_tones=tones)
    inside = ((strokes.position - torch.tensor([280.0, 100.0])).abs() < 50).all(1)  # nearer to this edge than to others
    softness = (strokes.softness / strokes.width)[inside]
    assert float(softness.median()) == pytest.approx(expected, abs=0.12)


@pytest.mark.parametrize("option", ["tones", "wash_tones"])
def test_two_tones_are_refused_in_words(option):
    with pytest.raises(UserError, match=rf"init\.{option}=\[0\.4, 0\.7\] are 2 values; give three"):
        build_named("init", "drawing", {option: (0.4, 0.7)})
