"""Tests that every kind of picture loads as a tensor or is refused in one line that says what is wrong."""

import io
import logging
import os
import re
import struct
import warnings
import zlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import tifffile
import torch
from PIL import Image, ImageCms
from refusals import refusal as refused
from refusals import refuses

from brushexp.errors import on_a_line
from brushexp.pictures.decode import read_picture
from brushexp.pictures.load import background_color, load_picture, samples

HEIGHT, WIDTH = 5, 7
BYTES = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
WORDS = np.random.default_rng(1).integers(0, 65536, (HEIGHT, WIDTH, 3), np.uint16)
FLOATS = np.random.default_rng(2).random((HEIGHT, WIDTH, 3), np.float32)
TOP = {np.uint8: 255, np.uint16: 65535, np.uint32: 2**32 - 1, np.float16: 1, np.float32: 1, np.float64: 1}
ORIENTED: dict[int, Callable[[np.ndarray], np.ndarray]] = {
    1: lambda a: a,
    2: np.fliplr,
    3: lambda a: np.rot90(a, 2),
    4: np.flipud,
    5: lambda a: a.transpose(1, 0, 2),
    6: lambda a: np.rot90(a, -1),  # clockwise
    7: lambda a: np.rot90(a, 2).transpose(1, 0, 2),
    8: lambda a: np.rot90(a, 1),
}


def expect(path: Path, rgb: np.ndarray, atol: float = 1e-6) -> None:
    """Assert that the picture at ``path`` loads as these values (H, W, 3 or 1) in [0, 1]."""
    expected = torch.from_numpy(np.broadcast_to(rgb, (*rgb.shape[:2], 3)).copy()).permute(2, 0, 1).float()
    torch.testing.assert_close(load_picture(str(path), None), expected, atol=atol, rtol=0)


def refusal(path: Path | str) -> str:
    """Return the one-line refusal of ``path``, which must name the file and end with a remedy."""
    message = refused(load_picture, str(path), None)
    assert "; " in message
    assert on_a_line(str(path)) in message
    return message


def png(header: tuple[int, int, int, int], rows: bytes, extra: bytes = b"") -> bytes:
    """Make a PNG from a header (width, height, bit depth, colour type), extra chunks, and scan lines."""
    first = chunk(b"IHDR", struct.pack(">IIBBBBB", *header, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + first + extra + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def deep_png(samples: np.ndarray, extra: bytes = b"") -> bytes:
    """Make a 16-bit PNG from samples (H, W, 1 to 4)."""
    height, width, n = samples.shape
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in samples)
    return png((width, height, 16, {1: 0, 2: 4, 3: 2, 4: 6}[n]), rows, extra)


def encoded(picture: Image.Image, kind: str, **options: object) -> bytes:
    file = io.BytesIO()
    picture.save(file, kind, **options)
    return file.getvalue()


def profile_of(swap: bool) -> bytes:
    """Make an sRGB profile; ``swap`` exchanges its red and green primaries."""
    profile = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    if swap:
        profile = bytearray(profile.replace(b"rXYZ", b"____", 1).replace(b"gXYZ", b"rXYZ", 1).replace(b"____", b"gXYZ"))
    return bytes(profile)


MODES = [
    *((kind, "RGB") for kind in ("png", "bmp", "tiff", "webp", "ppm", "tga", "jpeg")),
    *(("png", m) for m in "L1P"),
]


@pytest.mark.parametrize(("kind", "mode"), MODES)
def test_eight_bits_of_colour_grey_and_palettes_arrive(tmp_path, kind, mode):
    smooth = np.linspace(0, 255, 64 * 48 * 3).astype(np.uint8).reshape(48, 64, 3)
    picture = Image.fromarray(smooth).convert(mode)
    options = {"webp": {"lossless": True}, "jpeg": {"quality": 95}}.get(kind, {})
    picture.save(tmp_path / "picture", kind, **options)
    expect(tmp_path / "picture", np.asarray(picture.convert("RGB")) / 255, atol=0.03 if kind == "jpeg" else 1e-6)
    target = load_picture(str(tmp_path / "picture"), None)
    assert target.dtype == torch.float32
    assert target.is_contiguous()


def test_cmyk_is_light_where_there_is_no_ink_and_a_transparent_colour_or_grey_becomes_white(tmp_path):
    for ink, rgb in {(0, 0, 0, 0): (1, 1, 1), (255, 0, 0, 0): (0, 1, 1), (0, 0, 0, 255): (0, 0, 0)}.items():
        Image.new("CMYK", (16, 8), ink).save(tmp_path / "ink.jpg", quality=100)
        expect(tmp_path / "ink.jpg", np.full((8, 16, 3), rgb), atol=0.02)
    Image.fromarray(BYTES).save(tmp_path / "colour.png", transparency=tuple(int(c) for c in BYTES[0, 0]))
    grey = WORDS[..., :1]
    (tmp_path / "grey.png").write_bytes(deep_png(grey, chunk(b"tRNS", grey[0, 0].astype(">u2").tobytes())))
    for name, expected in {"colour.png": BYTES / 255, "grey.png": grey / 65535}.items():
        expected[0, 0] = 1
        expect(tmp_path / name, expected)


@pytest.mark.parametrize("opacities", [b"\x00\xff", b"\x40"])
def test_a_palette_with_transparency_lies_over_white(tmp_path, opacities):
    picture = Image.new("P", (2, 1))
    picture.putpalette([200, 0, 0, 0, 100, 0])
    picture.putpixel((1, 0), 1)
    picture.save(tmp_path / "palette.png", transparency=opacities)
    alpha = opacities[0] / 255
    first = alpha * np.array([200, 0, 0]) / 255 + 1 - alpha
    expect(tmp_path / "palette.png", np.array([[first, [0, 100 / 255, 0]]]), atol=1 / 255)


@pytest.mark.parametrize("kind", ["png", "tiff", "webp", "grey"])
def test_alpha_lies_over_white(tmp_path, kind):
    color = BYTES[..., :1] if kind == "grey" else BYTES
    levels = np.dstack([color, np.tile(np.uint8([0, 100, 255, 30, 60, 200, 7]), (HEIGHT, 1))])
    options = {"lossless": True, "exact": True} if kind == "webp" else {}
    Image.fromarray(levels).save(tmp_path / "a", "png" if kind == "grey" else kind, **options)
    alpha = levels[..., -1:] / 255
    expect(tmp_path / "a", color / 255 * alpha + 1 - alpha, atol=1 / 255)


@pytest.mark.parametrize("kind", ["GIF", "TIFF", "PNG", "WEBP"])
def test_the_first_frame_is_taken(tmp_path, kind):
    frames = [Image.new("RGB", (WIDTH, HEIGHT), color) for color in ((255, 0, 0), (0, 0, 255))]
    options = {"lossless": True} if kind == "WEBP" else {}
    frames[0].save(tmp_path / "frames", kind, save_all=True, append_images=frames[1:], **options)
    expect(tmp_path / "frames", np.full((HEIGHT, WIDTH, 3), (1, 0, 0)))


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_a_16_bit_png_keeps_every_bit_of_grey_and_8_of_colours(tmp_path, channels):
    samples = np.concatenate([WORDS, WORDS[::-1]], 2)[..., :channels]
    (tmp_path / "deep.png").write_bytes(deep_png(samples))
    unit = samples / 65535
    color, alpha = (unit[..., :-1], unit[..., -1:]) if channels in (2, 4) else (unit, 1)
    expect(tmp_path / "deep.png", color * alpha + 1 - alpha, atol=1e-6 if channels == 1 else 1 / 100)


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("options", [{"byteorder": "<"}, {"byteorder": ">"}, {"planarconfig": "separate"}], ids=str)
@pytest.mark.parametrize("dtype", TOP)
def test_a_tiff_keeps_every_bit(tmp_path, dtype, options, compression):
    color = (FLOATS.astype(float) * TOP[dtype]).astype(dtype)
    planes = np.ascontiguousarray(color.transpose(2, 0, 1)) if "planarconfig" in options else color
    tifffile.imwrite(tmp_path / "rgb.tif", planes, photometric="rgb", compression=compression, **options)
    expect(tmp_path / "rgb.tif", color / TOP[dtype])
    tifffile.imwrite(tmp_path / "grey.tif", color[..., 0], photometric="minisblack", compression=compression)
    expect(tmp_path / "grey.tif", color[..., :1] / TOP[dtype])


def test_16_bit_files_of_other_programs_and_with_a_profile_keep_every_bit_and_white_at_zero_is_inverted(tmp_path):
    Image.fromarray(WORDS[..., 0]).save(tmp_path / "deep.tif", compression="tiff_lzw")
    (tmp_path / "deep.pgm").write_bytes(b"P5 7 5 65535\n" + WORDS[..., 0].astype(">u2").tobytes())
    for name in ("deep.tif", "deep.pgm"):
        expect(tmp_path / name, WORDS[..., :1] / 65535)
    for levels in (BYTES, WORDS):
        tifffile.imwrite(tmp_path / "inverted.tif", levels[..., 0], photometric="miniswhite")
        expect(tmp_path / "inverted.tif", 1 - levels[..., :1] / TOP[levels.dtype.type])
    profile = profile_of(swap=False)
    (tmp_path / "grey.png").write_bytes(deep_png(WORDS[..., :1], chunk(b"iCCP", b"p\0\0" + zlib.compress(profile))))
    expect(tmp_path / "grey.png", WORDS[..., :1] / 65535)
    tifffile.imwrite(tmp_path / "deep.tif", WORDS, photometric="rgb", iccprofile=profile)
    expect(tmp_path / "deep.tif", WORDS / 65535)


@pytest.mark.parametrize("kind", ["assocalpha", "unassalpha"])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_a_deep_tiff_with_alpha_lies_over_white(tmp_path, kind, dtype):
    alpha = np.linspace(0, 1, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH, 1)
    samples = np.dstack([FLOATS * alpha if kind == "assocalpha" else FLOATS, alpha]) * TOP[dtype]
    tifffile.imwrite(tmp_path / "alpha.tif", samples.astype(dtype), photometric="rgb", extrasamples=[kind])
    expect(tmp_path / "alpha.tif", FLOATS * alpha + 1 - alpha, atol=1e-4)


def with_pixel(value: float) -> np.ndarray:
    samples = FLOATS.copy()
    samples[2, 3] = value
    return samples


@pytest.mark.parametrize(("samples", "message"), [
    (with_pixel(np.nan), "NaN or infinite"),
    (with_pixel(-np.inf)[..., 0], "NaN or infinite"),
    (np.array([[-0.25, 1.0]], np.float32), "values from -0.25 to 1; scale them to 0 to 1"),
    (np.array([[0.0, 3.5]], np.float32), "values from 0 to 3.5; scale them to 0 to 1"),
    (WORDS.astype(np.int32), "signed or complex"),
    (BYTES[..., 0].astype(np.int8), "signed or complex"),
    (WORDS.astype(np.complex64), "signed or complex"),
    (np.zeros((8, 6, 5), np.float32), "neither grey nor RGB"),
])  # fmt: skip
def test_a_tiff_that_has_no_plain_meaning_as_a_picture_is_refused(tmp_path, samples, message):
    kind = {"photometric": "rgb", "planarconfig": "contig"} if samples.ndim == 3 else {"photometric": "minisblack"}
    tifffile.imwrite(tmp_path / "odd.tif", samples, **kind)
    assert message in refusal(tmp_path / "odd.tif")


@pytest.mark.parametrize("orientation", ORIENTED)
@pytest.mark.parametrize("kind", ["png", "webp", "tiff", "lzw", "jpeg"])
def test_exif_orientation_is_honoured(tmp_path, kind, orientation):
    blocks = BYTES.repeat(8, 0).repeat(8, 1)
    exif = Image.Exif()
    exif[274] = orientation
    options = {
        "webp": {"lossless": True}, "lzw": {"compression": "tiff_lzw"}, "jpeg": {"quality": 100, "subsampling": 0}
    }.get(kind, {})  # fmt: skip
    Image.fromarray(blocks).save(tmp_path / "turned", "tiff" if kind == "lzw" else kind, exif=exif, **options)
    expect(tmp_path / "turned", ORIENTED[orientation](blocks) / 255, atol=0.03 if kind == "jpeg" else 1e-6)


@pytest.mark.parametrize("orientation", ORIENTED)
@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("samples", [BYTES, WORDS, FLOATS], ids=["uint8", "uint16", "float32"])
def test_exif_orientation_of_a_tiff_of_many_pages_is_honoured(tmp_path, samples, compression, orientation):
    tags = [(274, "H", 1, orientation, True)]
    with tifffile.TiffWriter(tmp_path / "pages.tif") as tiff:
        for page in (samples, samples[::-1]):
            tiff.write(page, photometric="rgb", extratags=tags, compression=compression)
    expect(tmp_path / "pages.tif", ORIENTED[orientation](samples) / TOP[samples.dtype.type])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_an_icc_profile_is_converted_to_srgb(tmp_path, dtype):
    swapped, red = profile_of(swap=True), np.full((HEIGHT, WIDTH, 3), (TOP[dtype], 0, 0), dtype)
    tifffile.imwrite(tmp_path / "swapped.tif", red, photometric="rgb", iccprofile=swapped)
    expect(tmp_path / "swapped.tif", np.full((HEIGHT, WIDTH, 3), (0, 1, 0)), atol=0.02)
    if dtype is np.uint8:
        Image.new("RGBA", (WIDTH, HEIGHT), (255, 0, 0, 128)).save(tmp_path / "clear.png", icc_profile=swapped)
        expect(tmp_path / "clear.png", np.full((HEIGHT, WIDTH, 3), (0.5, 1, 0.5)), atol=0.02)


@pytest.mark.parametrize(
    "damaged",
    [{"icc_profile": b"junk"}, {"icc_profile": profile_of(swap=True)[:200]}, {"exif": b"Exif\0\0" + bytes(range(60))}],
    ids=["junk", "cut", "exif"],
)
def test_broken_profiles_and_exif_data_leave_the_raw_values(tmp_path, damaged):
    Image.fromarray(BYTES).save(tmp_path / "broken.png", **damaged)
    expect(tmp_path / "broken.png", BYTES / 255)


@pytest.mark.parametrize(("size", "resolution", "expected"), [
    ((60, 40), 30, (30, 20)), ((40, 60), 30, (20, 30)), ((60, 40), 60, (60, 40)), ((60, 40), 90, (90, 60)),
    ((60, 40), 1, (1, 1)), ((1, 1), 64, (64, 64)), ((1, 1), None, (1, 1)), ((20000, 4), None, (20000, 4)),
    ((20000, 4), 100, (100, 1)),
])  # fmt: skip
def test_the_longer_side_gets_the_resolution(tmp_path, size, resolution, expected):
    Image.new("RGB", size, (10, 20, 30)).save(tmp_path / "plain.png")
    target = load_picture(str(tmp_path / "plain.png"), resolution)
    assert tuple(target.shape) == (3, expected[1], expected[0])
    torch.testing.assert_close(target, (torch.tensor([10.0, 20.0, 30.0]) / 255)[:, None, None].expand_as(target))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_shrinking_averages_and_neither_way_leaves_0_to_1(tmp_path, dtype):
    fine = np.zeros((48, 64, 3), dtype)
    fine[::2, ::2] = fine[1::2, 1::2] = TOP[dtype]
    fine[24:] = 0
    tifffile.imwrite(tmp_path / "checks.tif", fine, photometric="rgb")
    small, large = (load_picture(str(tmp_path / "checks.tif"), side) for side in (16, 100))
    torch.testing.assert_close(small[:, :3], torch.full((3, 3, 16), 0.5), atol=0.03, rtol=0)
    assert 0 <= small.min() <= small.max() <= 1
    assert small.is_contiguous()
    assert (large.min(), large.max()) == (0, 1)


def test_what_is_no_picture_or_would_be_too_large_is_refused_with_what_would_do_and_not_run(tmp_path, monkeypatch):
    Image.new("RGB", (40, 30)).save(tmp_path / "small.png")
    words = "16384 x 12288 pixels, more than 100 megapixels; use resolution=11547 or less"
    assert words in refused(load_picture, str(tmp_path / "small.png"), 16384)
    assert "a sample such as coffee" in refusal("no/such/photo.jpg")
    for name in ("a\0b", "a\nb.png", "long" * 2000):
        assert "is not there" in refusal(name)
    assert "is a folder" in refusal(tmp_path)
    path = tmp_path / "text.png"
    for text in ("x", "not a picture\n" * 50, "<svg xmlns='http://www.w3.org/2000/svg'/>"):
        path.write_text(text)
        assert "not a picture of a known format" in refusal(path)
    path.write_bytes(b"")
    assert "is empty (0 bytes)" in refusal(path)
    Image.fromarray(BYTES).save(tmp_path / "page.eps")
    assert "the format EPS, which is not supported" in refusal(tmp_path / "page.eps")
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
        assert "is a device or a pipe" in refusal(tmp_path / "pipe")
    path.write_bytes(b"secret")
    monkeypatch.setattr(Path, "open", Mock(side_effect=PermissionError(13, "Permission denied")))
    assert "cannot be read (permission denied)" in refusal(path)


def tiff_of(samples: np.ndarray, compression: str | None) -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, samples, photometric="rgb", compression=compression)
    return file.getvalue()


NOISE = np.random.default_rng(3).random((64, 48, 3))
KINDS = ("JPEG", "PNG", "GIF", "WEBP", "TIFF", "BMP", "JPEG2000")


@pytest.mark.parametrize("whole", [
    *(encoded(Image.fromarray((255 * NOISE).astype(np.uint8)), kind) for kind in KINDS),
    *(tiff_of((NOISE * TOP[t]).astype(t), packed) for t in (np.uint16, np.float32) for packed in (None, "zlib")),
])  # fmt: skip
@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_truncated_picture_is_refused_without_a_word_of_its_decoder(tmp_path, whole, share, capfd):
    (tmp_path / "cut").write_bytes(whole[: int(len(whole) * share)])
    message = refusal(tmp_path / "cut")
    assert any(words in message for words in ("damaged or cannot be decoded", "not a picture", "is truncated"))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("side", [10_001, 13_000, 200_000])  # Pillow is silent, warns, and raises
def test_a_picture_of_too_many_pixels_is_refused_before_it_is_decoded(tmp_path, side):
    (tmp_path / "bomb.png").write_bytes(png((side, side, 8, 2), b""))
    message = refusal(tmp_path / "bomb.png")
    assert f"{side} x {side} pixels" in message or "more than 178 megapixels" in message
    assert re.search("(at most|the limit is) [12]00 megapixels", message)


@pytest.mark.parametrize(("width", "height", "message"), [
    (20_000, 30_000, "20000 x 30000 pixels; at most 100 megapixels"),
    (WIDTH, 10_000_000, "rows are missing"),
    (0, HEIGHT, "damaged"),
])  # fmt: skip
def test_a_tiff_that_claims_more_than_it_holds_is_refused_at_once(tmp_path, width, height, message):
    path = tmp_path / "bomb.tif"
    tifffile.imwrite(path, FLOATS, photometric="rgb", compression="zlib")
    with tifffile.TiffFile(path, mode="r+") as tiff:
        tiff.pages[0].tags["ImageWidth"].overwrite(width)
        tiff.pages[0].tags["ImageLength"].overwrite(height)
    assert message in refusal(path)


def test_samples_load_without_a_network_files_win_over_them_folders_do_not_and_a_tilde_is_the_home(
    tmp_path, monkeypatch
):
    assert {"astronaut", "camera", "chelsea", "coffee", "hubble_deep_field", "retina", "rocket"} <= samples().keys()
    for name in samples():
        assert max(load_picture(name, 16).shape) == 16
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "astronaut").mkdir()
    assert load_picture("astronaut", 32).shape == (3, 32, 32)
    Image.fromarray(BYTES).save(tmp_path / "coffee", "PNG")
    for name in ("coffee", "~/coffee"):
        expect(Path(name), BYTES / 255)


TARGET = torch.from_numpy(FLOATS).permute(2, 0, 1)


def test_pictures_read_at_once_leave_stderr_warnings_and_logging_as_they_were(tmp_path):
    Image.new("RGB", (300, 300)).save(tmp_path / "a.png")

    def settings():
        return os.fstat(2).st_ino, [*warnings.filters], logging.root.manager.disable

    logging.disable(logging.INFO)
    try:
        before = settings()
        with ThreadPoolExecutor(4) as threads:
            assert len([*threads.map(read_picture, [tmp_path / "a.png"] * 100)]) == 100
        assert settings() == before
    finally:
        logging.disable(logging.NOTSET)


def test_a_background_is_a_name_or_a_number_or_the_mean_of_the_target():
    levels = {"white": (255, 255, 255), "black": (0, 0, 0), "#ff8000": (255, 128, 0), "#0A0b0C": (10, 11, 12)}
    levels |= {"White": (255, 255, 255), "#fff": (255, 255, 255), "grey": (128, 128, 128), "ivory": (255, 255, 240)}
    for spec, expected in {**levels, "mean": 255 * FLOATS.mean((0, 1))}.items():
        torch.testing.assert_close(255 * background_color(spec, TARGET), torch.tensor(expected, dtype=torch.float32))
    for spec in ("", "redd", "#ff800080", "#12345", "#gggggg", "ff8000", "#ff80001", "x" * 200):
        refuses(r"use background=mean, transparent, '#rrggbb' or a name of CSS", background_color, spec, TARGET)
