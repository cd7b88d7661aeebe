"""Test in a real browser that the viewer page loads only nearby strokes, and draws them as the painting shows them."""

import base64
import io
import json
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
import torch
from brushexp_canvases.page import CELL, of_all, write_page, write_strokes
from brushexp_canvases.pyramid import write_dzi
from PIL import Image
from test_pyramids import job_of, levels_of

from brushexp.pages.replay import LEVELS
from brushexp.plugins.export.base import ExportJob
from brushexp.registry import build_named
from brushexp.shading.light import Light
from brushexp.strokes.bezier import curve_of, half_width_of

DRAW = """(tile) => new Promise((done) => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const finish = (bitmap) => {
    const canvas = Object.assign(document.createElement("canvas"), { width: bitmap.width, height: bitmap.height });
    canvas.getContext("2d").drawImage(bitmap, 0, 0);
    done(canvas.toDataURL());
  };
  window.brushexp.stroke_tiles(data).downloadTileStart({ tile, finish, fail: done });
})"""


def unpacked(path: Path, job: ExportJob) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Read a cell's strokes from bottom to top; map their indices to points (x, y) relative to the cell's corner."""
    name, packed = json.loads("[" + path.read_text().removeprefix("brushexp.cell(").removesuffix(");\n") + "]")
    assert name == path.stem
    data, count, result = base64.b64decode(packed["data"]), packed["count"], {}
    at = 4 * count
    for key, each, low, high in packed["columns"]:
        shares = np.frombuffer(data, "<u2", count * each, at).reshape(count, each) / LEVELS
        result[key], at = low + shares * (high - low), at + 2 * count * each
    assert at == len(data)
    numbers = [int(np.abs(job.strokes.color.numpy() - paint).sum(1).argmin()) for paint in result["paint"]]
    return dict(zip(numbers, result["points"], strict=True))


def test_each_cell_has_the_strokes_that_reach_it_in_their_order(tmp_path: Path) -> None:
    job = job_of(60, 90).scaled(14)
    write_strokes(tmp_path, job.size, of_all(job))
    curve, half = curve_of(job.strokes), half_width_of(job.strokes)
    for path in (tmp_path / "strokes_files").iterdir():
        corner = CELL * np.array([int(number) for number in path.stem.split("_")])
        found = unpacked(path, job)
        assert list(found) == sorted(found)  # a stroke's number is its depth
        for number, points in found.items():
            np.testing.assert_allclose(points.reshape(3, 2) + corner, curve[number].numpy(), atol=0.1)
        for number in {*range(len(half))} - {*found}:
            low, high = curve[number].min(0).values - half[number], curve[number].max(0).values + half[number]
            assert bool(((high < torch.from_numpy(corner)) | (low > torch.from_numpy(corner + CELL))).any())


@pytest.fixture(scope="module", params=["analytic", "textured"])
def shown(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ExportJob]:
    job = job_of(60, 90, renderer=request.param).scaled(12)  # larger than a screen
    (path,) = build_named("to", "dzi", {}).write(job, folder := tmp_path_factory.mktemp("page"))
    with ZipFile(path) as archive:
        archive.extractall(folder)
    return folder / "view.html", job


@pytest.mark.parametrize("place", [(1, 1), (2, 0)])
def test_strokes_that_are_near_look_like_the_painting_twice_as_large(shown, opened, place):
    path, job = shown
    watched = opened(path)
    address = watched.evaluate(DRAW, {"level": 12, "x": place[0], "y": place[1]})
    found = np.asarray(Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))).convert("RGB"))
    top, left = 512 * place[1], 512 * place[0]
    expected = job.scaled(2).picture()[top : top + 512, left : left + 512]
    assert found.shape == expected.shape
    assert expected.std() > 2
    assert np.abs(found.astype(int) - expected).mean() < 4
    assert not watched.errors


@pytest.mark.parametrize("size", [(1280, 800), (390, 800)])
def test_strokes_are_loaded_when_they_are_near(shown: tuple[Path, ExportJob], opened, size: tuple[int, int]) -> None:
    watched = opened(shown[0], size)
    watched.page.wait_for_selector("#viewer canvas")
    with watched.page.expect_request("**/strokes_files/*_*.js"):
        assert not [address for address in watched.requests if "strokes_files" in address]
        watched.page.click("[data-zoom=one]")
        for _ in range(2):
            watched.page.click("[data-zoom=in]")
    assert not watched.is_too_wide()
    assert not watched.errors
    assert not watched.foreign


def test_differences_are_shown_four_times_as_bright(opened, tmp_path: Path) -> None:
    for name, level in (("painting", 100), ("target", 110)):
        write_dzi(tmp_path, name, levels_of(np.full((3, 300, 500), level, np.uint8)))
    watched = opened(write_page(tmp_path, (300, 500), ["painting", "target"], "a title", "lead"))
    watched.page.select_option("#layer", "difference")
    watched.evaluate("() => { curtain.value = 50; curtain.dispatchEvent(new Event('input')); }")
    watched.page.wait_for_timeout(300)  # tiles fade in
    shot = Image.open(io.BytesIO(watched.page.locator("#viewer").screenshot())).convert("L")
    middle = np.asarray(shot)[shot.height // 2]
    np.testing.assert_allclose(middle[shot.width // 2 - 20], 100, atol=1)
    np.testing.assert_allclose(middle[shot.width // 2 + 20], 40, atol=4)
    assert not watched.errors


def test_a_painting_under_a_lamp_has_its_height_as_a_layer(tmp_path: Path) -> None:
    job = replace(job_of(60, 90), light=Light(depth=1))
    (path,) = build_named("to", "dzi", {}).write(job, tmp_path)
    with ZipFile(path) as archive:
        found = np.asarray(Image.open(io.BytesIO(archive.read("height_files/7/0_0.jpg"))), float)[..., 0]
        page = archive.read("view.html").decode()
    height = job.height()
    assert np.abs(found - 255 * height / height.max()).mean() < 3
    assert "<option>height</option>" in page
    assert "difference</option>" not in page
