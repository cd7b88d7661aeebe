"""Test that each pyramid level averages the next larger one, and that the tiles for viewers form the picture."""

import json
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
import torch
import zarr
from brushexp_canvases.pyramid import TILE, Level, describe, halve_pixels, level_of, write_dzi, write_iiif
from brushexp_canvases.source import open_source
from PIL import Image
from refusals import refuses
from skimage.data import astronaut

from brushexp.painting.reopen import export_job
from brushexp.pictures.load import load_picture
from brushexp.plugins.export.base import ExportJob
from brushexp.registry import build_named
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
        pictures.append(halve_pixels(pictures[-1]))
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
    half = halve_pixels(picture)
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
    assert np.abs(half.astype(int) - halve_pixels(picture)).mean() < 1
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
