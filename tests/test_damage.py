"""Tests that damage in pictures is detected where possible, and that messages name the formats that cannot be read."""

import io
import logging
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from refusals import refusal
from skimage.data import astronaut
from test_pictures import chunk, encoded
from tifffile import imwrite
from tiffs import DEFLATE, OLD_DEFLATE, Layout, ramps, tiff

from brushexp.pictures.damage import ONE_COLOR, SUMS_DIFFER
from brushexp.pictures.decode import decode_image, picture_size, read_picture
from brushexp.pictures.held import hold
from brushexp.pictures.jpeg_codes import jpeg_fits
from brushexp.pictures.kinds import DAMAGED, what_it_is
from brushexp.pictures.load import load_picture, size_of_picture
from brushexp.pictures.packing import MISCOUNTED, remark_on_packing

PICTURE = ramps(3, 8).astype(np.uint8)
PNG = encoded(Image.fromarray(PICTURE), "PNG")
PIXELS = range(PNG.index(b"IDAT") + 4, len(PNG) - 16)  # positions of the compressed pixels in the PNG


def flipped(data: bytes, at: int, bit: int = 0) -> bytes:
    return data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :]


@pytest.mark.parametrize("at", [60, *PIXELS[:: len(PIXELS) // 12]])
def test_a_flip_in_a_png_is_refused_before_anything_is_painted(tmp_path, at):
    path = tmp_path / "a.png"
    path.write_bytes(flipped(PNG, at))
    for read in (read_picture, picture_size):
        assert refusal(read, path) == f"image={path} {SUMS_DIFFER}"
    assert refusal(load_picture, str(path), 16) == refusal(size_of_picture, str(path), "image", 16)
    assert SUMS_DIFFER in refusal(hold, path.read_bytes())  # also through the studio and Python


def test_every_flip_in_the_pixels_of_a_png_is_told(tmp_path):
    path = tmp_path / "a.png"
    for at in PIXELS:
        path.write_bytes(flipped(PNG, at, at % 8))
        refusal(read_picture, path)


def test_no_flip_in_a_png_gives_another_picture(tmp_path):
    path = tmp_path / "a.png"
    for at in range(len(PNG)):
        path.write_bytes(flipped(PNG, at, at % 8))
        try:
            found = read_picture(path)
        except ValueError:
            continue
        assert np.array_equal(found, PICTURE), at


def test_an_error_while_exif_data_are_sought_is_that_of_the_decoder():
    with pytest.raises((OSError, SyntaxError)):  # not a black picture
        decode_image(Image.open(io.BytesIO(flipped(PNG, PIXELS[2], 4))))
    with Image.open(io.BytesIO(PNG)) as picture:
        assert np.array_equal(decode_image(picture), PICTURE)


@pytest.mark.parametrize("layout", [
    Layout(compression=DEFLATE), Layout(compression=OLD_DEFLATE, tile=(16, 16)),
    Layout(16, compression=DEFLATE, is_big=True, is_big_endian=True),
])  # fmt: skip
def test_a_flip_in_a_tiff_that_is_packed_by_deflate_is_refused(tmp_path, layout):
    whole = tiff(ramps(3, layout.bits), layout)
    path = tmp_path / "a.tif"
    path.write_bytes(whole)
    read_picture(path)
    for at in range(len(whole) // 2, len(whole), len(whole) // 60):
        path.write_bytes(flipped(whole, at))
        assert refusal(read_picture, path) == refusal(picture_size, path) == f"image={path} {SUMS_DIFFER}"


def test_bytes_behind_the_pieces_of_a_tiff_are_no_damage(tmp_path):
    whole = tiff(ramps(3, 8), Layout(compression=DEFLATE, rows=100))
    path = tmp_path / "a.tif"
    path.write_bytes(whole + b"more")
    assert np.array_equal(read_picture(path), PICTURE)


@pytest.mark.parametrize("methods", [b"\1\0\0", b"\0\1\0", b"\0\0\2"])
def test_a_png_of_a_later_kind_is_refused(tmp_path, methods):
    header = PNG[16:26] + methods
    (tmp_path / "a.png").write_bytes(PNG[:8] + chunk(b"IHDR", header) + PNG[33:])
    assert "is a PNG of a newer kind, which is not supported" in refusal(read_picture, tmp_path / "a.png")


@pytest.mark.parametrize("kind", ["PNG", "AVIF", "GIF", "JPEG"])
def test_a_picture_of_one_colour_is_told_to_be_one(tmp_path, caplog, kind):
    flat, path = Image.new("RGB", (24, 16), (0, 90, 0)), tmp_path / "a"
    flat.save(path, kind)
    with caplog.at_level(logging.WARNING):
        read_picture(path)
    assert f"image={path} {ONE_COLOR}" in caplog.text
    caplog.clear()
    for name, picture in (("one", flat.crop((0, 0, 1, 1))), ("many", Image.fromarray(PICTURE))):
        picture.save(tmp_path / name, kind)
        with caplog.at_level(logging.WARNING):
            read_picture(tmp_path / name)
        assert ONE_COLOR not in caplog.text


def psd(version: int = 1, depth: int = 8, mode: int = 3, channels: int = 3) -> bytes:
    head = struct.pack(">4sH6xHIIHH", b"8BPS", version, channels, 4, 4, depth, mode)
    return head + bytes(4 + 4 + 4 + 2) + bytes(channels * 16 * depth // 8)


def jpeg(marker: int, bits: int) -> bytes:
    frame = struct.pack(">BHHBBBB", bits, 4, 4, 1, 1, 0x11, 0)
    about = b"\xff\xe0" + struct.pack(">H", 16) + b"JFIF\0\1\1\0\0\1\0\1\0\0"
    return b"\xff\xd8" + about + bytes([0xFF, marker]) + struct.pack(">H", 2 + len(frame)) + frame + b"\xff\xd9"


UNREAD = {
    "is a PSD of 16 bits per colour; save it there with 8 bits (Image > Mode), or as TIFF or PNG": psd(depth=16),
    "is a PSD of 32 bits per colour; save it there": psd(depth=32),
    "is a PSB, Photoshop's large document; save it there as TIFF or PNG": psd(version=2),
    "is a JPEG of 12 bits per colour, which is not supported": jpeg(0xC1, 12),
    "is a JPEG without loss, which is not supported": jpeg(0xC3, 8),
    "is a JPEG-LS, which is not supported": jpeg(0xF7, 8),
    "is a JPEG XR, which is not supported": b"II\xbc\1" + bytes(40),
    "is a DjVu document; convert it to pixels": b"AT&TFORM" + bytes(40),
}


@pytest.mark.parametrize("words", UNREAD)
def test_a_known_format_in_a_form_that_is_not_read_is_called_by_its_name(tmp_path, words):
    (tmp_path / "a").write_bytes(UNREAD[words])
    assert words in refusal(read_picture, tmp_path / "a")
    if "without loss" not in words:  # some decoders support it
        assert words in refusal(picture_size, tmp_path / "a")


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "GIF", "TIFF", "WEBP", "JPEG2000", "QOI", "PSD", "AVIF"])
def test_a_damaged_head_of_a_known_format_is_damage_and_no_unknown_format(kind):
    head = psd() if kind == "PSD" else encoded(Image.fromarray(PICTURE), kind)
    assert what_it_is(head[:16] + bytes(200)) == DAMAGED


def test_words_of_libraries_are_in_no_refusal(tmp_path):
    chance = np.random.default_rng(1)
    words = ("Error", "decoder error", "not enough", "argument", "object", "broken data", "Truncated File")
    for kind in ("JPEG", "PNG", "GIF", "WEBP", "AVIF", "JPEG2000", "QOI", "TGA", "BMP"):
        whole = encoded(Image.fromarray(PICTURE), kind)
        for _ in range(40):
            at = int(chance.integers(len(whole)))
            (tmp_path / "a").write_bytes(whole[:at] + chance.bytes(3) + whole[at + 3 :])
            try:
                read_picture(tmp_path / "a")
            except ValueError as error:
                assert not [word for word in words if word in str(error)], error  # noqa: PT017


def test_a_chunk_that_a_png_can_do_without_may_be_anything(tmp_path):
    path = tmp_path / "a.png"
    text = chunk(b"prVt", b"words")
    path.write_bytes(PNG[:33] + text[:-4] + struct.pack(">I", zlib.crc32(b"prVtwords") ^ 1) + PNG[33:])
    message = refusal(read_picture, Path(path))
    assert "damaged" in message


SCENE = Image.fromarray(astronaut()[:320, 60:380]).resize((64, 64))
PACKED = {  # format, options -> least share of detected flips that change the picture (by a mean of 2 levels)
    "PNG": ("PNG", {}, 1),
    "TIFF deflate": ("TIFF", {"compression": "tiff_adobe_deflate"}, 1),
    "TIFF LZW": ("TIFF", {"compression": "tiff_lzw"}, 0.8),
    "TIFF PackBits": ("TIFF", {"compression": "packbits"}, 0.8),
    "TIFF": ("TIFF", {}, 1),
    "AVIF": ("AVIF", {"quality": 85}, 1),
    "progressive JPEG": ("JPEG", {"progressive": True, "quality": 90}, 0.6),
    "JPEG": ("JPEG", {"quality": 90}, 0.6),  # a small flip in a number shifts the colours of everything after it
    "TIFF JPEG": ("TIFF", {"compression": "jpeg", "quality": 90}, 0.6),
    "JPEG 2000": ("JPEG2000", {}, 0.5),
    "GIF": ("GIF", {}, 0.5),
    "QOI": ("QOI", {}, 0.2),
    "TGA in runs": ("TGA", {"compression": "tga_rle"}, 0.8),
    "TGA": ("TGA", {}, 1),
    "BMP": ("BMP", {}, 1),
    "PPM": ("PPM", {}, 1),
}


@pytest.mark.parametrize("name", PACKED)
def test_a_flip_is_told_or_changes_little_as_far_as_a_format_has_a_check(tmp_path, caplog, name):
    if name == "AVIF":
        pytest.importorskip("pyvips")
    if name in ("progressive JPEG", "JPEG 2000"):
        pytest.importorskip("av")
    kind, options, least = PACKED[name]
    data, chance = encoded(SCENE, kind, **options), np.random.default_rng(0)
    path = tmp_path / f"a.{kind.lower()}"
    path.write_bytes(data)
    with caplog.at_level(logging.WARNING):
        whole = read_picture(path).astype(float)
    assert not caplog.text, "nothing is said of a whole file"
    told = changed = 0
    for k, at in enumerate(chance.integers(len(data) // 3, len(data) - 20, 40)):
        (path := tmp_path / f"{k}.{kind.lower()}").write_bytes(flipped(data, at, int(chance.integers(8))))
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            try:
                found = read_picture(path).astype(float)
            except ValueError:
                told, changed = told + 1, changed + 1
                continue
        differs = found.shape != whole.shape or np.abs(found - whole).mean() > 2
        told, changed = told + bool(differs and caplog.text), changed + differs
    assert told >= least * changed, f"{told} of {changed}"


@pytest.mark.parametrize("size", [(1, 1), (3, 200), (200, 3), (61, 67)])
@pytest.mark.parametrize(
    ("kind", "mode", "options"),
    [
        ("GIF", "L", {}), ("GIF", "P", {"interlace": True}), ("GIF", "1", {}), ("QOI", "RGB", {}), ("QOI", "RGBA", {}),
        ("TGA", "L", {"compression": "tga_rle"}), ("TGA", "RGBA", {"compression": "tga_rle"}),
        ("TGA", "P", {"compression": "tga_rle"}), ("TIFF", "1", {"compression": "packbits"}),
        ("TIFF", "L", {"compression": "tiff_lzw"}), ("TIFF", "RGBA", {"compression": "tiff_lzw"}),
        ("TIFF", "I;16", {"compression": "tiff_lzw"}), ("TIFF", "CMYK", {"compression": "packbits"}),
    ],
)  # fmt: skip
def test_whole_files_have_as_many_pixels_as_they_say(tmp_path, kind, mode, options, size):
    picture = SCENE.resize(size).convert("L" if mode == "I;16" else mode)
    path = tmp_path / f"a.{kind.lower()}"
    (picture.convert("I;16") if mode == "I;16" else picture).save(path, kind, **options)
    assert remark_on_packing(path) == ""


@pytest.mark.parametrize("compression", ["lzw", "packbits"])
@pytest.mark.parametrize("shape", [(70, 90, 3), (3, 70, 90)])
def test_tiles_planes_and_strips_that_are_filled_up_are_whole(tmp_path, compression, shape):
    pytest.importorskip("imagecodecs")
    samples = np.random.default_rng(0).integers(0, 9, shape).astype(np.uint8)
    for options in ({"tile": (32, 48)}, {"rowsperstrip": 16}):
        layout = {"photometric": "rgb", "planarconfig": "contig" if shape[2] == 3 else "separate"}
        imwrite(tmp_path / "a.tif", samples, compression=compression, **layout, **options)
        assert remark_on_packing(tmp_path / "a.tif") == ""


def test_pixels_that_are_missing_or_more_are_told(tmp_path):
    whole = encoded(SCENE, "QOI")
    run = whole[:-8] + b"\xc0" + whole[-8:]  # one extra pixel
    for name, data in (("a.qoi", run), ("b.qoi", whole[:-9] + whole[-8:])):
        (tmp_path / name).write_bytes(data)
        assert remark_on_packing(tmp_path / name) == MISCOUNTED


@pytest.mark.parametrize("options", [{}, {"optimize": True}, {"restart_marker_blocks": 3}, {"progressive": True}])
def test_nothing_is_said_of_the_codes_of_a_sound_jpeg(options):
    chance = np.random.default_rng(0)
    extremes = Image.fromarray(255 * chance.integers(0, 2, (50, 75, 3), dtype=np.uint8))
    for picture in (SCENE, SCENE.convert("L"), SCENE.convert("CMYK"), SCENE.crop((0, 0, 37, 19)), extremes):
        for quality in (5, 75, 100):
            for subsampling in (0, 1, 2):
                data = encoded(picture, "JPEG", quality=quality, subsampling=subsampling, **options)
                assert jpeg_fits(data), (picture.size, quality, subsampling)


def test_a_flip_in_the_first_number_of_a_jpeg_is_told_if_it_leaves_the_range_of_pixels():
    data = encoded(Image.new("RGB", (64, 64), "white"), "JPEG", quality=90)
    codes = data.index(b"\xff\xda") + 14
    assert not all(jpeg_fits(flipped(data, codes, bit)) for bit in range(8))
    assert not jpeg_fits(data[:-6] + data[-2:]), "too few blocks"
    assert not jpeg_fits(data[:-2] + bytes(2) + data[-2:]), "too many"


def test_any_flip_in_the_head_of_a_jpeg_is_left_to_its_decoder():
    data = encoded(SCENE, "JPEG")
    for at in range(2, data.index(b"\xff\xda") + 14):
        jpeg_fits(flipped(data, at, at % 8))
