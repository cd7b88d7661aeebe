"""Test that the lit painting, heights and normals written by ``to=relief`` are consistent with each other."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from brushexp_exports.relief import Relief
from catalogues import job_of as of_catalogue
from films import pixels_of
from PIL import Image
from scenes import random_strokes

from brushexp.compositing import bands as banding
from brushexp.shading.light import Light, normals_of, shade_picture


def painted_thickly(n, size):
    strokes = random_strokes(n, size, width=(0.2, 0.5))
    return of_catalogue(replace(strokes, opacity=0.3 + 0.7 * strokes.opacity), size)


@pytest.mark.parametrize(("depth", "thick_as"), [(2.0, 2.0), (0.0, 1.0)])
def test_the_three_files_agree_with_the_heights(depth, thick_as, tmp_path, caplog):
    job = replace(painted_thickly(20, (21, 34)), light=Light(200, 30, depth))
    with caplog.at_level(logging.INFO, logger="brushexp_exports.relief"):
        paths = Relief().write(job, tmp_path)
    assert [path.name for path in paths] == ["relief.png", "height.png", "normals.png"]
    height = job.height()
    with Image.open(tmp_path / "height.png") as image:
        levels, text = np.asarray(image), image.text
    assert levels.max() == 65535
    white = float(text["HeightOfWhite"])
    assert white == pytest.approx(thick_as * height.max(), rel=1e-6)
    assert f"{white:.6g} pixels above the bare canvas" in text["Description"]
    assert f"{white:.6g} pixels above the bare canvas" in caplog.text
    np.testing.assert_allclose(levels * (white / 65535), thick_as * height, atol=white / 65535)
    with Image.open(tmp_path / "normals.png") as image:
        assert image.mode == "RGB"
        normals = np.asarray(image) / 127.5 - 1
    np.testing.assert_allclose(normals.transpose(2, 0, 1), normals_of(height, thick_as), atol=0.006)
    picture = next(replace(job, light=Light()).bands())[1].numpy()
    lit = pixels_of(tmp_path / "relief.png") / 255
    expected = shade_picture(picture, normals_of(height, thick_as), Light(200, 30))
    np.testing.assert_allclose(lit.transpose(2, 0, 1), expected, atol=0.003)


def test_files_are_the_same_in_bands(tmp_path, monkeypatch):
    job = painted_thickly(20, (40, 23))
    for name, pixels in (("whole", 2**20), ("bands", 23 * 7)):
        monkeypatch.setattr(banding, "BAND", pixels)
        (tmp_path / name).mkdir()
        Relief().write(job, tmp_path / name)
    for name, step in (("relief.png", 1), ("height.png", 8), ("normals.png", 1)):
        whole, parts = (np.asarray(Image.open(tmp_path / kind / name)).astype(int) for kind in ("whole", "bands"))
        assert np.abs(whole - parts).max() <= step
