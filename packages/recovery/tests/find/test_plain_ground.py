"""Test that the width of strokes on a plain ground is measured from their shapes."""

import numpy as np
import pytest
from brushexp_recovery.find.plain_ground import width_on_plain_ground
from brushexp_recovery.find.scale import BEST_WIDTH, SCALES, find_zoom
from brushexp_recovery.raster.resampling import resample
from skimage.draw import line

Y, X = np.mgrid[:240, :300]


def bars(width: float, ground: float = 0.02, noise: float = 0.01) -> np.ndarray:
    """Paint two bars of the given width in pixels on a plain ground (240, 300, 3)."""
    image = np.full((240, 300, 3), ground)
    for top, color in ((70, (0.8, 0.2, 0.1)), (160, (0.2, 0.4, 0.9))):
        image[(np.abs(Y - top) < width / 2) & (X > 60) & (X < 240)] = color
    image += np.random.default_rng(0).normal(0, noise, image.shape)
    return image.clip(0, 1).astype(np.float32)


@pytest.mark.parametrize("ground", [0.02, 0.5, 0.97])
@pytest.mark.parametrize("width", [12, 40])
def test_the_width_of_strokes_on_a_plain_ground_is_measured(width, ground):
    assert width_on_plain_ground(bars(width, ground)) == pytest.approx(width, rel=0.2)


def test_the_scale_follows_from_the_width_without_a_network():
    image = bars(40)
    zoom = find_zoom(None, None, image)
    assert zoom == pytest.approx(BEST_WIDTH / 40, rel=0.2)
    assert find_zoom(None, None, resample(image, 0.5)) == pytest.approx(2 * zoom, rel=0.2)
    assert find_zoom(None, None, resample(image, 6.0)) == SCALES[0]


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((300, 400, 3), np.float32),
        np.ones((8, 8, 3), np.float32),
        np.full((1, 1, 3), 0.5, np.float32),
        np.random.default_rng(0).random((64, 64, 3)).astype(np.float32),
        bars(120),
    ],
    ids=["black", "white, 8 pixels", "a pixel", "noise", "mostly paint"],
)
def test_without_a_plain_ground_or_strokes_no_width_is_measured(image):
    assert width_on_plain_ground(image) is None


def test_a_few_hairs_do_not_count():
    image = bars(30)
    for x in range(0, 300, 75):
        rows, columns = line(0, x, 239, min(299, x + 30))
        image[rows, columns] = 0.9
    width = width_on_plain_ground(image)
    assert width == pytest.approx(30, rel=0.3)
