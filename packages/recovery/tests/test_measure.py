"""Measures have intervals in which a second photograph of the same painting lies; regions, millimetres, comparisons."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from brushexp_recovery.given import given_labels
from brushexp_recovery.measure import KINDS, compare, draws_of, intervals_of, is_apart, sight
from brushexp_recovery.measure_scale import regions_of, scale_of
from brushexp_recovery.measure_views import View, views_of
from brushexp_recovery.raster.jpeg import compress_as_jpeg
from brushexp_recovery.truth import drawn_truth
from PIL import Image
from skimage.measure import label

from brushexp.errors import UserError
from brushexp.strokes.bezier import strokes_along
from brushexp.strokes.storage import Saved

SIZE = (120, 160)


def painting(angle: float = 20, width: float = 6.0, seed: int = 0) -> np.ndarray:
    """Dark strokes that do not touch, on white."""
    random = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(18, 150, 28), np.arange(14, 110, 18))
    middle = np.stack([x.ravel(), y.ravel()], 1) + random.uniform(-2, 2, (x.size, 2))
    turn = np.radians(angle + random.normal(size=len(middle)) * 3)
    way = (8 + random.random(len(middle)))[:, None] * np.stack([np.cos(turn), np.sin(turn)], 1)
    curve = np.stack([middle - way, middle, middle + way], 1)
    return drawn_truth(curve, np.full(len(curve), width), np.zeros((len(curve), 3)), SIZE, np.ones(3))[1]


def recover(image: np.ndarray) -> SimpleNamespace:
    """Find strokes that do not touch, each with the same confidence."""
    regions = label(image.mean(2) < 0.5) - 1
    given = given_labels(regions, image)
    numbers = (torch.tensor(x, dtype=torch.float32) for x in (given.curve, given.width, given.color))
    strokes = strokes_along(*numbers, 1.0)
    saved = Saved(strokes, torch.arange(len(given), dtype=torch.int32), image.shape[:2], torch.ones(3), "analytic")
    return SimpleNamespace(saved=saved, confidence=np.full(len(given), 0.9), labels=given.labels)


def draws(image: np.ndarray, regions=None, count: int = 4) -> np.ndarray:
    seen = [sight(image, view, recover) for view in views_of(count, seed=0)]
    return draws_of(seen, regions or regions_of(None, image.shape[:2]), 20, seed=0)


def test_the_measures_are_those_of_the_strokes():
    figures = intervals_of(draws(painting())["whole"])
    assert figures["strokes"].value == pytest.approx(0.9 * 30, abs=2)
    assert figures["width"].value == pytest.approx(6, rel=0.1)
    assert figures["length"].value == pytest.approx(17, rel=0.1)
    assert figures["direction"].value == pytest.approx(20, abs=2)
    assert figures["coherence"].value > 0.95
    for name, one in figures.items():
        assert one.low <= one.value <= one.high, name
        assert one.over_strokes >= 0


def test_a_second_photograph_gives_the_same_figures_within_their_intervals():
    image = painting()
    again = View(zoom=1.3, turn=1.0).of(image)
    again = compress_as_jpeg(np.clip(0.97 * again + 0.01, 0, 1), 60)
    one, other = draws(image)["whole"], draws(again)["whole"]
    scales = tuple(scale_of(picture.shape[:2], 32, None) for picture in (image, again))
    apart = {name for name, gap in compare(one, other, scales, seed=0).items() if is_apart(gap)}
    assert apart <= {"straightness", "curvature"}  # of straight lines, which have no spread
    figures, figures_again = (intervals_of(x, mm) for x, mm in zip((one, other), scales, strict=True))
    assert figures["width"].value == pytest.approx(12, rel=0.1)  # millimetres: a pixel has 2
    assert figures_again["width"].value == pytest.approx(figures["width"].value, rel=0.05)
    different = draws(painting(angle=160, width=9))["whole"]
    gaps = compare(one, different, (None, None), seed=0)
    assert is_apart(gaps["width"])
    assert is_apart(gaps["direction"])
    assert gaps["direction"].value == pytest.approx(40, abs=3)


def test_directions_have_intervals_across_the_turn():
    figures = intervals_of(draws(painting(angle=0))["whole"])["direction"]
    assert min(figures.value, 180 - figures.value) < 3
    assert figures.high - figures.low < 10


def test_strokes_of_a_view_come_back_to_their_places():
    image = painting()
    plain, turned = (sight(image, view, recover) for view in (View(), View(zoom=1.25, turn=2.0)))
    gap = torch.cdist(plain.curve.mean(1), turned.curve.mean(1)).amin(1)
    assert float(gap.median()) < 0.3
    assert turned.width.mean() == pytest.approx(plain.width.mean(), rel=0.05)


def test_regions_are_rectangles_and_masks(tmp_path):
    mask = np.zeros(SIZE, np.uint8)
    mask[:, 80:] = 255
    Image.fromarray(mask).resize((320, 240), 0).save(tmp_path / "mask.png")
    regions = regions_of(["0,0,80,120", str(tmp_path / "mask.png")], SIZE)
    assert [int(region.sum()) for region in regions.values()] == [19200, 9600, 9600]
    counts = [x[0, :, 0].mean() for x in draws(painting(), regions, 1).values()]
    assert counts[0] == pytest.approx(counts[1] + counts[2], rel=0.15)
    covered = [x[0, :, list(KINDS).index("covered")].mean() for x in draws(painting(), regions, 1).values()]
    assert covered[0] == pytest.approx(0.5 * (covered[1] + covered[2]), rel=0.1)
    for text, words in {"1,2": "no rectangle", "500,0,3,3": "no pixel", "nowhere.png": "region=|there is no"}.items():
        with pytest.raises(UserError, match=words):
            regions_of([text], SIZE)
    Image.fromarray(mask).resize((320, 120), 0).save(tmp_path / "wide.png")
    with pytest.raises(UserError, match="not the shape"):
        regions_of([str(tmp_path / "wide.png")], SIZE)


def test_sizes_of_the_painting_give_millimetres():
    assert scale_of((730, 920), 92, None) == pytest.approx(1)
    assert scale_of((730, 920), None, "92x73") == pytest.approx(1)
    assert scale_of((730, 920), None, None) is None
    for width, size, words in (
        (1, "1x1", "one of them"),
        (None, "92", "92x73"),
        (None, "73x92", "shape"),
        (None, "0x3", "area"),
    ):
        with pytest.raises(UserError, match=words):
            scale_of((730, 920), width, size)
