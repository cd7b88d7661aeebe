"""Picture files whose pixels are not square, and files that end before their picture does."""

import io
import logging
import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from brushexp.errors import UserError
from brushexp.pictures.cut_short import has_end
from brushexp.pictures.decode import decode_image, picture_size, read_picture
from brushexp.pictures.kinds import has_codec
from brushexp.pictures.load import load_picture, size_of_picture

HEIGHT, WIDTH = 30, 40
ROWS, COLUMNS = np.mgrid[:HEIGHT, :WIDTH]
SMOOTH = np.stack([6 * COLUMNS, 8 * ROWS, 3 * (ROWS + COLUMNS)], 2).astype(np.uint8)
NOISE = np.random.default_rng(3).integers(0, 256, (90, 120, 3), dtype=np.uint8)


def refusal(path: Path) -> str:
    with pytest.raises(UserError) as caught:
        load_picture(str(path), None)
    with pytest.raises(UserError):
        size_of_picture(str(path), "image")  # before a run has a folder
    return str(caught.value)


def file_of(pixels: np.ndarray, kind: str, **options: object) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, kind, **options)
    return file.getvalue()


def with_phys(unit: int, across: int, down: int) -> bytes:
    png, said = file_of(SMOOTH, "PNG"), b"pHYs" + struct.pack(">IIB", across, down, unit)
    return png[:33] + struct.pack(">I", 9) + said + struct.pack(">I", zlib.crc32(said)) + png[33:]


def with_jfif(unit: int, across: int, down: int) -> bytes:
    jpeg = file_of(SMOOTH, "JPEG", quality=95)
    at = jpeg.index(b"JFIF") + 7
    return jpeg[:at] + struct.pack(">BHH", unit, across, down) + jpeg[at + 5 :]


def gif(byte: int) -> bytes:
    whole = bytearray(file_of(SMOOTH, "GIF"))
    whole[12] = byte
    return bytes(whole)


def with_pasp(wide: int, high: int) -> bytes:
    """Say in an AVIF how wide and high its pixels are, in place of its bits per channel, which take as many bytes."""
    whole = file_of(SMOOTH, "AVIF", quality=95, subsampling="4:4:4")
    at = whole.index(b"\0\0\0\x10pixi") + 4
    return whole[:at] + b"pasp" + struct.pack(">II", wide, high) + whole[at + 12 :]


def with_resc(across: int, down: int) -> bytes:
    """Say in a JPEG 2000 how many pixels a metre has, in the last box of its header."""
    whole = file_of(SMOOTH, "JPEG2000")
    at = whole.index(b"jp2h") - 4
    (length,) = struct.unpack_from(">I", whole, at)
    said = struct.pack(">I4sI4sHHHHBB", 26, b"res ", 18, b"resc", down, 1, across, 1, 0, 0)
    return whole[:at] + struct.pack(">I", length + 26) + whole[at + 4 : at + length] + said + whole[at + length :]


def psd(aspect: float) -> bytes:
    """Write a picture of Photoshop: header, no palette, the resource that tells the aspect, no layers, planes."""
    head = struct.pack(">4sH6xHIIHH", b"8BPS", 1, 3, HEIGHT, WIDTH, 8, 3)
    resource = struct.pack(">4sHHIId", b"8BIM", 1064, 0, 12, 1, aspect)
    planes = SMOOTH.transpose(2, 0, 1).tobytes()
    return head + struct.pack(">II", 0, len(resource)) + resource + struct.pack(">IH", 0, 0) + planes


def rational(kind: str) -> bytes:
    return file_of(SMOOTH, kind, dpi=(200, 100), **({"quality": 95} if kind == "JPEG" else {}))


DOUBLE_HEIGHT = [with_phys(0, 2, 1), with_phys(1, 11811, 5906), with_jfif(0, 2, 1), with_jfif(1, 144, 72)]
DOUBLE_HEIGHT += [rational("TIFF"), rational("BMP"), rational("PNG"), gif(17)]
DOUBLE_HEIGHT += [with_pasp(1, 2), with_resc(11811, 5906), psd(0.5)]


@pytest.mark.parametrize("data", DOUBLE_HEIGHT)
def test_pixels_that_are_half_as_wide_as_high_are_made_square(tmp_path, data):
    path = tmp_path / "a"
    path.write_bytes(data)
    found = read_picture(path)
    assert found.shape == (2 * HEIGHT, WIDTH, 3)
    assert picture_size(path) == found.shape[:2]
    between = found.reshape(HEIGHT, 2, WIDTH, 3).mean(1)  # each row became two
    worst = 60 if data[:3] == b"GIF" else 12
    assert np.abs(between - SMOOTH)[2:-2].max() < worst
    with Image.open(path) as picture:
        assert np.array_equal(decode_image(picture), found)


@pytest.mark.parametrize("data", [
    with_phys(0, 1, 2), with_jfif(0, 1, 2), gif(113), file_of(SMOOTH, "TIFF", dpi=(72, 144)),
    with_pasp(2, 1), with_resc(5906, 11811), psd(2),
])  # fmt: skip
def test_pixels_that_are_twice_as_wide_as_high_are_made_square(tmp_path, data):
    (tmp_path / "a").write_bytes(data)
    assert read_picture(tmp_path / "a").shape == (HEIGHT, 2 * WIDTH, 3)
    assert picture_size(tmp_path / "a") == (HEIGHT, 2 * WIDTH)


def test_pixels_are_turned_with_the_picture(tmp_path):
    exif = Image.Exif()
    exif[274] = 6  # a quarter turn
    Image.fromarray(SMOOTH).save(path := tmp_path / "a.png", exif=exif, dpi=(200, 100))
    assert read_picture(path).shape == (WIDTH, 2 * HEIGHT, 3)
    assert picture_size(path) == (WIDTH, 2 * HEIGHT)


@pytest.mark.parametrize("data", [
    with_phys(1, 2835, 2834), with_phys(0, 0, 0), with_phys(0, 1, 100), with_jfif(0, 0, 1), with_jfif(2, 0, 0), gif(49),
    file_of(SMOOTH, "TIFF"), file_of(SMOOTH, "WEBP", lossless=True),
])  # fmt: skip
def test_numbers_that_are_rounded_or_impossible_leave_pixels_alone(tmp_path, data):
    (tmp_path / "a").write_bytes(data)
    assert read_picture(tmp_path / "a").shape == (HEIGHT, WIDTH, 3)
    assert picture_size(tmp_path / "a") == (HEIGHT, WIDTH)


def test_pages_that_are_not_painted_are_told(tmp_path, caplog):
    with tifffile.TiffWriter(path := tmp_path / "a.tif") as tiff:
        for kind in (0, 0, 0, 1):  # the last is a smaller copy
            tiff.write(SMOOTH, photometric="rgb", subfiletype=kind)
    with caplog.at_level(logging.WARNING):
        assert np.array_equal(read_picture(path), SMOOTH)
    assert "has 3 pages, and the first is taken" in caplog.text


@pytest.mark.parametrize("fewer", [2, 40, 0.1, 0.5, 0.9])
@pytest.mark.parametrize(("kind", "options"), [
    ("WEBP", {"lossless": True}), ("WEBP", {"quality": 60}), ("AVIF", {}), ("HEIF", {}),
    ("JPEG2000", {}), ("JPEG2000", {"no_jp2": True}),
])  # fmt: skip
def test_a_file_that_ends_too_soon_is_told_so(tmp_path, kind, options, fewer):
    if kind == "HEIF":
        pytest.importorskip("pillow_heif").register_heif_opener()
    whole = file_of(NOISE, kind, **options)
    path = tmp_path / "a"
    path.write_bytes(whole)
    assert has_end(path)
    path.write_bytes(whole[: -fewer if fewer > 1 else int(len(whole) * (1 - fewer))])
    assert has_end(path) is False
    assert refusal(path).endswith("is cut short: its file ends before the picture does; get the whole file")


@pytest.mark.parametrize("fewer", [2, 0.5, 0.9])
def test_a_cut_jpeg_xl_whose_length_stands_nowhere_may_be_cut_or_damaged(tmp_path, fewer):
    pytest.importorskip("pillow_jxl")
    has_codec("jxl")
    whole = file_of(NOISE, "JXL", lossless=True)
    path = tmp_path / "a"
    path.write_bytes(whole)
    assert read_picture(path).shape == NOISE.shape
    path.write_bytes(whole[: -fewer if fewer > 1 else int(len(whole) * (1 - fewer))])
    assert "is cut short, damaged or cannot be decoded" in refusal(path)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "GIF", "QOI", "TIFF", "BMP", "TGA"])
def test_the_end_of_a_file_is_known_where_its_format_says_it(tmp_path, kind):
    whole = file_of(NOISE, kind, **({"compression": "tiff_lzw"} if kind == "TIFF" else {}))
    (tmp_path / "a").write_bytes(whole)
    (tmp_path / "b").write_bytes(whole[:-200])
    expected = (None, None) if kind in ("BMP", "TGA") else (None, False) if kind == "TIFF" else (True, False)
    assert (has_end(tmp_path / "a"), has_end(tmp_path / "b")) == expected


def test_the_end_of_a_thumbnail_is_not_that_of_its_picture(tmp_path, caplog):
    whole = file_of(SMOOTH.repeat(4, 0).repeat(4, 1), "JPEG")
    thumbnail = b"Exif\0\0" + file_of(SMOOTH, "JPEG")
    segment = b"\xff\xe1" + struct.pack(">H", len(thumbnail) + 2) + thumbnail
    (tmp_path / "a.jpg").write_bytes((whole[:2] + segment + whole[2:])[:-2])
    with caplog.at_level(logging.WARNING):
        assert read_picture(tmp_path / "a.jpg").shape == (4 * HEIGHT, 4 * WIDTH, 3)
    assert "is cut short, and painted as it is" in caplog.text


@pytest.mark.parametrize("progressive", [True, False])
def test_a_jpeg_that_lacks_a_few_bytes_is_painted_and_told_and_one_that_lacks_much_is_refused(
    tmp_path, caplog, progressive
):
    path, file = tmp_path / "cut.jpg", io.BytesIO()
    Image.fromarray(NOISE.repeat(3, 0).repeat(3, 1)).save(file, "JPEG", quality=90, progressive=progressive)
    whole = np.asarray(Image.open(file)).astype(int)
    for fewer in (2, 40):
        path.write_bytes(file.getvalue()[:-fewer])
        with caplog.at_level(logging.WARNING):
            found = read_picture(path).astype(int)
        assert (np.abs(found - whole).max(2) > 9).mean() < 0.02
        assert "is cut short, and painted as it is" in caplog.text
        assert size_of_picture(str(path), "image") == whole.shape[:2]
        os.utime(path, ns=(fewer, fewer))
    if not progressive:  # else the whole picture is there, only coarser
        path.write_bytes(file.getvalue()[: len(file.getvalue()) * 6 // 10])
        assert "it is cut short: 4" in (message := refusal(path))
        assert "% of the picture are missing); get the whole file" in message
