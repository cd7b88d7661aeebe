"""Pyramids: each level is the mean of the one below, viewers' files are the picture, their page draws near strokes."""

import base64
import io
import json
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
import torch
import zarr
from brushexp_canvases.page import CELL, of_all, write_page, write_strokes
from brushexp_canvases.pyramid import TILE, Level, describe, halved, level_of, write_dzi, write_iiif
from brushexp_canvases.source import open_source
from PIL import Image
from refusals import refuses
from skimage.data import astronaut

from brushexp.pages.replay import STEPS
from brushexp.pictures.load import load_picture
from brushexp.plugins.export.job import ExportJob, export_job
from brushexp.registry import build_named
from brushexp.shading.light import Light
from brushexp.strokes.bezier import curve_of, half_width_of
from brushexp.strokes.prior import sample_prior
from brushexp.strokes.saved import Saved
from brushexp.system.run_files import files_written, recorded


def job_of(height: int, width: int, renderer: str = "analytic") -> ExportJob:
    strokes = sample_prior(40).moved(zoom=2.0)
    depth = torch.arange(40, dtype=torch.int32)
    return export_job(Saved(strokes, depth, (height, width), torch.ones(3), renderer=renderer))


def levels_of(picture: np.ndarray) -> list[Level]:
    pictures = [picture]
    while max(pictures[-1].shape[1:]) > TILE:
        pictures.append(halved(pictures[-1]))
    return [level_of(each) for each in pictures]


def size_of(path: Path) -> tuple[int, int]:
    with Image.open(path) as picture:
        return picture.size


def smooth(height: int, width: int) -> np.ndarray:
    y, x = np.mgrid[:height, :width]
    return np.stack([255 * x / width, 255 * y / height, np.full((height, width), 90)]).astype(np.uint8)


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (5, 4), (8, 8)])
def test_halving_is_the_mean_of_four_pixels(size: tuple[int, int]) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (3, *size)).astype(np.uint8)
    half = halved(picture)
    assert half.shape == (3, -(-size[0] // 2), -(-size[1] // 2))
    for y in range(half.shape[1]):
        for x in range(half.shape[2]):
            rows, columns = [min(2 * y + i, size[0] - 1) for i in (0, 1)], [min(2 * x + i, size[1] - 1) for i in (0, 1)]
            mean = picture[:, rows][:, :, columns].astype(float).mean((1, 2))
            np.testing.assert_allclose(half[:, y, x], mean, atol=0.5)


def put_together(folder: Path, size: tuple[int, int]) -> np.ndarray:
    picture = np.zeros((*size, 3), np.uint8)
    for path in folder.glob("*.jpg"):
        left, top = (TILE * int(number) for number in path.stem.split("_"))
        tile = np.asarray(Image.open(path))
        picture[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    return picture


def test_the_tiles_of_a_deep_zoom_image_are_the_picture_at_each_level(tmp_path: Path) -> None:
    picture = smooth(700, 1100)
    write_dzi(tmp_path, "painting", levels_of(picture))
    description = (tmp_path / "painting.dzi").read_text()
    assert 'Width="1100" Height="700"' in description
    folders = sorted((tmp_path / "painting_files").iterdir(), key=lambda path: int(path.name))
    assert [int(path.name) for path in folders] == list(range(12))  # from one pixel: 2 ** 11 is more than 1100
    whole = put_together(folders[-1], (700, 1100)).transpose(2, 0, 1)
    assert np.abs(whole.astype(int) - picture).mean() < 1
    half = put_together(folders[-2], (350, 550)).transpose(2, 0, 1)
    assert np.abs(half.astype(int) - halved(picture)).mean() < 1
    assert size_of(folders[0] / "0_0.jpg") == (1, 1)


def test_what_an_image_of_iiif_promises_is_there_and_its_address_is_one(tmp_path):
    picture = smooth(700, 1100)
    write_iiif(tmp_path, {"painting": levels_of(picture)}, "a title", "https://example.org/x/")
    info = json.loads((tmp_path / "painting" / "info.json").read_text())
    assert (info["id"], info["width"], info["height"]) == ("https://example.org/x/painting", 1100, 700)
    (tiles,) = info["tiles"]
    for factor in tiles["scaleFactors"]:
        side = tiles["width"] * factor
        for top in range(0, 700, side):
            for left in range(0, 1100, side):
                right, bottom = min(1100, left + side), min(700, top + side)
                size = -(-(right - left) // factor), -(-(bottom - top) // factor)
                is_whole = (right - left, bottom - top) == (1100, 700)
                part = "full" if is_whole else f"{left},{top},{right - left},{bottom - top}"
                path = tmp_path / "painting" / part / f"{size[0]},{size[1]}" / "0" / "default.jpg"
                assert size_of(path) == size
    for size in info["sizes"]:
        path = tmp_path / "painting" / "full" / f"{size['width']},{size['height']}" / "0" / "default.jpg"
        assert size_of(path) == (size["width"], size["height"])
    assert size_of(tmp_path / "painting" / "full" / "max" / "0" / "default.jpg") == (1100, 700)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    canvas = manifest["items"][0]
    assert (manifest["id"], canvas["width"]) == ("https://example.org/x/manifest.json", 1100)
    assert canvas["items"][0]["items"][0]["body"]["service"][0]["id"] == info["id"]
    refuses("base=nowhere", write_iiif, tmp_path, {"painting": levels_of(smooth(9, 9))}, "x", "nowhere")


def test_iiif_goes_into_a_new_folder_of_a_run_whose_files_are_noted(tmp_path: Path) -> None:
    (tmp_path / ".hydra").mkdir()
    with recorded(tmp_path):
        write_iiif(tmp_path / "iiif", {"painting": levels_of(smooth(9, 9))}, "x")
    assert {path.name for path in files_written(tmp_path)} == {"manifest.json", "info.json", "default.jpg"}


@pytest.mark.parametrize("form", ["dzi", "iiif", "zarr"])
def test_pyramids_of_a_painting_are_crisp_at_any_size(form: str, tmp_path: Path) -> None:
    job = job_of(60, 90)
    large = job.scaled(8)
    (path,) = build_named("to", form, {}).write(large, tmp_path)
    with ZipFile(path) as archive:
        archive.extractall(main := tmp_path / "unpacked.ome.zarr")
    expected = large.picture().astype(int)
    if form == "zarr":
        found = np.concatenate([rows for _, rows in open_source(main).strips()], axis=1).transpose(1, 2, 0)
        assert np.array_equal(found, expected)
    else:
        whole = {"dzi": "painting_files/10", "iiif": "painting/full/max/0"}[form]
        folder = main / whole
        found = put_together(folder, (480, 720)) if form == "dzi" else np.asarray(Image.open(folder / "default.jpg"))
        assert np.abs(found.astype(int) - expected).mean() < 2


def written(path: Path, picture: Image.Image, **options: object) -> Path:
    picture.save(path, **options)
    return path


FILES = {
    "rgb.png": lambda path: written(path, Image.fromarray(astronaut()[:90, :70])),
    "grey.png": lambda path: written(path, Image.fromarray(astronaut()[:90, :70]).convert("L")),
    "palette.png": lambda path: written(path, Image.fromarray(astronaut()[:90, :70]).convert("P")),
    "alpha.png": lambda path: written(
        path, Image.fromarray(np.dstack([astronaut()[:90, :70], astronaut()[:90, :70, 0]]))
    ),
    "grey16.png": lambda path: written(path, Image.fromarray(astronaut()[:90, :70, 0].astype(np.uint16) * 257)),
    "turned.jpg": lambda path: written(path, Image.fromarray(astronaut()[:90, :70]), quality=95, exif=turned()),
    "rgb.tif": lambda path: written(path, Image.fromarray(astronaut()[:90, :70]), compression="tiff_lzw"),
}


def turned() -> Image.Exif:
    exif = Image.Exif()
    exif[0x0112] = 6
    return exif


@pytest.mark.parametrize("name", FILES)
def test_large_pictures_are_read_as_small_ones_are(name: str, tmp_path: Path) -> None:
    path = FILES[name](tmp_path / name)
    source = open_source(path)
    found = np.concatenate([rows for _, rows in source.strips()], axis=1)
    expected = 255 * load_picture(str(path), None).numpy()
    assert source.size == expected.shape[1:]
    assert np.abs(found - expected).max() <= 2


JP2 = {
    "rgb": astronaut()[:290, :70],
    "alpha": np.dstack([astronaut()[:290, :70], astronaut()[:290, :70, 0]]),
    "grey": astronaut()[:290, :70, 0],
    "grey16": astronaut()[:290, :70, 0].astype(np.uint16) * 257,
}


@pytest.mark.parametrize("kind", JP2)
def test_jpeg_2000_is_read_by_windows(kind: str, tmp_path: Path) -> None:
    pytest.importorskip("rasterio")
    path = written(tmp_path / "a.jp2", Image.fromarray(JP2[kind]))
    source = open_source(path)
    found = np.concatenate([rows for _, rows in source.strips()], axis=1)
    png = written(tmp_path / "a.png", Image.fromarray(JP2[kind]))
    expected = np.concatenate([rows for _, rows in open_source(png).strips()], axis=1)
    assert source.size == (290, 70)
    assert np.abs(found.astype(int) - expected).max() <= 1
    path.write_bytes(path.read_bytes()[:200])
    refuses(r"a\.jp2", lambda: list(open_source(path).strips()))
    refuses("resolution=45", open_source, path, 45)


@pytest.mark.filterwarnings("ignore:Dataset has no geotransform")
@pytest.mark.parametrize("bits", [12, 16])
def test_deep_jpeg_2000_keeps_its_white(bits: int, tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    picture, white = astronaut()[:290, :70].transpose(2, 0, 1), 2**bits - 1
    picture = np.concatenate([picture, np.full_like(picture, 255)], axis=2)
    kind = {"driver": "JP2OpenJPEG", "dtype": "uint16", "count": 3, "height": 290, "width": 140, "nbits": bits}
    options = {"tiled": True, "blockxsize": 64, "blockysize": 64, "quality": 100, "reversible": "yes"}
    with rasterio.open(tmp_path / "a.jp2", "w", **kind, **options) as file:
        file.write((picture / 255 * white).round().astype(np.uint16))
    found = np.concatenate([rows for _, rows in open_source(tmp_path / "a.jp2").strips()], axis=1)
    assert np.abs(found.astype(int) - picture).max() <= 1


@pytest.mark.parametrize(
    ("dtype", "shape"), [("uint8", (3, 30, 20)), ("uint16", (1, 3, 1, 30, 20)), ("uint16", (30, 20))]
)
def test_ome_zarr_is_read_in_8_and_16_bits(dtype: str, shape: tuple[int, ...], tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, shape)
    group = zarr.create_group(tmp_path / "a.zarr", attributes={"ome": describe("a", 1)})
    scale = np.iinfo(dtype).max // 255
    group.create_array("0", data=(pixels * scale).astype(dtype), chunks=shape)
    found = np.concatenate([rows for _, rows in open_source(tmp_path / "a.zarr").strips()], axis=1)
    assert np.array_equal(found, np.broadcast_to(pixels.reshape(-1, 30, 20), (3, 30, 20)))


def test_a_picture_is_resampled_while_it_is_read_and_told_if_it_ends_too_soon(tmp_path):
    path = FILES["rgb.png"](tmp_path / "rgb.png")
    source = open_source(path, 45)
    found = np.concatenate([rows for _, rows in source.strips()], axis=1)
    assert found.shape == (3, 45, 35)
    assert np.abs(found - 255 * load_picture(str(path), 45).numpy()).mean() < 4
    whole = FILES["rgb.png"](tmp_path / "rgb.png").read_bytes()
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
    refuses(r"cut\.png", lambda: list(open_source(tmp_path / "cut.png").strips()))
    (tmp_path / "text.png").write_text("no picture")
    refuses(r"text\.png", open_source, tmp_path / "text.png")
    (tmp_path / "empty.zarr").mkdir()
    refuses(r"empty\.zarr", open_source, tmp_path / "empty.zarr")


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
    """Points (x, y) of the strokes of a cell, from its corner, by the bits of their colours, the bottom one first."""
    name, packed = json.loads("[" + path.read_text().removeprefix("brushexp.cell(").removesuffix(");\n") + "]")
    assert name == path.stem
    data, count, result = base64.b64decode(packed["data"]), packed["count"], {}
    at = 4 * count
    for key, each, low, high in packed["columns"]:
        shares = np.frombuffer(data, "<u2", count * each, at).reshape(count, each) / STEPS
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
        assert list(found) == sorted(found)  # of which the depth is the number
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
