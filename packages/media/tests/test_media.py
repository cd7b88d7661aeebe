"""Test that looks resemble their media: paper stays white, ground shows, and dots average to the picture."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from brushexp_media.init.hatching import ANGLES, TURN, forms, hatching
from brushexp_media.init.rows import CLOSEST_MARKS, WIDER
from brushexp_media.marks import DRAWN, DRY, KINDS, LEVELS, PEN, VARIANTS, WITH_DRY_ENDS
from brushexp_media.picture.decolorization import contrast_weights, decolorize
from brushexp_media.picture.lines import LUMA, edge_lines
from brushexp_testing.families import some_strokes
from scenes import straight
from torch.testing import assert_close

import brushexp
from brushexp.pictures.color import to_lab
from brushexp.registry import build_named
from brushexp.shading.light import UNLIT
from brushexp.strokes.bezier import curve_of
from brushexp.strokes.catalogue import Strokes

SIDE = 128


@pytest.fixture(scope="module")
def paintings():
    """Paint a small picture, with white, sky, dark and colourful areas, in the looks of all media."""
    y, x = np.mgrid[0:96, 0:SIDE] / SIDE
    picture = np.stack([0.45 + 0.3 * y, 0.62 + 0.1 * y, 0.85 - 0.2 * y], -1)
    picture[(x - 0.3) ** 2 + (y - 0.3) ** 2 < 0.02] = (0.97, 0.97, 0.95)
    picture[y > 0.5] = (0.32, 0.25, 0.16)
    picture[(y > 0.55) & (x > 0.6)] = (0.75, 0.2, 0.12)
    picture = (255 * picture.clip(0, 1)).astype(np.uint8)
    names = ("oil", "pastel", "watercolour", "ink", "gouache", "pointillist")
    options = {"frames": 0, "report": False, "focus": None, "threads": 1}
    return picture, {name: brushexp.paint(picture, look=name, **options) for name in names}


def lightness(picture):
    return to_lab(picture.reshape(-1, 3) / 255)[:, 0]


def psnr(one, other):
    return -10 * np.log10(np.mean(np.square(one / 255.0 - other / 255.0)))


@pytest.mark.slow
def test_each_medium_is_far_from_oil(paintings):
    _, looks = paintings
    distances = {
        name: psnr(looks["oil"].image, looks[name].image) for name in ("pastel", "watercolour", "ink", "gouache")
    }
    assert max(distances.values()) < 24, distances


@pytest.mark.slow
def test_watercolour_leaves_the_paper_white_where_the_picture_is(paintings):
    picture, looks = paintings
    assert (lightness(looks["watercolour"].image) > 92).mean() >= (lightness(picture) > 92).mean() > 0.02


def ground_seen(painting) -> float:
    """Measure the fraction of pixels that are mostly ground, by comparing paintings on a white and a black ground."""
    job = replace(painting.finished.job, light=UNLIT)
    black, white = (
        replace(job, saved=replace(job.saved, background=torch.full((3,), b))).picture() for b in (0.0, 1.0)
    )
    return float(((white.astype(float) - black).mean(-1) > 127).mean())


@pytest.mark.slow
def test_ground_shows_in_the_grain_of_pastel_and_not_between_dots(paintings):
    _, looks = paintings
    seen = {name: ground_seen(looks[name]) for name in ("oil", "pastel", "pointillist")}
    assert 0.05 <= seen["pastel"] <= 0.25, seen
    assert seen["pointillist"] < 0.02, seen
    assert seen["oil"] < 0.02, seen


@pytest.mark.slow
def test_ink_is_light_paper_and_brown_ink(paintings):
    _, looks = paintings
    light = lightness(looks["ink"].image)
    assert (light > 92).mean() > 0.1
    red, green, blue = np.moveaxis(looks["ink"].image.astype(int), -1, 0)
    assert (red - green).min() >= 0 <= (green - blue).min()  # a single faint hue
    assert (red - blue).max() < 100


def test_lines_are_on_the_dark_side_of_edges():
    picture = np.full((3, 40, 60), 0.9)
    picture[:, :, 30:] = 0.1
    lines = edge_lines(picture)
    assert lines[20, 30] > 0.9
    assert lines[:, :28].max() == 0
    assert lines[:, 40:].max() == 0


def test_colours_of_one_luma_differ_in_grey():
    picture = np.full((3, 40, 60), 0.5)
    picture[:, :, 30:] = np.array([0.1, 0.5 + 0.4 * LUMA[0] / LUMA[1], 0.5])[:, None, None]
    weights = contrast_weights(picture)
    assert weights.min() >= 0
    assert weights.sum() == pytest.approx(1)
    grey = decolorize(picture, weights)
    assert abs(grey[0, 0] - grey[0, -1]) > 0.1
    assert (contrast_weights(picture[:, :, ::-1].copy()) == weights).all()


@pytest.mark.parametrize("size", [(1, 1), (1, 200), (40, 60)])
def test_greys_have_about_the_weights_of_luma(size):
    picture = np.broadcast_to(np.random.default_rng(0).random(size), (3, *size))
    assert contrast_weights(picture) == pytest.approx(LUMA, abs=0.06)


def test_colours_of_one_luma_have_a_line_between_them():
    picture = np.full((3, 40, 60), 0.5)
    picture[:, :, 30:] = np.array([0.1, 0.5 + 0.4 * LUMA[0] / LUMA[1], 0.5])[:, None, None]
    assert decolorize(picture, np.array(LUMA)).std() < 1e-9
    lines = edge_lines(picture)
    assert lines[20, 28:32].max() > 0.8
    assert lines[:, :26].max() == lines[:, 40:].max() == 0


@pytest.mark.parametrize("init", ["chalks", "drawing", "rows"])
@pytest.mark.parametrize(
    "target", [torch.ones(3, 30, 44), torch.zeros(3, 30, 44), torch.rand(3, 5, 2), torch.zeros(3, 1, 9)]
)
def test_any_picture_is_drawn_with_as_many_strokes_as_asked(init, target):
    n = min(50, target[0].numel())
    strokes = build_named("init", init, {})(target, n, torch.Generator().manual_seed(0))
    assert len(strokes) == n
    assert all(value.isfinite().all() for _, value in strokes.items())
    if target.min() == 1 and init == "drawing":
        assert float(strokes.opacity[strokes.brush >= PEN].max()) == 0


def rows_of(target, n, **options):
    return build_named("init", "rows", {"under": 0.0, "outlines": 0.0, "layers": 1, "looseness": 0.0, **options})(
        target, n, torch.Generator().manual_seed(0)
    )[1:]  # without the underpainting's stroke, which always exists


def slopes(strokes):
    """Compute the angles between visible strokes' chords and the x axis, in radians in [-pi / 2, pi / 2]."""
    along = strokes.end - strokes.start
    return torch.atan(along[:, 1] / along[:, 0])[strokes.opacity > 0]


def test_marks_of_a_knife_are_straight_and_others_bend_with_their_row():
    y, x = np.mgrid[0:90, 0:120]
    rings = torch.from_numpy(0.5 + 0.3 * np.cos(np.hypot(x - 60, y - 130) / 6)).expand(3, -1, -1).float()
    bent, less, straight = (curve_of(rows_of(rings, 120, edges=1.0, length=8.0, bend=bend)) for bend in (1.0, 0.5, 0.0))
    off = [(curve[:, 1] - (curve[:, 0] + curve[:, 2]) / 2).norm(dim=1) for curve in (bent, less, straight)]
    assert float(off[0].median()) > 0.5
    assert_close(off[1], 0.5 * off[0], atol=1e-3, rtol=1e-3)
    assert float(off[2].max()) < 1e-3


def test_rows_follow_forms_and_turn_where_there_are_none():
    y, x = np.mgrid[:90, :120].astype(float)
    striped = torch.from_numpy(np.broadcast_to(0.5 + 0.1 * np.sin((y + x) / 8), (3, 90, 120)).copy()).float()
    along = slopes(rows_of(striped, 60, edges=1.0))
    assert float((along + math.pi / 4).abs().median()) < 0.15
    calm = torch.full((3, 90, 120), 0.5)
    assert float(slopes(rows_of(calm, 60, turning=0.0)).abs().max()) < 1e-3
    assert float(slopes(rows_of(calm, 60)).std()) > 0.2


def test_rows_lie_beside_each_other_and_end_where_colours_do():
    target = torch.full((3, 90, 120), 0.2)
    target[:, 45:] = 0.8
    strokes = rows_of(target, 80, edges=0.1, turning=0.0, variety=0.0)
    places = strokes.position[strokes.opacity > 0]
    distance = float((strokes.width * strokes.scale)[strokes.opacity > 0].median()) / 1.2  # the default of `width`
    apart = torch.cdist(places, places) + 1e9 * torch.eye(len(places))
    assert float(apart.min()) > CLOSEST_MARKS * math.exp(-3 * WIDER) * distance
    away = (places[:, 1] - 45).abs() > distance
    tone = strokes.color[strokes.opacity > 0].mean(1)
    assert bool(((tone > 0.5) == (places[:, 1] > 45))[away].all())


def test_marks_vary_in_width_and_leave_their_row():
    rows = rows_of(torch.full((3, 90, 120), 0.5), 150, turning=0.0, looseness=0.4)
    assert 0.15 < float(slopes(rows).std()) < 0.6
    assert float((rows.width * rows.scale)[rows.opacity > 0].log().std()) == pytest.approx(WIDER, abs=0.06)


def test_colours_vary_less_where_one_looks_first():
    target, focus = torch.full((3, 90, 120), 0.5), torch.full((90, 120), 0.5)
    focus[:, 60:] = 9
    rows = build_named("init", "rows", {"under": 0.0})(target, 200, torch.Generator().manual_seed(0), focus)[1:]
    beside, inked = rows.position[:, 0] < 60, rows.opacity > 0
    assert float(rows.color[~beside & inked].std()) < 0.6 * float(rows.color[beside & inked].std())


@pytest.mark.parametrize("share", [0.3, 0.7, 1.0])
def test_what_is_black_is_hatched_and_what_is_white_is_not(share):
    target = torch.ones(3, 60, 80)
    target[:, :, : round(80 * share)] = 0.0
    strokes = build_named("init", "drawing", {"washes": 0.0, "contours": 0.0})(
        target, 200, torch.Generator().manual_seed(0)
    )
    inked = strokes.opacity > 0
    assert inked.float().mean() > 0.6
    assert bool((strokes.position[inked, 0] < 80 * share + 6).all())


def test_a_hatching_is_sparser_where_it_is_less_dark():
    dark = np.full((200, 300), 0.55)
    dark[:, 150:] = 0.9
    lines = hatching(dark, 0.5, 0.3, np.zeros((1, 1)), 4.0, 12.0, np.random.default_rng(0))
    assert 0.6 < (lines[:, 1, 0] > 150).mean() < 0.9


def test_hatchings_turn_towards_forms():
    y, x = np.mgrid[:80, :120].astype(float)
    for slope in (0.5, 1.0):  # slope of stripes that rise to the left
        picture = np.broadcast_to(0.5 + 0.4 * np.sin((y + slope * x) / 3), (3, 80, 120))
        angle = -math.atan(slope)
        assert_close(forms(picture)[20:60, 20:100], np.full((40, 80), angle - ANGLES[0]), atol=0.05, rtol=0)
    assert np.abs(forms(np.random.default_rng(0).random((3, 40, 40)))).max() <= TURN


def test_where_one_looks_first_faint_lines_are_drawn_and_finer():
    target = torch.full((3, 96, 128), 0.8)
    for x in (32, 96):
        target[:, 20:76, x : x + 3] = 0.74
    focus = torch.full((96, 128), 0.1)
    focus[:, 64:] = 1.9
    draw = build_named("init", "drawing", {"washes": 0.0, "contours": 1.0})
    lines = {
        name: draw(target, 60, torch.Generator().manual_seed(0), weight)
        for name, weight in (("without", None), ("with", focus))
    }
    seen = {name: strokes[strokes.opacity > 0] for name, strokes in lines.items()}
    assert len(seen["without"]) == 0
    assert len(seen["with"]) > 0
    assert bool((seen["with"].position[:, 0] > 64).all())


@pytest.mark.parametrize("kind", WITH_DRY_ENDS)
def test_no_two_marks_of_a_brush_have_one_outline_and_only_long_strokes_run_dry(kind):
    outlines = [DRAWN[kind](variant)[0].gt(0.5).flatten().float() for variant in range(VARIANTS)]
    alike = torch.corrcoef(torch.stack(outlines)) - torch.eye(VARIANTS)
    assert float(alike.max()) < 0.99
    filled = torch.stack(outlines).mean(1)
    assert float(filled[-DRY:].mean()) < float(filled[:-DRY].mean())
    short, long = (
        replace(Strokes.join(*[straight((0, 9), (end, 9), width=6)] * VARIANTS), brush=torch.arange(VARIANTS))
        for end in (20, 60)
    )
    renderer = build_named("renderer", "marks", {"kind": kind})
    looks = [renderer(strokes).look // LEVELS for strokes in (short, long)]
    assert int(looks[0].max()) < VARIANTS - DRY
    assert looks[1].tolist() == list(range(VARIANTS))


@pytest.mark.parametrize("kind", KINDS)
def test_a_mark_covers_its_middle_and_nothing_far_away(kind):
    strokes = some_strokes(16, (64, 64), width=(0.2, 0.3))
    strokes = replace(strokes, opacity=torch.ones(16), brush=torch.arange(16))
    curve = curve_of(strokes)
    middle = (curve[:, 0] + 2 * curve[:, 1] + curve[:, 2]) / 4
    layers = build_named("renderer", "marks", {"kind": kind})(strokes)
    alpha, _ = layers.sample(torch.arange(16)[None], torch.stack([middle, middle + 500], 1).flatten(0, 1)[None])
    alpha = alpha[0].reshape(16, 16, 2)[range(16), range(16)]
    assert float(alpha[:, 0].mean()) > 0.4
    assert float(alpha[:, 1].max()) == 0


def test_dots_can_be_abstracted():
    picture = np.linspace(0, 255, 24 * 32 * 3).reshape(24, 32, 3).astype(np.uint8)
    painting = brushexp.paint(picture, look="pointillist", abstraction=1, steps=0, frames=0, report=False)
    assert len(painting.strokes) > 0
