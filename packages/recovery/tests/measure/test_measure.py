"""Test that known strokes are measured correctly, with intervals, in given areas and in millimetres."""

from functools import partial

import numpy as np
import pytest
import torch
from brushexp_recovery.benchmark.truth import draw_truth
from brushexp_recovery.measure.areas import WHOLE, areas_of
from brushexp_recovery.measure.draws import Draws, draw_figures, sight
from brushexp_recovery.measure.intervals import difference_of, intervals_of, is_apart
from brushexp_recovery.measure.measures import measure_strokes
from brushexp_recovery.measure.scale import millimetres_per_pixel
from brushexp_recovery.measure.views import View, choose_views
from brushexp_recovery.raster.jpeg import compress_as_jpeg
from PIL import Image
from recovery_scenes import recover_dark

from brushexp.errors import UserError

SIZE = (120, 160)
recover = partial(recover_dark, confidence=0.9)


def painting(angle: float = 20, width: float = 6.0) -> np.ndarray:
    """Draw separate dark strokes on a white ground."""
    random = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(18, 150, 28), np.arange(14, 110, 18))
    middle = np.stack([x.ravel(), y.ravel()], 1) + random.uniform(-2, 2, (x.size, 2))
    turn = np.radians(angle + random.normal(size=len(middle)) * 3)
    way = (8 + random.random(len(middle)))[:, None] * np.stack([np.cos(turn), np.sin(turn)], 1)
    curve = np.stack([middle - way, middle, middle + way], 1)
    _, image = draw_truth(curve, np.full(len(curve), width), np.zeros((len(curve), 3)), SIZE, np.ones(3))
    return image


def draws_in(image: np.ndarray, areas: dict[str, np.ndarray], views: int) -> dict[str, Draws]:
    sightings = [sight(image, view, recover) for view in choose_views(views, seed=0)]
    return draw_figures(sightings, areas, 20, seed=0)


def draws_of(image: np.ndarray) -> Draws:
    return draws_in(image, areas_of(None, image.shape[:2]), 4)[WHOLE]


def test_the_measures_are_those_of_the_strokes():
    figures = intervals_of(draws_of(painting()))
    assert figures["strokes"].value == pytest.approx(0.9 * 30, abs=2)
    assert figures["width"].value == pytest.approx(6, rel=0.1)
    assert figures["length"].value == pytest.approx(23, rel=0.1)  # an arc of 17 and two round ends of 3
    assert figures["elongatedness"].value == pytest.approx(23 / 6, rel=0.15)
    assert figures["direction"].value == pytest.approx(20, abs=2)
    assert figures["coherence"].value > 0.95
    for name, one in figures.items():
        assert one.low <= one.value <= one.high, name
        assert one.over_strokes >= 0


@pytest.mark.parametrize("width", [2.0, 5.0, 40.0])
def test_length_is_what_a_ruler_reads_from_tip_to_tip(width):
    line = torch.tensor([[[60.0, 60.0], [80.0, 60.0], [100.0, 60.0]]]).double()
    truth, _ = draw_truth(line.numpy(), np.array([width]), np.zeros((1, 3)), SIZE, np.ones(3))
    columns = np.flatnonzero((truth.labels >= 0).any(0))
    measured = measure_strokes(line, np.array([width]))
    assert measured["length"][0] == pytest.approx(40 + width)
    assert columns[-1] - columns[0] + 1 == pytest.approx(measured["length"][0], abs=1.5)
    assert measured["elongatedness"][0] == pytest.approx((40 + width) / width)
    assert measured["area"][0] == pytest.approx((truth.labels >= 0).sum(), rel=0.1)


def test_a_dab_without_an_arc_is_as_long_as_it_is_wide():
    point = torch.full((1, 3, 2), 7.0).double()
    measured = measure_strokes(point, np.array([5.0]))
    assert measured["length"][0] == pytest.approx(5, abs=0.01)
    assert measured["elongatedness"][0] == pytest.approx(1, abs=0.01)
    assert all(len(values) == 0 for values in measure_strokes(point[:0], np.empty(0)).values())


def test_a_second_photograph_gives_the_same_figures_within_their_intervals():
    image = painting()
    again = View(zoom=1.3, turn=1.0).of(image)
    again = compress_as_jpeg(np.clip(0.97 * again + 0.01, 0, 1), 60)
    one, other = draws_of(image), draws_of(again)
    scales = tuple(millimetres_per_pixel(picture.shape[:2], 32, None) for picture in (image, again))
    apart = {name for name, gap in difference_of(one, other, scales, seed=0).items() if is_apart(gap)}
    assert apart <= {"straightness", "curvature"}  # straight lines have no spread in these
    figures, figures_again = (intervals_of(x, mm) for x, mm in zip((one, other), scales, strict=True))
    assert figures["width"].value == pytest.approx(12, rel=0.1)  # a pixel is 2 mm
    assert figures_again["width"].value == pytest.approx(figures["width"].value, rel=0.05)
    different = draws_of(painting(angle=160, width=9))
    gaps = difference_of(one, different, (None, None), seed=0)
    assert is_apart(gaps["width"])
    assert is_apart(gaps["direction"])
    assert gaps["direction"].value == pytest.approx(40, abs=3)


def test_directions_have_intervals_across_the_turn():
    figures = intervals_of(draws_of(painting(angle=0)))["direction"]
    assert min(figures.value, 180 - figures.value) < 3
    assert figures.high - figures.low < 10


def test_strokes_of_a_view_come_back_to_their_places():
    image = painting()
    plain, turned = (sight(image, view, recover) for view in (View(), View(zoom=1.25, turn=2.0)))
    gap = torch.cdist(plain.curve.mean(1), turned.curve.mean(1)).amin(1)
    assert float(gap.median()) < 0.3
    assert turned.width.mean() == pytest.approx(plain.width.mean(), rel=0.05)


@pytest.fixture
def mask(tmp_path) -> Image.Image:
    """Draw a mask whose right half is bright."""
    pixels = np.zeros(SIZE, np.uint8)
    pixels[:, 80:] = 255
    return Image.fromarray(pixels)


def test_areas_are_rectangles_and_masks(mask, tmp_path):
    mask.resize((320, 240), 0).save(tmp_path / "mask.png")
    areas = areas_of(["0,0,80,120", str(tmp_path / "mask.png")], SIZE)
    assert [int(area.sum()) for area in areas.values()] == [19200, 9600, 9600]
    whole, left, right = draws_in(painting(), areas, 1).values()
    assert whole["strokes"].mean() == pytest.approx(left["strokes"].mean() + right["strokes"].mean(), rel=0.15)
    covered = 0.5 * (left["covered"].mean() + right["covered"].mean())
    assert whole["covered"].mean() == pytest.approx(covered, rel=0.1)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1,2", "not a rectangle"),
        ("500,0,3,3", "no pixel"),
        ("nowhere.png", "region=|there is no"),
        ("wide", "not have the shape"),
    ],
)
def test_areas_that_are_none_are_refused(text, words, mask, tmp_path):
    mask.resize((320, 120), 0).save(tmp_path / "wide.png")
    with pytest.raises(UserError, match=words):
        areas_of([str(tmp_path / "wide.png") if text == "wide" else text], SIZE)


@pytest.mark.parametrize(("width_cm", "size_cm", "mm"), [(92, None, 1), (None, "92x73", 1), (None, None, None)])
def test_sizes_of_the_painting_give_millimetres(width_cm, size_cm, mm):
    assert millimetres_per_pixel((730, 920), width_cm, size_cm) == (mm and pytest.approx(mm))


@pytest.mark.parametrize(
    ("width_cm", "size_cm", "words"),
    [(1, "1x1", "one of them"), (None, "92", "92x73"), (None, "73x92", "shape"), (None, "0x3", "area")],
)
def test_sizes_that_cannot_be_are_refused(width_cm, size_cm, words):
    with pytest.raises(UserError, match=words):
        millimetres_per_pixel((730, 920), width_cm, size_cm)
