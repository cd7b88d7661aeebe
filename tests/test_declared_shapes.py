"""Tests that the crop, rotation, mirroring and pixel shape declared in a picture file are respected."""

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from containers import Box, clap, film_with, picture_with
from PIL import Image
from test_pictures import ORIENTED

from brushexp.pictures.decode import decode_image, picture_size, read_picture
from brushexp.pictures.kinds import has_codec
from brushexp.pictures.srgb import ORIENTATION, upright

HEIGHT, WIDTH = 48, 64
PICTURE = np.stack(
    [*(4 * axis for axis in np.mgrid[0:HEIGHT, 0:WIDTH]), np.full((HEIGHT, WIDTH), 90)], 2
).astype(np.uint8)  # fmt: skip
CODED = 8  # largest mean change by coding, in levels
CROP, SHOWN = clap(32, 24, -16, 8), PICTURE[16:40, 8:40]
TURNS: dict[bytes | None, int] = {None: 0, b"\0": 0, b"\1": 1, b"\2": 2, b"\3": 3}
MIRRORS = {None: lambda a: a, b"\0": np.flipud, b"\1": np.fliplr}


def file_of(kind: str, properties: list[Box]) -> bytes:
    has_codec("heic")
    file = io.BytesIO()
    Image.fromarray(PICTURE).save(file, kind, quality=95)
    return picture_with(file.getvalue(), properties) if properties else file.getvalue()


def expect(path: Path, expected: np.ndarray, atol: float = CODED) -> None:
    found = read_picture(path)
    assert found.shape == expected.shape == (*picture_size(path), 3)
    assert np.abs(found.astype(int) - expected).mean() < atol


@pytest.mark.parametrize("mirror", MIRRORS)
@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("crop", [None, CROP])
@pytest.mark.parametrize("kind", ["AVIF", "HEIF"])
def test_what_the_boxes_of_a_picture_declare_is_done_in_their_order(tmp_path, kind, crop, turn, mirror):
    if kind == "HEIF":
        pytest.importorskip("pillow_heif")
    boxes = [*([crop] if crop else []), *([(b"irot", turn)] if turn else []), *([(b"imir", mirror)] if mirror else [])]
    (tmp_path / "a").write_bytes(file_of(kind, boxes))
    expect(tmp_path / "a", MIRRORS[mirror](np.rot90(SHOWN if crop else PICTURE, TURNS[turn])))


@pytest.mark.parametrize(("box", "shown"), [
    (clap(31, 23, 1, -1), PICTURE[12:35, 17:48]),  # with odd sides, the middle lies in a pixel
    (clap(64, 48, 0, 0), PICTURE), (clap(1, 1, -63, -47), PICTURE[:1, :1]),
    (clap(32, 24, -16, 8, parts=0), PICTURE),  # crops outside the picture are ignored
    (clap(300, 24, 0, 0), PICTURE), (clap(32, 24, 200, 0), PICTURE), (clap(0, 0, 0, 0), PICTURE),
])  # fmt: skip
def test_a_crop_of_an_avif_is_that_of_its_pixels_and_an_impossible_one_is_none(tmp_path, box, shown):
    (tmp_path / "a").write_bytes(file_of("AVIF", [box]))
    expect(tmp_path / "a", shown, 30 if shown.shape[0] == 1 else CODED)


def test_each_picture_of_an_avif_that_moves_is_cropped_by_its_track(tmp_path):
    clips = pytest.importorskip("brushexp_films.clips")
    file, frames = io.BytesIO(), [Image.fromarray(np.roll(PICTURE, 4 * k, 0)) for k in range(3)]
    frames[0].save(file, "AVIF", save_all=True, append_images=frames[1:], duration=100, quality=95)
    path = tmp_path / "a.avif"
    path.write_bytes(film_with(file.getvalue(), b"av01", [CROP]))
    expect(path, SHOWN)
    shown = [*clips.timed_pictures(clips.open_clip(path))]
    assert len(shown) == 3
    for one, frame in zip(shown, frames, strict=True):
        assert np.abs(one.picture.astype(int) - np.asarray(frame)[16:40, 8:40]).mean() < CODED


@pytest.mark.parametrize("kind", ["AVIF", "HEIF"])
@pytest.mark.parametrize(("turn", "size"), [(0, (HEIGHT, 2 * WIDTH)), (1, (2 * WIDTH, HEIGHT))])
def test_pixels_that_are_not_square_are_turned_with_the_picture(tmp_path, kind, turn, size):
    if kind == "HEIF":
        pytest.importorskip("pillow_heif")
    (tmp_path / "a").write_bytes(file_of(kind, [(b"pasp", struct.pack(">II", 2, 1)), (b"irot", bytes([turn]))]))
    wide = np.asarray(Image.fromarray(PICTURE).resize((2 * WIDTH, HEIGHT), Image.Resampling.LANCZOS))
    assert picture_size(tmp_path / "a") == size
    expect(tmp_path / "a", np.rot90(wide, turn))


def tga(across: int, down: int) -> bytes:
    """Return a TGA file whose extension area declares the width and height of its pixels."""
    file = io.BytesIO()
    Image.fromarray(PICTURE).save(file, "TGA")
    picture = file.getvalue()
    picture = picture.partition(b"TRUEVISION-XFILE")[0][:-8] if b"TRUEVISION-XFILE" in picture else picture
    extension = bytearray(495)
    struct.pack_into("<H", extension, 0, 495)
    struct.pack_into("<HH", extension, 474, across, down)
    return picture + bytes(extension) + struct.pack("<II18s", len(picture), 0, b"TRUEVISION-XFILE.\0")


@pytest.mark.parametrize(("across", "down", "size"), [
    (2, 1, (HEIGHT, 2 * WIDTH)), (1, 2, (2 * HEIGHT, WIDTH)), (0, 0, (HEIGHT, WIDTH)), (1, 0, (HEIGHT, WIDTH)),
])  # fmt: skip
def test_the_pixels_of_a_tga_are_as_wide_as_its_extension_says(tmp_path, across, down, size):
    (tmp_path / "a.tga").write_bytes(tga(across, down))
    assert read_picture(tmp_path / "a.tga").shape[:2] == picture_size(tmp_path / "a.tga") == size


@pytest.mark.parametrize("number", [-1, 0, 9, 77, 65535])
@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP", "TIFF", "deep"])
def test_an_orientation_that_there_is_not_counts_as_upright(tmp_path, kind, number):
    if number < 0:
        pytest.skip("EXIF writes no such number") if kind != "deep" else None
    path = tmp_path / "a"
    if kind == "deep":
        tifffile = pytest.importorskip("tifffile")
        tags = [(ORIENTATION, "h" if number < 0 else "H", 1, number, True)]
        tifffile.imwrite(path, PICTURE.astype(np.uint16) * 257, photometric="rgb", extratags=tags)
    else:
        exif = Image.Exif()
        exif[ORIENTATION] = number
        Image.fromarray(PICTURE).save(path, kind, exif=exif.tobytes())
    found = read_picture(path)
    assert found.shape == (*picture_size(path), 3) == PICTURE.shape
    found = found if found.dtype == np.uint8 else 255 * found
    assert np.abs(found.astype(float) - PICTURE).mean() < CODED


@pytest.mark.parametrize("orientation", ORIENTED)
def test_a_picture_in_memory_is_turned_by_its_exif_data(orientation):
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    file = io.BytesIO()
    Image.fromarray(PICTURE).save(file, "PNG", exif=exif)
    assert np.array_equal(decode_image(Image.open(file)), ORIENTED[orientation](PICTURE))
    assert np.array_equal(upright(PICTURE, orientation), ORIENTED[orientation](PICTURE))
