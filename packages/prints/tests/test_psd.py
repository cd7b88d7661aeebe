"""Layers in PSD: psd-tools finds layers that show the painting, and Pillow, which reads no layers, the painting."""

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
import torch
from PIL import Image, ImageCms
from psd_tools import PSDImage
from psd_tools.constants import Resource
from test_ora import CASES, SIZE, job_of, shown

from brushexp.errors import UserError
from brushexp.registry import build_named


def written(job, folder, **options):
    (path,) = build_named("to", "psd", options).write(job, folder)
    return path


def layers_in(path):
    """The layers of a file as psd-tools reads them, the lowest first, as names and pixels in [0, 1] on the canvas."""
    layers = []
    for layer in PSDImage.open(path):
        pixels = np.zeros((*SIZE, 4))
        pixels[layer.top : layer.bottom, layer.left : layer.right] = np.asarray(layer.topil(), float) / 255
        layers.append((layer.name, pixels))
    return layers


@pytest.mark.parametrize("case", CASES)
def test_layers_show_the_painting_and_readers_of_none_find_it(tmp_path, case):
    job = job_of(**CASES[case])
    path = written(job, tmp_path, layers=4, dpi=200.0)
    layers = layers_in(path)
    names = ["ground", "3 strokes", "3 strokes", "3 strokes", "2 strokes"] + ["light and paper"] * (case != "plain")
    assert [name.split(",")[0] for name, _ in layers] == names
    assert np.abs(shown(layers) - job.picture()).max() <= 2.5
    with Image.open(path) as merged:
        assert merged.mode == "RGB"
        assert np.array_equal(np.asarray(merged), job.picture())
        profile = ImageCms.ImageCmsProfile(BytesIO(merged.info["icc_profile"]))
        assert "sRGB" in ImageCms.getProfileName(profile)
    image = PSDImage.open(path)
    assert not any(layer.has_mask() for layer in image)
    assert image.image_resources.get_data(Resource.RESOLUTION_INFO).horizontal == 200 * 2**16
    assert written(job, tmp_path / "..", layers=4, dpi=200.0).read_bytes() == path.read_bytes()


def test_a_transparent_painting_stays_so(tmp_path):
    alpha = torch.zeros(SIZE, dtype=torch.uint8)
    alpha[:, 20:] = 255
    job = job_of()
    path = written(replace(job, saved=replace(job.saved, alpha=alpha)), tmp_path)
    assert all((pixels[:, :19, 3] == 0).all() for _, pixels in layers_in(path))
    image = PSDImage.open(path)
    with Image.open(path) as pillows:
        for merged in (np.asarray(pillows), np.asarray(image.topil())):
            assert np.array_equal(merged[..., 3] > 127, alpha.numpy() > 127)
            assert np.abs(merged[:, 21:, :3] - job.picture()[:, 21:].astype(int)).max() <= 1


def test_a_painting_without_strokes_is_its_ground_and_one_too_large_is_refused(tmp_path):
    job = job_of()
    bare = replace(job, saved=replace(job.saved, strokes=job.strokes[:0], depth=job.saved.depth[:0]))
    ((name, pixels),) = layers_in(written(bare, tmp_path))
    assert name == "ground"
    assert pixels[0, 0].tolist() == pytest.approx([0.9, 0.8, 0.7, 1], abs=0.003)
    wide = replace(job, saved=replace(job.saved, size=(2, 30_001)))
    with pytest.raises(UserError, match=r"30000 pixels a side.* to=ora"):
        written(wide, tmp_path)
