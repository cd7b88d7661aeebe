"""Pictures of every kind become one tensor, or one line that says what is wrong."""

import io
import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageCms
from torch import Tensor

from brushexp.errors import UserError
from brushexp.pictures.decode import MAX_PIXELS
from brushexp.pictures.load import MAX_SIDE, background_color, load_picture, sample_names

HEIGHT, WIDTH = 5, 7
BYTES = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
WORDS = np.random.default_rng(1).integers(0, 65536, (HEIGHT, WIDTH, 3), np.uint16)
FLOATS = np.random.default_rng(2).random((HEIGHT, WIDTH, 3), np.float32)
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
    """``path`` holds these (H, W, 3 or 1) values in [0, 1]."""
    wanted = torch.from_numpy(np.broadcast_to(rgb, (*rgb.shape[:2], 3)).copy()).permute(2, 0, 1).float()
    torch.testing.assert_close(load_picture(str(path), None), wanted, atol=atol, rtol=0)


def refusal(path: Path | str, resolution: int | None = None) -> str:
    """What is said instead of reading ``path``; always one line that names the file and ends with a cure."""
    with pytest.raises(UserError) as caught:
        load_picture(str(path), resolution)
    message = str(caught.value)
    assert "\n" not in message
    assert "; " in message
    assert str(path) in message
    return message


def png(header: tuple[int, int, int, int], rows: bytes, extra: bytes = b"") -> bytes:
    """A PNG from width, height, bit depth and colour type, and its scan lines; ``extra`` are chunks before those."""
    first = chunk(b"IHDR", struct.pack(">IIBBBBB", *header, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + first + extra + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def deep_png(samples: np.ndarray, extra: bytes = b"") -> bytes:
    """A 16-bit PNG of (H, W, 1 to 4) samples."""
    height, width, n = samples.shape
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in samples)
    return png((width, height, 16, {1: 0, 2: 4, 3: 2, 4: 6}[n]), rows, extra)


def encoded(picture: Image.Image, kind: str, **options: object) -> bytes:
    file = io.BytesIO()
    picture.save(file, kind, **options)
    return file.getvalue()


def profile_of(swap: bool) -> bytes:
    """An sRGB profile; with ``swap`` its red and green primaries are exchanged."""
    profile = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    if swap:
        profile = bytearray(profile.replace(b"rXYZ", b"____", 1).replace(b"gXYZ", b"rXYZ", 1).replace(b"____", b"gXYZ"))
    return bytes(profile)


# --- kinds of pictures -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["png", "bmp", "tiff", "webp", "ppm", "tga"])
def test_eight_bit_colours_arrive_exactly(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"picture.{kind}"
    Image.fromarray(BYTES).save(path, **({"lossless": True} if kind == "webp" else {}))
    expect(path, BYTES / 255)
    target = load_picture(str(path), None)
    assert target.dtype == torch.float32
    assert target.is_contiguous()


@pytest.mark.parametrize(("mode", "levels"), [("L", 255), ("1", 1)])
def test_grey_becomes_three_equal_channels(tmp_path: Path, mode: str, levels: int) -> None:
    grey = Image.fromarray(BYTES[..., 0]).convert(mode)
    grey.save(tmp_path / "grey.png")
    expect(tmp_path / "grey.png", np.asarray(grey)[..., None] / levels)


def test_a_jpeg_is_close_to_its_source(tmp_path: Path) -> None:
    smooth = np.linspace(0, 255, 64 * 48 * 3).astype(np.uint8).reshape(48, 64, 3)
    Image.fromarray(smooth).save(tmp_path / "photo.jpg", quality=95)
    expect(tmp_path / "photo.jpg", smooth / 255, atol=0.03)


def test_cmyk_is_light_where_there_is_no_ink(tmp_path: Path) -> None:
    inks = {"white": (0, 0, 0, 0), "cyan": (255, 0, 0, 0), "black": (0, 0, 0, 255)}
    rgb = {"white": (1, 1, 1), "cyan": (0, 1, 1), "black": (0, 0, 0)}
    for name, ink in inks.items():
        Image.new("CMYK", (16, 8), ink).save(tmp_path / f"{name}.jpg", quality=100)
        expect(tmp_path / f"{name}.jpg", np.full((8, 16, 3), rgb[name]), atol=0.02)


def test_a_palette_gives_its_colours(tmp_path: Path) -> None:
    flags = Image.fromarray(BYTES).quantize(8)
    flags.save(tmp_path / "palette.png")
    expect(tmp_path / "palette.png", np.asarray(flags.convert("RGB")) / 255)


@pytest.mark.parametrize("opacities", [b"\x00\xff", b"\x40"])
def test_a_palette_with_transparency_lies_over_white(tmp_path: Path, opacities: bytes) -> None:
    picture = Image.new("P", (2, 1))
    picture.putpalette([200, 0, 0, 0, 100, 0])
    picture.putpixel((1, 0), 1)
    picture.save(tmp_path / "palette.png", transparency=opacities)
    alpha = opacities[0] / 255
    first = alpha * np.array([200, 0, 0]) / 255 + 1 - alpha
    expect(tmp_path / "palette.png", np.array([[first, [0, 100 / 255, 0]]]), atol=1 / 255)


@pytest.mark.parametrize("kind", ["png", "tiff", "webp"])
def test_alpha_lies_over_white(tmp_path: Path, kind: str) -> None:
    rgba = np.dstack([BYTES, np.tile(np.uint8([0, 100, 255, 30, 60, 200, 7]), (HEIGHT, 1))])
    Image.fromarray(rgba).save(tmp_path / f"a.{kind}", **({"lossless": True, "exact": True} if kind == "webp" else {}))
    alpha = rgba[..., 3:] / 255
    expect(tmp_path / f"a.{kind}", BYTES / 255 * alpha + 1 - alpha, atol=1 / 255)


def test_grey_with_alpha_lies_over_white(tmp_path: Path) -> None:
    Image.fromarray(BYTES[..., :2]).save(tmp_path / "grey.png")
    grey, alpha = BYTES[..., :1] / 255, BYTES[..., 1:2] / 255
    expect(tmp_path / "grey.png", grey * alpha + 1 - alpha, atol=1 / 255)


def test_a_transparent_colour_becomes_white(tmp_path: Path) -> None:
    picture = Image.fromarray(BYTES)
    picture.save(tmp_path / "key.png", transparency=tuple(int(c) for c in BYTES[0, 0]))
    wanted = BYTES / 255
    wanted[0, 0] = 1
    expect(tmp_path / "key.png", wanted)


@pytest.mark.parametrize("kind", ["GIF", "TIFF", "PNG", "WEBP"])
def test_the_first_frame_is_taken(tmp_path: Path, kind: str) -> None:
    frames = [Image.new("RGB", (WIDTH, HEIGHT), color) for color in ((255, 0, 0), (0, 0, 255))]
    options = {"lossless": True} if kind == "WEBP" else {}
    frames[0].save(tmp_path / "frames", kind, save_all=True, append_images=frames[1:], **options)
    expect(tmp_path / "frames", np.full((HEIGHT, WIDTH, 3), (1, 0, 0)))


# --- more than 8 bits ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("channels", [1, 3])
def test_a_16_bit_png_keeps_every_bit(tmp_path: Path, channels: int) -> None:
    (tmp_path / "deep.png").write_bytes(deep_png(WORDS[..., :channels]))
    expect(tmp_path / "deep.png", WORDS[..., :channels] / 65535)


@pytest.mark.parametrize("channels", [2, 4])
def test_a_16_bit_png_with_alpha_lies_over_white(tmp_path: Path, channels: int) -> None:
    samples = np.concatenate([WORDS, WORDS[::-1]], 2)[..., :channels]
    (tmp_path / "deep.png").write_bytes(deep_png(samples))
    colour, alpha = samples[..., :-1] / 65535, samples[..., -1:] / 65535
    expect(tmp_path / "deep.png", colour * alpha + 1 - alpha, atol=1 / 127 if channels == 2 else 1e-6)


@pytest.mark.parametrize("channels", [1, 3])
def test_a_transparent_colour_of_16_bits_becomes_white(tmp_path: Path, channels: int) -> None:
    samples = WORDS[..., :channels]
    (tmp_path / "key.png").write_bytes(deep_png(samples, chunk(b"tRNS", samples[0, 0].astype(">u2").tobytes())))
    wanted = samples / 65535
    wanted[0, 0] = 1
    expect(tmp_path / "key.png", wanted)


@pytest.mark.parametrize("byteorder", ["<", ">"])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("compression", [None, "zlib"])
def test_a_16_bit_tiff_keeps_every_bit(tmp_path: Path, channels: int, byteorder: str, compression: str | None) -> None:
    samples, kind = (WORDS, "rgb") if channels == 3 else (WORDS[..., 0], "minisblack")
    path = tmp_path / "deep.tif"
    tifffile.imwrite(path, samples, photometric=kind, byteorder=byteorder, compression=compression)
    expect(path, np.atleast_3d(samples) / 65535)


def test_a_16_bit_tiff_in_lzw_keeps_every_bit(tmp_path: Path) -> None:
    Image.fromarray(WORDS[..., 0]).save(tmp_path / "deep.tif", compression="tiff_lzw")
    expect(tmp_path / "deep.tif", WORDS[..., :1] / 65535)


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("samples", [BYTES, WORDS, FLOATS], ids=["uint8", "uint16", "float32"])
def test_a_tiff_in_planes_is_read(tmp_path: Path, samples: np.ndarray, compression: str | None) -> None:
    planes = np.ascontiguousarray(samples.transpose(2, 0, 1))
    path = tmp_path / "planes.tif"
    tifffile.imwrite(path, planes, photometric="rgb", planarconfig="separate", compression=compression)
    expect(path, samples / {"u1": 255, "u2": 65535, "f4": 1}[samples.dtype.str[1:]])


@pytest.mark.parametrize("samples", [BYTES[..., 0], WORDS[..., 0]], ids=["uint8", "uint16"])
def test_a_tiff_with_white_at_zero_is_inverted(tmp_path: Path, samples: np.ndarray) -> None:
    tifffile.imwrite(tmp_path / "inverted.tif", samples, photometric="miniswhite")
    expect(tmp_path / "inverted.tif", 1 - samples[..., None] / np.iinfo(samples.dtype).max)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_float_tiff_is_taken_as_it_is(tmp_path: Path, dtype: type, channels: int) -> None:
    samples = FLOATS.astype(dtype) if channels == 3 else FLOATS[..., 0].astype(dtype)
    tifffile.imwrite(tmp_path / "float.tif", samples, photometric="rgb" if channels == 3 else "minisblack")
    expect(tmp_path / "float.tif", np.atleast_3d(samples))


def test_a_32_bit_grey_tiff_keeps_its_range(tmp_path: Path) -> None:
    samples = np.array([[0, 2**31, 2**32 - 1]], np.uint32)
    tifffile.imwrite(tmp_path / "grey.tif", samples, photometric="minisblack")
    expect(tmp_path / "grey.tif", np.array([[[0], [0.5], [1]]]))


@pytest.mark.parametrize("kind", ["assocalpha", "unassalpha"])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_a_deep_tiff_with_alpha_lies_over_white(tmp_path: Path, kind: str, dtype: type) -> None:
    top = 65535 if dtype is np.uint16 else 1
    alpha = np.linspace(0, 1, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH, 1)
    colour = FLOATS * alpha if kind == "assocalpha" else FLOATS
    samples = (np.dstack([colour, alpha]) * top).astype(dtype)
    tifffile.imwrite(tmp_path / "alpha.tif", samples, photometric="rgb", extrasamples=[kind])
    eight_bit = kind == "assocalpha" and dtype is np.uint16
    expect(tmp_path / "alpha.tif", FLOATS * alpha + 1 - alpha, atol=1 / 100 if eight_bit else 1e-4)


def test_a_16_bit_pgm_keeps_its_range(tmp_path: Path) -> None:
    (tmp_path / "deep.pgm").write_bytes(b"P5 7 5 65535\n" + WORDS[..., 0].astype(">u2").tobytes())
    expect(tmp_path / "deep.pgm", WORDS[..., :1] / 65535)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_float_tiff_with_nan_or_infinity_is_refused(tmp_path: Path, bad: float, channels: int) -> None:
    samples = FLOATS.copy()
    samples[2, 3] = bad
    samples, kind = (samples, "rgb") if channels == 3 else (samples[..., 0], "minisblack")
    tifffile.imwrite(tmp_path / "nan.tif", samples, photometric=kind)
    assert "NaN or infinite" in refusal(tmp_path / "nan.tif")


@pytest.mark.parametrize(("low", "high"), [(-0.25, 1.0), (0.0, 3.5)])
def test_a_float_tiff_outside_0_to_1_is_refused(tmp_path: Path, low: float, high: float) -> None:
    tifffile.imwrite(tmp_path / "hdr.tif", np.array([[low, high]], np.float32))
    assert f"values from {low:g} to {high:g}; scale them to 0 to 1" in refusal(tmp_path / "hdr.tif")


@pytest.mark.parametrize("samples", [WORDS.astype(np.int32), WORDS.astype(np.complex64)], ids=["signed", "complex"])
def test_a_tiff_of_signed_or_complex_numbers_is_refused(tmp_path: Path, samples: np.ndarray) -> None:
    tifffile.imwrite(tmp_path / "odd.tif", samples, photometric="rgb")
    assert "signed or complex" in refusal(tmp_path / "odd.tif")


def test_a_tiff_of_five_float_channels_is_refused(tmp_path: Path) -> None:
    tifffile.imwrite(
        tmp_path / "spectrum.tif", np.zeros((8, 6, 5), np.float32), photometric="rgb", planarconfig="contig"
    )
    assert "neither grey nor RGB" in refusal(tmp_path / "spectrum.tif")


# --- EXIF and ICC ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("orientation", ORIENTED)
@pytest.mark.parametrize("kind", ["png", "webp", "tiff", "lzw"])
def test_exif_orientation_is_honoured(tmp_path: Path, kind: str, orientation: int) -> None:
    exif = Image.Exif()
    exif[274] = orientation
    options = {"webp": {"lossless": True}, "lzw": {"compression": "tiff_lzw"}}.get(kind, {})
    Image.fromarray(BYTES).save(tmp_path / "turned", "tiff" if kind == "lzw" else kind, exif=exif, **options)
    expect(tmp_path / "turned", ORIENTED[orientation](BYTES) / 255)


@pytest.mark.parametrize("orientation", ORIENTED)
def test_exif_orientation_of_a_jpeg_is_honoured(tmp_path: Path, orientation: int) -> None:
    blocks = BYTES.repeat(8, 0).repeat(8, 1)
    exif = Image.Exif()
    exif[274] = orientation
    Image.fromarray(blocks).save(tmp_path / "turned.jpg", exif=exif, quality=100, subsampling=0)
    expect(tmp_path / "turned.jpg", ORIENTED[orientation](blocks) / 255, atol=0.03)


@pytest.mark.parametrize("orientation", ORIENTED)
@pytest.mark.parametrize("samples", [WORDS, FLOATS], ids=["uint16", "float32"])
def test_exif_orientation_of_a_deep_tiff_is_honoured(tmp_path: Path, samples: np.ndarray, orientation: int) -> None:
    tags = [(274, "H", 1, orientation, True)]
    tifffile.imwrite(tmp_path / "turned.tif", samples, photometric="rgb", extratags=tags)
    expect(tmp_path / "turned.tif", ORIENTED[orientation](samples) / (65535 if samples is WORDS else 1))


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("samples", [BYTES, WORDS], ids=["uint8", "uint16"])
def test_exif_orientation_of_a_tiff_of_many_pages_is_honoured(
    tmp_path: Path, samples: np.ndarray, compression: str | None
) -> None:
    with tifffile.TiffWriter(tmp_path / "pages.tif") as tiff:
        for page in (samples, samples[::-1]):
            tags = [(274, "H", 1, 6, True)]
            tiff.write(page, photometric="rgb", extratags=tags, compression=compression)
    expect(tmp_path / "pages.tif", ORIENTED[6](samples) / np.iinfo(samples.dtype).max)


def test_damaged_exif_data_do_no_harm(tmp_path: Path) -> None:
    Image.fromarray(BYTES).save(tmp_path / "odd.png", exif=b"Exif\0\0" + bytes(range(60)))
    expect(tmp_path / "odd.png", BYTES / 255)


def test_an_icc_profile_is_converted_to_srgb(tmp_path: Path) -> None:
    red = Image.new("RGB", (WIDTH, HEIGHT), (255, 0, 0))
    red.save(tmp_path / "swapped.png", icc_profile=profile_of(swap=True))
    expect(tmp_path / "swapped.png", np.full((HEIGHT, WIDTH, 3), (0, 1, 0)), atol=0.02)


def test_an_icc_profile_of_a_picture_with_alpha_is_converted_too(tmp_path: Path) -> None:
    half = Image.new("RGBA", (WIDTH, HEIGHT), (255, 0, 0, 128))
    half.save(tmp_path / "swapped.png", icc_profile=profile_of(swap=True))
    expect(tmp_path / "swapped.png", np.full((HEIGHT, WIDTH, 3), (0.5, 1, 0.5)), atol=0.02)


@pytest.mark.parametrize("kind", ["png", "tif", "float.tif"])
def test_an_icc_profile_of_a_deep_picture_is_converted_too(tmp_path: Path, kind: str) -> None:
    red = np.full((HEIGHT, WIDTH, 3), (65535, 0, 0), np.uint16)
    path, profile = tmp_path / f"swapped.{kind}", profile_of(swap=True)
    if kind == "png":
        path.write_bytes(deep_png(red, chunk(b"iCCP", b"p\0\0" + zlib.compress(profile))))
    else:
        samples = red if kind == "tif" else (red / 65535).astype(np.float32)
        tifffile.imwrite(path, samples, photometric="rgb", iccprofile=profile)
    expect(path, np.full((HEIGHT, WIDTH, 3), (0, 1, 0)), atol=0.02)


@pytest.mark.parametrize("channels", [1, 3])
def test_an_srgb_profile_or_one_of_the_wrong_kind_changes_no_bit_of_a_deep_picture(
    tmp_path: Path, channels: int
) -> None:
    extra = chunk(b"iCCP", b"p\0\0" + zlib.compress(profile_of(swap=False)))
    (tmp_path / "deep.png").write_bytes(deep_png(WORDS[..., :channels], extra))
    expect(tmp_path / "deep.png", WORDS[..., :channels] / 65535)


@pytest.mark.parametrize("profile", [b"junk", profile_of(swap=True)[:200]], ids=["junk", "cut"])
def test_a_broken_icc_profile_leaves_the_raw_values(tmp_path: Path, profile: bytes) -> None:
    Image.fromarray(BYTES).save(tmp_path / "broken.png", icc_profile=profile)
    expect(tmp_path / "broken.png", BYTES / 255)


# --- size ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("size", "resolution", "wanted"),
    [
        ((60, 40), 30, (30, 20)),
        ((40, 60), 30, (20, 30)),
        ((60, 40), 60, (60, 40)),
        ((60, 40), 90, (90, 60)),
        ((60, 40), 1, (1, 1)),
        ((1, 1), 64, (64, 64)),
        ((1, 1), None, (1, 1)),
        ((20000, 4), None, (20000, 4)),
        ((20000, 4), 100, (100, 1)),
    ],
)
def test_the_longer_side_gets_the_resolution(
    tmp_path: Path, size: tuple[int, int], resolution: int | None, wanted: tuple[int, int]
) -> None:
    Image.new("RGB", size, (10, 20, 30)).save(tmp_path / "plain.png")
    target = load_picture(str(tmp_path / "plain.png"), resolution)
    assert tuple(target.shape) == (3, wanted[1], wanted[0])
    torch.testing.assert_close(target, (torch.tensor([10.0, 20.0, 30.0]) / 255)[:, None, None].expand_as(target))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_shrinking_averages_and_never_leaves_0_to_1(tmp_path: Path, dtype: type) -> None:
    fine = np.zeros((48, 64, 3), dtype)
    fine[::2, ::2] = fine[1::2, 1::2] = 1 if dtype is np.float32 else np.iinfo(dtype).max
    fine[24:] = 0
    tifffile.imwrite(tmp_path / "checks.tif", fine, photometric="rgb")
    target = load_picture(str(tmp_path / "checks.tif"), 16)
    torch.testing.assert_close(target[:, :3], torch.full((3, 3, 16), 0.5), atol=0.03, rtol=0)
    assert target.min() >= 0
    assert target.max() <= 1
    assert target.is_contiguous()


def test_enlarging_a_float_edge_does_not_overshoot(tmp_path: Path) -> None:
    edge = np.zeros((4, 6), np.float32)
    edge[:, 3:] = 1
    tifffile.imwrite(tmp_path / "edge.tif", edge)
    target = load_picture(str(tmp_path / "edge.tif"), 60)
    assert target.min() == 0
    assert target.max() == 1


@pytest.mark.parametrize("resolution", [0, -5, MAX_SIDE + 1])
def test_a_senseless_resolution_is_refused(resolution: int) -> None:
    with pytest.raises(UserError, match=f"resolution={resolution} is not a side from 1 to {MAX_SIDE} pixels; set"):
        load_picture("astronaut", resolution)


def test_a_resolution_that_makes_too_many_pixels_is_refused_with_the_largest_that_does_not(tmp_path: Path) -> None:
    Image.new("RGB", (40, 30)).save(tmp_path / "small.png")
    with pytest.raises(UserError, match="16384 x 12288 pixels, more than 100 megapixels; use resolution=11547 or less"):
        load_picture(str(tmp_path / "small.png"), MAX_SIDE)


# --- bad input -------------------------------------------------------------------------------------------------------


def test_a_missing_file_is_refused_with_the_samples_that_exist() -> None:
    assert "astronaut, " in refusal("no/such/photo.jpg")
    assert "is not there" in refusal("a\0b")
    assert "is not there" in refusal("long" * 2000)


def test_a_folder_is_refused(tmp_path: Path) -> None:
    assert "is a folder" in refusal(tmp_path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes on this system")
def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert "is a device or a pipe" in refusal(tmp_path / "pipe")


def test_an_empty_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.png").touch()
    assert "is empty (0 bytes)" in refusal(tmp_path / "empty.png")


@pytest.mark.parametrize("text", ["x", "not a picture\n" * 50, "<svg xmlns='http://www.w3.org/2000/svg'/>"])
def test_a_text_file_is_refused_whatever_its_name(tmp_path: Path, text: str) -> None:
    (tmp_path / "text.png").write_text(text)
    assert "not a picture of a known format" in refusal(tmp_path / "text.png")


def test_a_file_that_may_not_be_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def deny(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    (tmp_path / "secret.png").write_bytes(b"secret")
    monkeypatch.setattr(Path, "open", deny)
    assert "cannot be read (permission denied)" in refusal(tmp_path / "secret.png")


def test_a_postscript_file_is_refused_and_not_run(tmp_path: Path) -> None:
    Image.fromarray(BYTES).save(tmp_path / "page.eps")
    assert "the format EPS, which is not read here" in refusal(tmp_path / "page.eps")


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "GIF", "WEBP", "TIFF", "BMP", "JPEG2000"])
@pytest.mark.parametrize("kept", [0.5, 0.9])
def test_a_truncated_picture_is_refused(
    tmp_path: Path, kind: str, kept: float, capfd: pytest.CaptureFixture[str]
) -> None:
    noise = np.random.default_rng(3).integers(0, 256, (64, 48, 3), np.uint8)
    whole = encoded(Image.fromarray(noise), kind)
    (tmp_path / "cut").write_bytes(whole[: int(len(whole) * kept)])
    message = refusal(tmp_path / "cut")
    assert "is damaged or cannot be decoded" in message or "not a picture" in message
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_a_truncated_deep_tiff_is_refused(
    tmp_path: Path, dtype: type, compression: str | None, capfd: pytest.CaptureFixture[str]
) -> None:
    noise = np.random.default_rng(4).random((64, 48, 3)) * (1 if dtype is np.float32 else 65535)
    tifffile.imwrite(tmp_path / "whole.tif", noise.astype(dtype), photometric="rgb", compression=compression)
    whole = (tmp_path / "whole.tif").read_bytes()
    (tmp_path / "cut.tif").write_bytes(whole[: len(whole) // 2])
    assert "is damaged or cannot be decoded" in refusal(tmp_path / "cut.tif")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("side", [10_001, 13_000, 200_000])  # Pillow is silent, warns, and raises
def test_a_picture_of_too_many_pixels_is_refused_before_it_is_decoded(tmp_path: Path, side: int) -> None:
    (tmp_path / "bomb.png").write_bytes(png((side, side, 8, 2), b""))
    message = refusal(tmp_path / "bomb.png")
    assert f"{side} x {side} pixels" in message or "more than 178 megapixels" in message
    assert f"at most {MAX_PIXELS // 10**6} megapixels are read" in message


def test_a_float_tiff_of_too_many_pixels_is_refused_before_it_is_decoded(tmp_path: Path) -> None:
    path = tmp_path / "bomb.tif"
    tifffile.imwrite(path, FLOATS, photometric="rgb")
    with tifffile.TiffFile(path, mode="r+") as tiff:
        tiff.pages[0].tags["ImageWidth"].overwrite(20_000)
        tiff.pages[0].tags["ImageLength"].overwrite(30_000)
    assert "20000 x 30000 pixels; at most 100 megapixels" in refusal(path)


def pictures_to_damage() -> list[bytes]:
    picture = Image.fromarray(BYTES)
    file = io.BytesIO()
    tifffile.imwrite(file, FLOATS, photometric="rgb", compression="zlib")
    exif = Image.Exif()
    exif[274] = 6
    kinds = [encoded(picture, kind) for kind in ("GIF", "BMP", "TIFF", "WEBP", "PPM", "TGA")]
    jpeg = encoded(picture, "JPEG", exif=exif, icc_profile=profile_of(swap=True))
    return [*kinds, jpeg, deep_png(WORDS), encoded(picture.quantize(4), "PNG"), file.getvalue()]


@settings(max_examples=300, deadline=None, derandomize=True)
@given(
    st.sampled_from(pictures_to_damage()),
    st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=4),
)
def test_damaged_bytes_give_a_picture_or_a_refusal_and_nothing_else(
    tmp_path_factory: pytest.TempPathFactory, whole: bytes, edits: list[tuple[int, int]]
) -> None:
    damaged = bytearray(whole)
    for place, value in edits:
        damaged[place % len(damaged)] = value
    path = tmp_path_factory.getbasetemp() / "damaged"
    path.write_bytes(damaged)
    target, message = torch.empty(3, 0, 0), ""
    try:
        target = load_picture(str(path), 8)
    except UserError as error:
        message = str(error)
    assert "\n" not in message
    assert (target.shape[0], max(target.shape[1:])) == (3, 0 if message else 8)
    assert bool(((target >= 0) & (target <= 1)).all())


# --- samples ---------------------------------------------------------------------------------------------------------


def test_the_samples_load_without_a_network() -> None:
    assert {"astronaut", "camera", "chelsea", "coffee", "hubble_deep_field", "retina", "rocket"} <= set(sample_names())
    for name in sample_names():
        assert max(load_picture(name, 16).shape) == 16


def test_a_sample_equals_the_picture_of_scikit_image() -> None:
    import skimage.data  # noqa: PLC0415  (as slow as it is unneeded elsewhere)

    wanted = torch.from_numpy(skimage.data.astronaut()).permute(2, 0, 1) / 255
    torch.testing.assert_close(load_picture("astronaut", None), wanted, atol=0.01, rtol=0)


def test_a_file_wins_over_a_sample_of_its_name_and_a_folder_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "astronaut").mkdir()
    assert load_picture("astronaut", 32).shape == (3, 32, 32)
    Image.fromarray(BYTES).save(tmp_path / "coffee", "PNG")
    expect(Path("coffee"), BYTES / 255)


def test_a_tilde_means_the_home_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    Image.fromarray(BYTES).save(tmp_path / "photo.png")
    expect(Path("~/photo.png"), BYTES / 255)


# --- background ------------------------------------------------------------------------------------------------------


def some_target() -> Tensor:
    return torch.from_numpy(FLOATS).permute(2, 0, 1)


@pytest.mark.parametrize(
    ("spec", "wanted"),
    [
        ("white", (1, 1, 1)),
        ("black", (0, 0, 0)),
        ("#ff8000", (1, 128 / 255, 0)),
        ("#0A0b0C", (10 / 255, 11 / 255, 12 / 255)),
    ],
)
def test_a_background_is_a_name_or_a_number(spec: str, wanted: tuple[float, ...]) -> None:
    color = background_color(spec, some_target())
    torch.testing.assert_close(color, torch.tensor(wanted, dtype=torch.float32))


def test_the_background_mean_is_the_mean_colour_of_the_target() -> None:
    torch.testing.assert_close(background_color("mean", some_target()), torch.from_numpy(FLOATS.mean((0, 1))))


@pytest.mark.parametrize("spec", ["", "red", "White", "#fff", "#12345", "#gggggg", "ff8000", "#ff80001"])
def test_any_other_background_is_refused_with_the_choices(spec: str) -> None:
    with pytest.raises(UserError, match=r"background=.* use background=mean, white, black or '#rrggbb'"):
        background_color(spec, some_target())
