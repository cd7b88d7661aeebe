"""Tests that strokes are optimised at a size that suits their number and painted at the photograph's size."""

import numpy as np
import pytest
from PIL import Image
from program import ended
from refusals import refuses
from skimage import data
from torch.testing import assert_close

import brushexp
from brushexp.api.settings import settings_of
from brushexp.pages.run_page import page_in
from brushexp.painting.working_size import Sizes, resolution_of, sizes_of
from brushexp.pictures.load import load_picture
from brushexp.results.painting_files import read_painting
from brushexp.strokes.bezier import half_width_of
from brushexp.strokes.storage import load_catalogue

WIDE, SMALL = (120, 160), (48, 64)


@pytest.fixture
def photo(tmp_path):
    path = tmp_path / "photo.png"
    Image.fromarray(data.astronaut()).crop((0, 0, 320, 240)).resize(WIDE[::-1]).save(path)
    return str(path)


def large(folder, height, width):
    path = folder / f"{width}.png"
    Image.new("RGB", (width, height), "olive").save(path)
    return str(path)


def sizes(**words):
    return sizes_of(settings_of("paint", words).cfg)


def test_small_pictures_a_typed_resolution_and_null_keep_all_pixels(tmp_path):
    image = large(tmp_path, 1500, 2000)
    whole = Sizes((1500, 2000), (1500, 2000))
    assert sizes(image=large(tmp_path, 900, 1200)) == Sizes((900, 1200), (900, 1200))
    assert sizes(image=image, working_resolution=None) == whole
    assert sizes(image=image, resolution=1600) == Sizes((1200, 1600), (1200, 1600))
    assert sizes(image=image, painter="hertzmann") == whole, "whose brushes are measured in pixels"


def test_the_working_size_follows_from_the_number_of_strokes(tmp_path):
    image = large(tmp_path, 3000, 4000)
    assert sizes(image=image) == Sizes((3000, 4000), (768, 1024))
    assert sizes(image=image, strokes=50) == Sizes((3000, 4000), (768, 1024))
    many = sizes(image=image, strokes=40_000)
    assert many.painting == (3000, 4000)
    assert np.prod(many.working) == pytest.approx(80 * 40_000, rel=0.01)
    assert sizes(image=image, strokes=1_000_000).working == (3000, 4000)
    assert sizes(image=image, working_resolution=500) == Sizes((3000, 4000), (375, 500))
    assert sizes(image=image, working_resolution=9000).working == (3000, 4000)


def test_the_number_of_strokes_is_that_of_the_whole_picture(photo):
    whole, small = (
        brushexp.paint(photo, look="plain", steps=0, working_resolution=one, pixels_per_stroke=200, warm_up=None)
        for one in (None, 64)
    )
    assert len(small.strokes) == len(whole.strokes) == 96


def test_a_picture_beyond_fifty_megapixels_is_painted_with_as_many(tmp_path):
    both = sizes(image=large(tmp_path, 6000, 12000))
    assert np.prod(both.painting) == pytest.approx(50e6, rel=0.01)
    assert np.prod(both.painting) <= 50e6
    assert np.prod(both.working) == pytest.approx(80 * 8_000, rel=0.01)


@pytest.mark.parametrize("look", ["plain", "oil"])
def test_a_painting_is_what_an_export_makes_of_the_one_at_the_working_size(tmp_path, photo, look):
    words = [photo, f"look={look}", "strokes=40", "steps=4", "frames=0", "report=false"]
    for name, more in (("large", "working_resolution=64"), ("small", "resolution=64")):
        code, output = ended(tmp_path, *words, more, f"output={name}")
        assert code == 0, output
        assert ("optimised at 64 x 48 pixels and painted at 160 x 120" in output) == (name == "large")
    code, output = ended(tmp_path, "task=export", "catalogue=small", "resolution=160", "output=enlarged")
    assert code == 0, output
    large, enlarged = (np.asarray(Image.open(tmp_path / name / "painting.png")) for name in ("large", "enlarged"))
    assert large.shape == (*WIDE, 3)
    assert abs(large.astype(int) - enlarged).max() <= 1
    saved, small = (load_catalogue(tmp_path / name / "catalogue.h5") for name in ("large", "small"))
    assert saved.size == WIDE
    assert_close(saved.strokes.position, small.strokes.position * 2.5)
    assert np.asarray(Image.open(tmp_path / "large" / "target.png")).shape == (*SMALL, 3)


def test_a_transparent_picture_keeps_its_alpha_at_both_sizes(tmp_path):
    pixels = np.dstack([data.astronaut()[:120, :160], np.full(WIDE, 255, np.uint8)])
    pixels[:, :80, 3] = 0
    Image.fromarray(pixels).save(tmp_path / "cutout.png")
    painting = brushexp.paint(
        str(tmp_path / "cutout.png"), look="oil", background="transparent", strokes=40, steps=2, working_resolution=64,
        output=tmp_path / "run",
    )  # fmt: skip
    alpha = np.asarray(Image.open(tmp_path / "run" / "painting.png"))[..., 3]
    assert alpha.shape == WIDE
    assert alpha[:, :70].max() == 0
    assert alpha[:, 90:].min() == 255
    assert painting.image.shape == (*WIDE, 3)
    assert painting.target.shape == (*SMALL, 3)
    assert np.asarray(Image.open(tmp_path / "run" / "flat.png")).shape == (*SMALL, 4)


def test_python_gets_the_painting_at_its_own_size(photo):
    painting = brushexp.paint(photo, look="plain", strokes=30, steps=2, working_resolution=64)
    assert painting.image.shape == (*WIDE, 3)
    assert (painting.image == painting.render()).all()
    assert "160 x 120" in repr(painting)
    assert "<iframe" in painting._repr_html_()


def test_sizes_of_strokes_in_pixels_are_those_of_the_painting(photo):
    painting = brushexp.paint(photo, look="plain", strokes=30, steps=2, working_resolution=64, largest="6")
    assert float(2 * half_width_of(painting.strokes).max()) == pytest.approx(6, rel=1e-3)


def test_the_alpha_and_the_target_are_loaded_at_the_working_size(photo):
    cfg = settings_of("paint", {"image": photo, "strokes": 40, "working_resolution": 64}).cfg
    assert resolution_of(cfg) == 64
    assert load_picture(photo, resolution_of(cfg)).shape == (3, *SMALL)


@pytest.mark.parametrize("value", ["auto2", "0", "-3", "1e3", "99999"])
def test_a_working_size_that_is_none_is_refused(value):
    refuses(rf"working_resolution={value} is not auto, null or 1 to 16384", sizes, working_resolution=value)


def test_fewer_pixels_than_strokes_are_refused(photo):
    refuses(
        "fewer than the 400 strokes; set working_resolution=auto",
        sizes,
        image=photo,
        strokes=400,
        working_resolution=12,
    )


def test_a_large_painting_is_loaded_again_and_its_page_is_made_from_its_folder(tmp_path, photo):
    painting = brushexp.paint(
        photo, look="oil", strokes=40, steps=2, working_resolution=64, output=tmp_path / "run", frames=0
    )
    again = brushexp.load(tmp_path / "run")
    assert (again.image == painting.image).all()
    assert again.finished.pictures["painting"].shape == again.target.shape == (*SMALL, 3)
    again.save(tmp_path / "copy")
    with Image.open(tmp_path / "copy" / "painting.png") as copy:
        assert copy.size == WIDE[::-1]
    page = page_in(tmp_path / "run", read_painting(tmp_path / "run", again.finished.job))
    assert "160 × 120 pixels" in page
