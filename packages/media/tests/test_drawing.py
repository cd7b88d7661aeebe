"""Test that ink drawings use single lines where they suffice, leave a margin, and have washes under the lines."""

import numpy as np
import pytest
import torch
from brushexp_media.init.contours import contours
from brushexp_media.init.drawing import dark_features
from brushexp_media.init.hatching import forms, hatching, rows_drawn
from brushexp_media.marks import PEN
from brushexp_media.picture.lines import find_apart
from brushexp_media.picture.outlines import find_outlines, strokes_over
from torch.testing import assert_close

import brushexp
from brushexp.errors import UserError
from brushexp.plugins.order.base import front_to_back
from brushexp.registry import build_named
from brushexp.strokes.bezier import curve_of, length_of
from brushexp.strokes.catalogue import Strokes


def drawn(target, n=300, focus=None, **options):
    strokes = build_named("init", "drawing", options)(target, n, torch.Generator().manual_seed(0), focus)
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
    strokes = contours(picture, picture.mean(0), 400, 20.0, 2.0, np.zeros(3))
    assert len(strokes) == 400
    length = (strokes.end - strokes.start).norm(dim=1) * strokes.scale / 2
    assert 100 < float(length[strokes.opacity > 0].sum()) < 300


def test_what_is_out_of_focus_has_no_contour():
    picture = np.full((3, 96, 240), 0.9)
    picture[:, :, 60:64] = picture[:, 24:72, 24:26] = 0.1
    slope = ((np.arange(240) - 130) / 80).clip(0, 1)  # a blurred edge, as dark as the sharp ones
    picture = picture - 0.85 * slope
    strokes = contours(picture.clip(0, 1), picture.clip(0, 1).mean(0), 400, 20.0, 2.0, np.zeros(3))
    across = strokes.position[strokes.opacity > 0, 0]
    assert int((across < 100).sum()) > 5
    assert not (across > 120).any()


def test_a_drawing_leaves_a_margin():
    places = drawn(torch.zeros(3, 90, 120), washes=0.0, contours=0.0).position
    assert float(places.min()) > 1
    assert float((torch.tensor([120.0, 90.0]) - places).min()) > 1


def test_washes_lie_under_the_lines_and_have_the_colours_of_the_picture():
    target = torch.ones(3, 90, 120)
    target[:, :, 60:] = torch.tensor([0.6, 0.4, 0.2])[:, None, None]
    strokes = build_named("init", "drawing", {"washes": 0.5, "color": "#102030"})(
        target, 300, torch.Generator().manual_seed(0)
    )
    is_line = strokes.brush >= PEN
    assert is_line.tolist() == [False] * 150 + [True] * 150
    lines, washes = strokes[is_line & (strokes.opacity > 0)], strokes[~is_line]
    assert torch.allclose(lines.color, torch.tensor([0x10, 0x20, 0x30]) / 255)
    assert bool((lines.position[:, 0] > 55).all()), "white paper has no lines"
    inside = (washes.position[:, 0] > 90) & (washes.opacity > 0)
    assert_close(washes.color[inside].mean(0), torch.tensor([0.6, 0.4, 0.2]), atol=0.1, rtol=0)


def test_steps_move_washes_and_leave_the_lines_of_a_pen():
    picture = torch.rand(3, 40, 60, generator=torch.Generator().manual_seed(1))
    first, last = (brushexp.paint(picture, look="ink", steps=steps, strokes=80, frames=0).strokes for steps in (1, 12))
    lines = [{int(one.brush): one for one in strokes if one.brush >= PEN} for strokes in (first, last)]
    assert len(lines[0].keys() & lines[1].keys()) > 20
    for number in lines[0].keys() & lines[1].keys():
        for name, value in lines[0][number].items():
            assert_close(getattr(lines[1][number], name), value, rtol=0, atol=1e-4, msg=name)
    washes = [strokes[strokes.brush < PEN] for strokes in (first, last)]
    assert not torch.equal(washes[0].width, washes[1].width)


def test_lines_lie_on_all_washes_even_if_these_come_later():
    strokes = drawn(torch.zeros(3, 90, 120), 40)
    strokes = Strokes.join(strokes, strokes)
    depth = build_named("order", "lines", {}).depth(strokes, None)
    top_down = front_to_back(depth)
    is_line = (strokes.brush >= PEN)[top_down]
    assert 0 < int(is_line.sum()) < len(strokes)
    assert bool(is_line[: int(is_line.sum())].all())
    washes = top_down[~is_line]
    assert torch.equal(washes, washes.sort(descending=True).values)


def test_hatching_begins_with_every_fourth_row_and_gets_denser_where_it_is_darker():
    def rows(darkness):
        dark, turned = np.full((200, 200), darkness), np.zeros((200, 200))
        lines = hatching(dark, 0.5, 0.0, turned, 4.0, 80, np.random.default_rng(0))
        return len(np.unique((lines[:, 1, 1] / 4.0).round()))

    assert 8 < rows(0.51) < 0.5 * rows(0.95)
    assert rows_drawn(np.full((10, 10), 0.9), 0.5) > rows_drawn(np.full((10, 10), 0.55), 0.5) > 0
    assert rows_drawn(np.full((10, 10), 0.4), 0.5) == 0


def test_lines_are_smaller_on_a_small_face():
    y, x = np.mgrid[:200, :300]
    away = np.hypot(x - 60, y - 60)
    picture = np.repeat((0.5 + 0.3 * np.sin(away / 4) * (away < 40))[None], 3, 0)
    focus = 1.0 + 8.0 * (away < 40)
    options = {"n": 60, "length": 30.0, "width": 3.0, "color": np.zeros(3)}
    small = contours(picture, picture[0], focus=focus, **options)
    large = contours(picture, picture[0], **options)
    drawn_width = [float((one.width * one.scale)[one.opacity > 0].max()) for one in (small, large)]
    assert drawn_width[0] < 0.8 * drawn_width[1]


def test_fine_lines_in_the_focus_do_not_run_along_bold_ones():
    picture = np.full((3, 160, 240), 0.8)
    picture[:, :, 120:] = 0.2
    focus = 1.0 + 8.0 * (np.abs(np.arange(240) - 120) < 60) * np.ones((160, 1))
    strokes = contours(picture, picture[0], 30, 40.0, 3.0, np.zeros(3), focus)
    strokes = strokes[strokes.opacity > 0]
    length = length_of(curve_of(strokes))
    assert 100 < float(length.sum()) < 1.5 * 160, "the only edge is drawn once"


def test_two_tones_are_refused_in_words():
    with pytest.raises(UserError, match=r"init\.tones=\[0\.4, 0\.7\] are 2 values; give three"):
        build_named("init", "drawing", {"tones": (0.4, 0.7)})


def disc(size, centre, radius):
    y, x = np.mgrid[:size, :size]
    return np.hypot(x - centre[0], y - centre[1]) < radius


def test_an_outline_is_one_chain_of_overlapping_strokes_along_the_edge():
    lightness = np.where(disc(200, (100, 100), 60), 0.2, 0.8)
    ((points, strength),) = find_outlines(lightness, 2.0, np.ones_like(lightness), 0.1, 0.2)
    assert np.abs(np.hypot(*(points - 100.5).T) - 60).max() < 1
    assert strength.min() > 0.5
    curves, middle = strokes_over(points, 40.0)
    assert len(curves) == len(middle) > 8
    t = np.linspace(0, 1, 21)[:, None, None]
    on = (1 - t) ** 2 * curves[:, 0] + 2 * t * (1 - t) * curves[:, 1] + t**2 * curves[:, 2]
    assert np.abs(np.hypot(*(on - 100.5).T) - 60).max() < 2.5
    assert np.linalg.norm(curves[1:, 0] - curves[:-1, 2], axis=1).min() > 10, "each begins on the one before it"
    ahead, behind = (curves[:, end] - 100.5 for end in (2, 0))
    turned = np.diff(np.unwrap(np.arctan2(*(ahead[:, ::-1]).T))), np.diff(np.unwrap(np.arctan2(*(behind[:, ::-1]).T)))
    assert all((part > 0).all() or (part < 0).all() for part in turned)


def test_an_even_picture_has_no_outlines_and_a_faint_edge_only_if_it_is_clear():
    even = np.full((80, 80), 0.5)
    assert find_outlines(even, 2.0, np.ones_like(even), 0.1, 0.2) == []
    step = even + 0.3 * (np.arange(80) > 40)
    assert len(find_outlines(step, 2.0, np.ones_like(even), 0.1, 0.2)) == 1
    assert find_outlines(step, 2.0, np.zeros_like(even), 0.1, 0.2) == []


def test_dark_features_are_filled_and_the_dark_side_of_an_edge_is_none():
    lightness = np.where(disc(400, (100, 100), 3), 0.1, 0.8)
    lightness[:, 300:] = 0.1
    found = dark_features(lightness) > 0
    assert found[disc(400, (100, 100), 2)].all()
    assert not found[:, 200:].any()


def test_hatching_is_straight_where_a_picture_has_no_forms():
    picture = np.full((3, 200, 300), 0.5)
    picture[:, :, :60] += 0.3 * np.sin(np.arange(60) / 3)
    turned = np.abs(forms(picture))
    assert turned[:, 200:].max() < 0.05
    assert turned[:, :40].mean() > 0.3
