"""Test that the layers in OpenRaster and PSD files are well formed and together show the painting."""

from dataclasses import replace
from io import BytesIO
from xml.etree import ElementTree
from zipfile import ZIP_STORED, ZipFile

import numpy as np
import pytest
import torch
from brushexp_testing.families import some_strokes
from PIL import Image, ImageCms
from psd_tools import PSDImage
from psd_tools.constants import Resource
from refusals import refuses

from brushexp.contracts.members import DPI
from brushexp.painting.reopen import export_job
from brushexp.registry import build_named
from brushexp.shading.light import Light
from brushexp.strokes.saved import Saved

SIZE = (24, 40)
N = 11


def job_of(**changes):
    strokes = some_strokes(N, SIZE)
    ground = torch.tensor([0.9, 0.8, 0.7])
    saved = Saved(strokes, torch.arange(N, dtype=torch.int32).flip(0), SIZE, ground, renderer="analytic")
    return replace(export_job(saved), **changes)


def layers_of(path):
    """Return an OpenRaster file's description, and its layers, bottom to top, as names and pixels in [0, 1]."""
    with ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("stack.xml"))
        layers = [*root.find("stack")][::-1]
        return root, [
            (one.get("name"), np.asarray(Image.open(BytesIO(archive.read(one.get("src")))), float) / 255)
            for one in layers
        ]


def shown(layers):
    below = np.zeros((*SIZE, 3))
    for _, pixels in layers:
        below = below + pixels[..., 3:] * (pixels[..., :3] - below)
    return 255 * below


CASES = {
    "plain": {},
    "light": {"light": Light(depth=1.0)},
    "pigments": {"space": build_named("color", "pigment", {})},
    "paper": {"paper": build_named("paper", "rough", {"tooth": 0.5, "grain": 200.0})},
}


@pytest.mark.parametrize("case", CASES)
def test_layers_show_the_painting_and_the_file_is_in_form(tmp_path, case):
    job = job_of(**CASES[case])
    (path,) = build_named("to", "ora", {"layers": 4, "dpi": 200.0}).write(job, tmp_path)
    with ZipFile(path) as archive:
        first = archive.infolist()[0]
        assert (first.filename, first.compress_type, first.header_offset) == ("mimetype", ZIP_STORED, 0)
        assert archive.read("mimetype") == b"image/openraster"
        merged, small = (
            np.asarray(Image.open(BytesIO(archive.read(name))))
            for name in ("mergedimage.png", "Thumbnails/thumbnail.png")
        )
    root, layers = layers_of(path)
    assert [root.get(key) for key in ("w", "h", "xres")] == ["40", "24", "200"]
    assert [name.split(",")[0] for name, _ in layers[:5]] == [
        "ground",
        "3 strokes",
        "3 strokes",
        "3 strokes",
        "2 strokes",
    ]
    assert [name for name, _ in layers[5:]] == ["light and paper"] * (case != "plain")
    assert np.array_equal(merged, job.picture())
    assert np.array_equal(small, merged)
    assert np.abs(shown(layers) - merged).max() <= 2.5
    again = build_named("to", "ora", {"layers": 4, "dpi": 200.0}).write(job, tmp_path / "..")[0]
    assert again.read_bytes() == path.read_bytes()


def test_a_layer_has_its_strokes_alone(tmp_path):
    job = job_of()
    (path,) = build_named("to", "ora", {"layers": N}).write(job, tmp_path)
    _, layers = layers_of(path)
    number = job.bottom_up[-1:]
    alone = replace(job.saved, strokes=job.strokes[number], depth=job.saved.depth[number])
    over = replace(job, saved=replace(alone, background=torch.zeros(3))).picture()
    _, pixels = layers[-1]
    assert np.abs(255 * pixels[..., 3:] * pixels[..., :3] - over).max() < 1.5
    assert (pixels[..., 3] == 0).any()


def test_a_transparent_painting_stays_so_and_one_without_strokes_is_its_ground(tmp_path):
    alpha = torch.zeros(SIZE, dtype=torch.uint8)
    alpha[:, 20:] = 255
    job = job_of()
    (path,) = build_named("to", "ora", {}).write(replace(job, saved=replace(job.saved, alpha=alpha)), tmp_path)
    _, layers = layers_of(path)
    assert all((pixels[:, :19, 3] == 0).all() for _, pixels in layers)
    assert np.abs(shown(layers) - job.picture())[:, 21:].max() <= 2.5
    bare = replace(job.saved, strokes=job.strokes[:0], depth=job.saved.depth[:0])
    (path,) = build_named("to", "ora", {}).write(replace(job, saved=bare), tmp_path)
    _, layers = layers_of(path)
    assert [name for name, _ in layers] == ["ground"]
    assert layers[0][1][0, 0].tolist() == pytest.approx([0.9, 0.8, 0.7, 1], abs=0.003)


def written(job, folder, **options):
    (path,) = build_named("to", "psd", options).write(job, folder)
    return path


def layers_in(path):
    """Read a PSD file's layers with psd-tools; return names and canvas-sized pixels in [0, 1], bottom to top."""
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
    plain = PSDImage.open(written(job, tmp_path, layers=4))
    assert plain.image_resources.get_data(Resource.RESOLUTION_INFO).horizontal == DPI * 2**16


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
    refuses(r"30000 pixels per side.* to=ora", written, wide, tmp_path)
