"""Tests of files from cameras, phones, scanners and browsers: colours, pixel shapes, sizes, truncation and credits."""

import io
import logging
import os
import struct
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms, IptcImagePlugin
from PIL.PngImagePlugin import PngInfo
from refusals import refusal as refused
from refusals import refuses
from signals import TO_ADOBE, TO_BT2020, TO_P3, hlg, pq, srgb
from test_pictures import chunk, deep_png, encoded, profile_of

from brushexp.errors import UserError
from brushexp.pictures import kinds
from brushexp.pictures.credits import credits_of, write_credited
from brushexp.pictures.cut_short import has_end
from brushexp.pictures.decode import decode_image, open_picture, picture_size, read_picture
from brushexp.pictures.folders import pictures_in, skipped_files
from brushexp.pictures.kinds import has_codec
from brushexp.pictures.limits import check_pixels, check_whole, halvings, size_of_jxl
from brushexp.pictures.load import PICTURE, load_picture, size_of_picture
from brushexp.tasks import export, paint

HEIGHT, WIDTH = 6, 8
LINEAR = np.random.default_rng(0).random((HEIGHT, WIDTH, 3)) * 0.9  # light of sRGB, 1 is white


def levels(values: np.ndarray) -> np.ndarray:
    return np.rint(255 * values).astype(np.uint8)


def expect(path: Path, light: np.ndarray = LINEAR, worst: float = 3.5) -> None:
    """Assert that a file decodes to this linear light, up to 8-bit rounding, which is coarser for dark colours."""
    found = read_picture(path)
    found = found if found.dtype == np.uint8 else 255 * found
    assert np.abs(found - 255 * srgb(light)).mean() < 1.5
    assert np.abs(found - 255 * srgb(light)).max() < worst


def in_space(matrix: list[list[float]]) -> np.ndarray:
    return LINEAR @ np.array(matrix).T


def png_with(picture: np.ndarray, *extra: bytes) -> bytes:
    png = encoded(Image.fromarray(picture), "PNG")
    return png[:33] + b"".join(extra) + png[33:]


def adobe_exif(space: int = 65535, index: str | None = "R03") -> Image.Exif:
    exif = Image.Exif()
    exif[0x8769] = {0xA001: space} | ({} if index is None else {0xA005: {1: index}})
    return exif


BY_NUMBER = adobe_exif(2, None)


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "WEBP", "TIFF"])
@pytest.mark.parametrize("exif", [adobe_exif(), BY_NUMBER], ids=["R03", "2"])
def test_a_camera_that_was_set_to_adobe_rgb_is_believed(tmp_path, kind, exif):
    if kind == "TIFF" and exif is not BY_NUMBER:
        pytest.skip("Pillow does not write that part of it")
    picture = Image.fromarray(levels(in_space(TO_ADOBE) ** (256 / 563)))
    options = {"JPEG": {"quality": 100, "subsampling": 0}, "WEBP": {"lossless": True}}.get(kind, {})
    picture.save(tmp_path / "_DSC0001", kind, exif=exif.tobytes(), **options)
    expect(tmp_path / "_DSC0001", worst=12)
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    picture.save(tmp_path / "with profile", kind, exif=exif.tobytes(), icc_profile=profile, **options)
    assert np.abs(read_picture(tmp_path / "with profile").astype(float) - np.asarray(picture)).mean() < 2


def test_srgb_of_exif_and_of_png_changes_no_bit(tmp_path):
    numbers = levels(srgb(LINEAR))
    gama, chrm = struct.pack(">I", 45455), struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)
    linear, wide = chunk(b"gAMA", struct.pack(">I", 100_000)), chunk(b"cICP", bytes([12, 13, 0, 1]))
    named = chunk(b"sRGB", b"\0")
    usual = chunk(b"gAMA", gama), chunk(b"cHRM", chrm)
    for extra in (usual, (named, linear), (chunk(b"cICP", bytes([1, 13, 0, 1])),)):
        (tmp_path / "same.png").write_bytes(png_with(numbers, *extra))
        assert np.array_equal(read_picture(tmp_path / "same.png"), numbers)
    (tmp_path / "wide.png").write_bytes(png_with(numbers, wide, named))  # cICP has priority
    assert not np.array_equal(read_picture(tmp_path / "wide.png"), numbers)
    Image.fromarray(numbers).save(tmp_path / "R98.png", exif=adobe_exif(1, "R98"))
    assert np.array_equal(read_picture(tmp_path / "R98.png"), numbers)


P3_CORNERS = struct.pack(">8I", 31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000)


@pytest.mark.parametrize(("numbers", "extra"), [
    (LINEAR, [chunk(b"gAMA", struct.pack(">I", 100_000))]),
    (LINEAR ** (1 / 1.8), [chunk(b"gAMA", struct.pack(">I", 55_556))]),
    (srgb(in_space(TO_P3)), [chunk(b"gAMA", struct.pack(">I", 45_455)), chunk(b"cHRM", P3_CORNERS)]),
    (srgb(in_space(TO_P3)), [chunk(b"cICP", bytes([12, 13, 0, 1]))]),
    (pq(in_space(TO_BT2020)), [chunk(b"cICP", bytes([9, 16, 0, 1]))]),
    (hlg(in_space(TO_BT2020)), [chunk(b"cICP", bytes([9, 18, 0, 1]))]),
    (hlg(in_space(TO_BT2020)), [chunk(b"cICP", bytes([2, 18, 0, 1]))]),
], ids=["linear", "1.8", "cHRM", "P3", "PQ", "HLG", "HLG, no corners"])  # fmt: skip
def test_colours_that_a_png_names_by_number_are_converted(tmp_path, numbers, extra):
    (tmp_path / "a.png").write_bytes(png_with(levels(numbers), *extra))
    expect(tmp_path / "a.png", worst=16)  # 8 bits of light, or of PQ, are coarse in the dark
    deep = np.rint(65535 * numbers[..., :1]).astype(np.uint16)
    if extra[0][4:8] == b"gAMA":  # grey of 16 bits is more precise
        (tmp_path / "grey.png").write_bytes(deep_png(deep, extra[0]))
        exponent = 1e5 / struct.unpack(">I", extra[0][8:12])[0]
        if exponent < 2:
            expected = srgb((deep / 65535) ** exponent)
            np.testing.assert_allclose(read_picture(tmp_path / "grey.png")[..., :1], expected, atol=1e-4)


def test_other_formats_say_their_colours_too(tmp_path):
    qoi = file_of(levels(LINEAR), "QOI")
    (tmp_path / "light.qoi").write_bytes(qoi[:13] + b"\1" + qoi[14:])
    expect(tmp_path / "light.qoi", worst=16)
    Image.fromarray(levels(srgb(in_space(TO_P3)))).save(tmp_path / "p3.avif", quality=100, subsampling="4:4:4")
    data = (tmp_path / "p3.avif").read_bytes()
    at = data.index(b"colrnclx") + 8
    (tmp_path / "p3.avif").write_bytes(data[:at] + struct.pack(">H", 12) + data[at + 2 :])
    expect(tmp_path / "p3.avif", worst=9)
    swapped = profile_of(swap=True)
    Image.new("RGB", (64, 48), (250, 0, 0)).save(tmp_path / "plain.jp2", irreversible=False)
    data, box = (tmp_path / "plain.jp2").read_bytes(), b"colr\2\0\0" + swapped
    at = data.index(b"colr") - 4
    size = struct.unpack(">I", data[at : at + 4])[0]
    whole = data[:at] + struct.pack(">I", len(box) + 4) + box + data[at + size :]
    header = whole.index(b"jp2h") - 4
    grown = struct.unpack(">I", whole[header : header + 4])[0] + len(box) + 4 - size
    (tmp_path / "icc.jp2").write_bytes(whole[:header] + struct.pack(">I", grown) + whole[header + 4 :])
    assert read_picture(tmp_path / "icc.jp2")[5, 5].tolist() == pytest.approx([0, 250, 0], abs=8)
    Image.new("RGB", (WIDTH, HEIGHT), (250, 0, 0)).save(tmp_path / "plain.bmp")
    pixels = (tmp_path / "plain.bmp").read_bytes()[54:]
    info = struct.pack("<IiiHHIIiiII", 124, WIDTH, HEIGHT, 1, 24, 0, len(pixels), 0, 0, 0, 0)
    info += bytes(16) + b"DEBM" + bytes(48) + struct.pack("<IIII", 4, 124 + len(pixels), len(swapped), 0)
    start = b"BM" + struct.pack("<IHHI", 138 + len(pixels) + len(swapped), 0, 0, 138)
    (tmp_path / "icc.bmp").write_bytes(start + info + pixels + swapped)
    assert read_picture(tmp_path / "icc.bmp")[2, 2].tolist() == pytest.approx([0, 250, 0], abs=8)


def refusal(path: Path, side: int | None = None) -> str:
    refused(size_of_picture, str(path), "image", side)  # before a run has a folder
    return refused(load_picture, str(path), side)


FULL = np.random.default_rng(1).integers(0, 256, (48, 64, 3), np.uint8)


def raw(path: Path, sensor: str | None, sub: bool = True, version: bool = False) -> Path:
    """Write a TIFF whose first page is a thumbnail, as in raw photographs."""
    tags = [(50706, "B", 4, bytes([1, 4, 0, 0]), True)] if version else []
    with tifffile.TiffWriter(path) as tiff:
        thumbnail = np.ascontiguousarray(FULL[::8, ::8])
        tiff.write(thumbnail, photometric="rgb", subfiletype=1, subifds=int(sub and sensor is not None), extratags=tags)
        if sensor == "cfa":
            tiff.write(FULL[..., 0].astype(np.uint16), photometric="cfa")
        elif sensor:
            tiff.write(FULL.astype(np.uint16), photometric=34892)
    return path


@pytest.mark.parametrize("name", ["a.dng", "a.nef", "a.cr2", "a.arw", "a.pef", "a.tif"])
@pytest.mark.parametrize("sub", [True, False])
def test_a_raw_photograph_is_not_painted_as_its_thumbnail(tmp_path, name, sub):
    path = raw(tmp_path / name, "cfa", sub)
    assert "is a raw photograph; develop it" in refusal(path)
    if name == "a.dng":
        others = raw(tmp_path / "b.tif", "linear", sub), raw(tmp_path / "b.nef", None)
        for other in (*others, raw(tmp_path / "v", None, version=True)):
            assert "is a raw photograph; develop it" in refusal(other)
        with Image.open(path) as picture, pytest.raises(UserError, match="raw photograph"):
            decode_image(picture)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("sub", [True, False])
@pytest.mark.parametrize("big", [True, False])
def test_the_picture_is_read_and_not_its_thumbnail_before_it(tmp_path, dtype, sub, big):
    full = FULL.astype(dtype) * (257 if dtype is np.uint16 else 1)
    with tifffile.TiffWriter(tmp_path / "a.tif", bigtiff=big) as tiff:
        tiff.write(np.ascontiguousarray(full[::8, ::8]), photometric="rgb", subfiletype=1, subifds=int(sub))
        tiff.write(full, photometric="rgb", compression="zlib")
        tiff.write(full[:9], photometric="rgb")
    found = load_picture(str(tmp_path / "a.tif"), None).permute(1, 2, 0).numpy()
    np.testing.assert_allclose(found, FULL / 255, atol=1e-6)
    assert size_of_picture(str(tmp_path / "a.tif"), "image") == (48, 64)


def deep_jp2(path: Path, samples: np.ndarray, form: str) -> None:
    av = pytest.importorskip("av")
    frame = av.VideoFrame.from_ndarray(samples, format=form)
    coder = av.CodecContext.create("jpeg2000", "w")
    coder.width, coder.height, coder.pix_fmt, coder.time_base = frame.width, frame.height, form, Fraction(1, 25)
    coder.options = {"format": "jp2", "pred": "dwt53"}
    path.write_bytes(b"".join(bytes(packet) for packet in [*coder.encode(frame), *coder.encode(None)]))


def test_white_of_a_jpeg_2000_of_16_bits_stays_white(tmp_path, monkeypatch):
    samples = np.random.default_rng(2).integers(0, 65536, (40, 64, 3), np.uint16)
    samples[:4] = 65535
    deep_jp2(tmp_path / "deep.jp2", samples, "rgb48le")
    np.testing.assert_allclose(read_picture(tmp_path / "deep.jp2"), samples / 65535, atol=1e-5)
    alpha = np.dstack([samples, samples[..., 0]])
    deep_jp2(tmp_path / "alpha.jp2", alpha, "rgba64le")
    opaque = alpha[..., 3:] / 65535
    np.testing.assert_allclose(read_picture(tmp_path / "alpha.jp2"), samples / 65535 * opaque + 1 - opaque, atol=1e-4)
    monkeypatch.setitem(sys.modules, "av", None)
    assert "pip install 'brushexp[video]'" in refusal(tmp_path / "deep.jp2")


def smooth(height: int, width: int) -> np.ndarray:
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    return np.dstack([255 * rows / height, 255 * columns / width, np.full_like(rows, 99)]).astype(np.uint8)


@pytest.mark.parametrize(
    "kind", ["JPEG", "MPO", "JPEG2000", "PNG", "WEBP", "strips", "tiles", "memory", "lzw", "planes"]
)
def test_a_picture_of_too_many_pixels_is_read_at_a_part_of_its_size(tmp_path, monkeypatch, caplog, kind):
    for module in ("limits", "tiff", "load", "jp2"):
        monkeypatch.setattr(f"brushexp.pictures.{module}.MAX_PIXELS", 20_000)
    monkeypatch.setattr("brushexp.pictures.limits.MOST_WHOLE", 400_000)
    monkeypatch.setattr("brushexp.pictures.limits.MOST_PIXELS", 500_000)
    picture, path = smooth(403, 601), tmp_path / "large.tif"
    options = {"strips": {"compression": "zlib", "rowsperstrip": 7}, "tiles": {"compression": "zlib", "tile": (48, 32)}}
    if kind.isupper():
        path = tmp_path / "large"
        Image.fromarray(picture).save(path, kind, quality=95)
    elif kind == "lzw":
        Image.fromarray(picture).save(path, compression="tiff_lzw")
    elif kind == "planes":
        tifffile.imwrite(
            path, picture.transpose(2, 0, 1).copy(), photometric="rgb", planarconfig="separate", compression="zlib"
        )
    else:
        tifffile.imwrite(path, picture, photometric="rgb", **options.get(kind, {}))
    assert "add resolution=4096 to read it smaller" in refusal(path)
    found = 255 * load_picture(str(path), 60).permute(1, 2, 0).numpy()
    assert found.shape == (40, 60, 3)
    expected = np.asarray(Image.fromarray(picture).resize((60, 40), Image.Resampling.LANCZOS), float)
    assert np.abs(found - expected).max() < 8, "edges differ a little"
    assert np.abs(found - expected).mean() < 2
    assert "cut short" not in caplog.text
    assert picture_size(path) == (403, 601)
    PICTURE.check("image", str(path))
    for name in ("MOST_PIXELS", "MOST_WHOLE"):
        monkeypatch.setattr(f"brushexp.pictures.limits.{name}", 200_000)
    os.utime(path, ns=(1, 1))  # sizes of unchanged files are cached
    assert "give a smaller version" in refusal(path, 60)


def test_halvings_lead_to_no_less_than_is_wanted_and_fit_into_memory():
    assert halvings(11648, 8736, 512, 3) == 3
    assert halvings(11648, 8736, 6000, 3) == 0
    assert halvings(30000, 30000, 10000, 3) == 2, "900 megapixels at once are too many"
    assert halvings(9000, 9000, 16, 3) == 0, "no picture of up to 100 megapixels changes"
    for kind, most in (("GIF", 100), ("JXL", 100), ("PNG", 200), ("WEBP", 200)):
        refuses(
            f"the limit is {most} megapixels: give a smaller version", check_pixels, most * 1000 + 1, 1000, kind, 64
        )
    check_pixels(31_000, 31_000, "JPEG", 64)
    check_whole(20_000, 10_000)
    refuses("at most 100 megapixels, or as", check_whole, 10_001, 10_000, is_deep=True)


@pytest.mark.parametrize(("start", "message"), [
    (b"\x76\x2f\x31\x01\x02", "tone-map it"),
    (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n", "tone-map it"),
    (b"%PDF-1.7", "pdftoppm"),
    (b"<?xml version='1.0'?>\n<svg xmlns=", "vector drawing"),
    (b"<!DOCTYPE html><img src=", "web page"),
    (b"gimp xcf v011", "painting program"),
    (b"FUJIFILMCCD-RAW 0201", "raw photograph"),
    (b"\0\0\0\x18ftypcrx \0\0\0\1", "raw photograph"),
    (b"\0\0\0\x18ftypisom\0\0\0\1", "is a film"),
    (b"\x1aE\xdf\xa3\x93B\x82", "is a film"),
    (b"RIFF\0\0\0\0AVI LIST", "is a film"),
    (b"\0\0\0\x18ftypavif\0\0\0\1", "is damaged"),
    (b"version https://git-lfs.github.com/spec/v1", "git lfs pull"),
])  # fmt: skip
def test_what_is_no_picture_is_told_by_what_it_is(tmp_path, start, message):
    (tmp_path / "a.jpg").write_bytes(start + bytes(64))
    assert message in refusal(tmp_path / "a.jpg")


def test_cmyk_of_16_bits_is_refused_and_pictures_are_opened_without_a_word_of_their_size_by_pillow(
    tmp_path, monkeypatch
):
    tifffile.imwrite(tmp_path / "ink.tif", np.zeros((8, 6, 4), np.uint16), photometric="separated")
    assert "is a CMYK TIFF with 16 bits per colour; save it with 8 bits" in refusal(tmp_path / "ink.tif")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)  # Pillow warns above it, and raises above twice as many
    about = PngInfo()
    about.add_text("Title", "Road")
    Image.fromarray(smooth(40, 60)).save(tmp_path / "a.png", pnginfo=about)
    assert credits_of(str(tmp_path / "a.png")) == {"Title": "Road"}
    with open_picture(tmp_path / "a.png") as picture:
        assert picture.size == (60, 40)
    assert Image.MAX_IMAGE_PIXELS == 100


@pytest.mark.parametrize(("start", "extra"), [(b"\0\0\0\x18ftypheic", "heic"), (b"\xff\x0a\0\0", "jxl")])
def test_a_format_that_needs_a_decoder_names_it(tmp_path, monkeypatch, start, extra):
    monkeypatch.setattr(kinds, "CODECS", {extra: ("absent_decoder", None)})
    kinds.has_codec.cache_clear()
    (tmp_path / "a").write_bytes(start + bytes(64))
    assert f"pip install 'brushexp[{extra}]'" in refusal(tmp_path / "a")
    kinds.has_codec.cache_clear()


@pytest.mark.parametrize(("module", "kind"), [("pillow_heif", "HEIF"), ("pillow_jxl", "JXL")])
def test_pictures_of_phones_are_read_where_their_decoder_is_installed(tmp_path, module, kind):
    pytest.importorskip(module)
    kinds.has_codec({"HEIF": "heic", "JXL": "jxl"}[kind])
    exif = adobe_exif()
    exif[274] = 6
    Image.fromarray(smooth(48, 64)).save(tmp_path / "plain", kind, quality=95)
    assert np.abs(read_picture(tmp_path / "plain").astype(int) - smooth(48, 64)).mean() < 4
    if kind == "JXL":
        assert size_of_jxl((tmp_path / "plain").read_bytes()) == (64, 48)
    Image.fromarray(smooth(48, 64)).save(tmp_path / "turned", kind, exif=exif.tobytes(), quality=95)
    assert read_picture(tmp_path / "turned").shape == (64, 48, 3)


def test_a_folder_has_all_that_is_read_and_tells_the_rest(tmp_path):
    kinds_of = {"a.jpg": "JPEG", "b.jfif": "JPEG", "c.avif": "AVIF", "d.jp2": "JPEG2000", "e.mpo": "MPO"}
    kinds_of |= {"f.TGA": "TGA", "g.ppm": "PPM", "h.qoi": "QOI", "i.apng": "PNG"}
    for name, kind in kinds_of.items():
        Image.fromarray(FULL).save(tmp_path / name, kind)
    read = sorted(os.listdir(tmp_path))
    for name in ("x.DNG", "x.MOV", "y.mp4", "x.svg", "notes.txt", ".DS_Store", "._a.jpg"):
        (tmp_path / name).write_bytes(b"?")
    (tmp_path / "more").mkdir()
    (tmp_path / "gone.png").symlink_to(tmp_path / "nothing")
    assert [Path(path).name for path in pictures_in(str(tmp_path))] == read
    lines = skipped_files(str(tmp_path))
    for words in (
        "x.DNG left out: develop",
        "x.MOV, y.mp4 left out: paint a film",
        "x.svg left out",
        "notes.txt left out: they lack the extension of a picture",
    ):
        assert any(words in line for line in lines), (words, lines)
    assert any("in such folders, image='" in line and "/*/*.jpg'" in line for line in lines)
    assert any("gone.png left out: these links are broken" in line for line in lines)
    assert len(lines) == 6
    for path in tmp_path.glob("*.[ajmTpq]*"):
        path.unlink()
    refuses(r"there are no pictures; .*x.DNG left out: develop raw photographs", pictures_in, str(tmp_path / "x*"))


TALL, BROAD = 30, 40
ROWS, COLUMNS = np.mgrid[:TALL, :BROAD]
SMOOTH = np.stack([6 * COLUMNS, 8 * ROWS, 3 * (ROWS + COLUMNS)], 2).astype(np.uint8)
NOISE = np.random.default_rng(3).integers(0, 256, (90, 120, 3), dtype=np.uint8)


def file_of(pixels: np.ndarray, kind: str, **options: object) -> bytes:
    return encoded(Image.fromarray(pixels), kind, **options)


def with_phys(unit: int, across: int, down: int) -> bytes:
    return png_with(SMOOTH, chunk(b"pHYs", struct.pack(">IIB", across, down, unit)))


def with_jfif(unit: int, across: int, down: int) -> bytes:
    jpeg = file_of(SMOOTH, "JPEG", quality=95)
    at = jpeg.index(b"JFIF") + 7
    return jpeg[:at] + struct.pack(">BHH", unit, across, down) + jpeg[at + 5 :]


def gif(byte: int) -> bytes:
    whole = bytearray(file_of(SMOOTH, "GIF"))
    whole[12] = byte
    return bytes(whole)


def with_pasp(wide: int, high: int) -> bytes:
    """Make an AVIF whose box for bits per channel is replaced by a pixel aspect ratio box of the same length."""
    whole = file_of(SMOOTH, "AVIF", quality=95, subsampling="4:4:4")
    at = whole.index(b"\0\0\0\x10pixi") + 4
    return whole[:at] + b"pasp" + struct.pack(">II", wide, high) + whole[at + 12 :]


def with_resc(across: int, down: int) -> bytes:
    """Make a JPEG 2000 whose last header box states its resolution in pixels per metre."""
    whole = file_of(SMOOTH, "JPEG2000")
    at = whole.index(b"jp2h") - 4
    (length,) = struct.unpack_from(">I", whole, at)
    said = struct.pack(">I4sI4sHHHHBB", 26, b"res ", 18, b"resc", down, 1, across, 1, 0, 0)
    return whole[:at] + struct.pack(">I", length + 26) + whole[at + 4 : at + length] + said + whole[at + length :]


def psd(aspect: float) -> bytes:
    """Make a Photoshop file that has a pixel aspect ratio, colour planes, no palette and no layers."""
    head = struct.pack(">4sH6xHIIHH", b"8BPS", 1, 3, TALL, BROAD, 8, 3)
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
    assert found.shape == (2 * TALL, BROAD, 3)
    assert picture_size(path) == found.shape[:2]
    between = found.reshape(TALL, 2, BROAD, 3).mean(1)  # each row became two
    worst = 60 if data[:3] == b"GIF" else 12
    assert np.abs(between - SMOOTH)[2:-2].max() < worst
    with Image.open(path) as picture:
        assert np.array_equal(decode_image(picture), found)


def test_pixels_are_turned_with_the_picture_and_pages_that_are_not_painted_are_told(tmp_path, caplog):
    exif = Image.Exif()
    exif[274] = 6  # a quarter turn
    Image.fromarray(SMOOTH).save(path := tmp_path / "a.png", exif=exif, dpi=(200, 100))
    assert read_picture(path).shape == (BROAD, 2 * TALL, 3)
    assert picture_size(path) == (BROAD, 2 * TALL)
    with tifffile.TiffWriter(path := tmp_path / "a.tif") as tiff:
        for kind in (0, 0, 0, 1):  # the last is a smaller copy
            tiff.write(SMOOTH, photometric="rgb", subfiletype=kind)
    with caplog.at_level(logging.WARNING):
        assert np.array_equal(read_picture(path), SMOOTH)
    assert "has 3 pages, and only the first is used" in caplog.text


DOUBLE_WIDTH = [with_phys(0, 1, 2), with_jfif(0, 1, 2), gif(113), file_of(SMOOTH, "TIFF", dpi=(72, 144))]
DOUBLE_WIDTH += [with_pasp(2, 1), with_resc(5906, 11811), psd(2)]
ALONE = [with_phys(1, 2835, 2834), with_phys(0, 0, 0), with_phys(0, 1, 100), with_jfif(0, 0, 1), with_jfif(2, 0, 0)]
ALONE += [gif(49), file_of(SMOOTH, "TIFF"), file_of(SMOOTH, "WEBP", lossless=True)]


@pytest.mark.parametrize(("times", "data"), [*((2, data) for data in DOUBLE_WIDTH), *((1, data) for data in ALONE)])
def test_wide_pixels_are_made_square_and_numbers_that_are_rounded_or_impossible_leave_them_alone(tmp_path, times, data):
    (tmp_path / "a").write_bytes(data)
    assert read_picture(tmp_path / "a").shape == (TALL, times * BROAD, 3)
    assert picture_size(tmp_path / "a") == (TALL, times * BROAD)


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
    assert refusal(path).endswith("is truncated: the file ends before the picture does; get the whole file")


@pytest.mark.parametrize("fewer", [2, 0.5, 0.9])
def test_a_cut_jpeg_xl_whose_length_stands_nowhere_may_be_cut_or_damaged(tmp_path, fewer):
    pytest.importorskip("pillow_jxl")
    has_codec("jxl")
    whole = file_of(NOISE, "JXL", lossless=True)
    path = tmp_path / "a"
    path.write_bytes(whole)
    assert read_picture(path).shape == NOISE.shape
    path.write_bytes(whole[: -fewer if fewer > 1 else int(len(whole) * (1 - fewer))])
    assert "is truncated, damaged or cannot be decoded" in refusal(path)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "GIF", "QOI", "TIFF", "BMP", "TGA"])
def test_the_end_of_a_file_is_known_where_its_format_says_it(tmp_path, kind):
    whole = file_of(NOISE, kind, **({"compression": "tiff_lzw"} if kind == "TIFF" else {}))
    (tmp_path / "a").write_bytes(whole)
    (tmp_path / "b").write_bytes(whole[:-200])
    expected = (None, None) if kind in ("BMP", "TGA") else (True, False)
    assert (has_end(tmp_path / "a"), has_end(tmp_path / "b")) == expected


def test_the_end_of_a_thumbnail_is_not_that_of_its_picture(tmp_path, caplog):
    whole = file_of(SMOOTH.repeat(4, 0).repeat(4, 1), "JPEG")
    thumbnail = b"Exif\0\0" + file_of(SMOOTH, "JPEG")
    segment = b"\xff\xe1" + struct.pack(">H", len(thumbnail) + 2) + thumbnail
    (tmp_path / "a.jpg").write_bytes((whole[:2] + segment + whole[2:])[:-2])
    with caplog.at_level(logging.WARNING):
        assert read_picture(tmp_path / "a.jpg").shape == (4 * TALL, 4 * BROAD, 3)
    assert "is truncated and painted as it is" in caplog.text


@pytest.mark.parametrize("progressive", [True, False])
def test_a_jpeg_that_lacks_a_few_bytes_is_painted_and_told_and_one_that_lacks_much_is_refused(
    tmp_path, caplog, progressive
):
    path = tmp_path / "cut.jpg"
    data = file_of(NOISE.repeat(3, 0).repeat(3, 1), "JPEG", quality=90, progressive=progressive)
    whole = np.asarray(Image.open(io.BytesIO(data))).astype(int)
    for fewer in (2, 40):
        path.write_bytes(data[:-fewer])
        with caplog.at_level(logging.WARNING):
            found = read_picture(path).astype(int)
        assert (np.abs(found - whole).max(2) > 9).mean() < 0.02
        assert "is truncated and painted as it is" in caplog.text
        assert size_of_picture(str(path), "image") == whole.shape[:2]
        os.utime(path, ns=(fewer, fewer))
    if not progressive:  # otherwise the whole picture exists, only coarser
        path.write_bytes(data[: len(data) * 6 // 10])
        assert "it is truncated: 4" in (message := refusal(path))
        assert "% of the picture is missing); get the whole file" in message


XMP = """<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"
 xmlns:dc="http://purl.org/dc/elements/1.1/"><rdf:Description xmlns:p="http://ns.adobe.com/photoshop/1.0/"
 p:DateCreated="2024-05-06"><dc:title><rdf:Alt><rdf:li xml:lang="x-default">Bäume</rdf:li></rdf:Alt></dc:title>
<dc:creator><rdf:Seq><rdf:li>A. Löw</rdf:li><rdf:li>B. 李</rdf:li></rdf:Seq></dc:creator></rdf:Description></rdf:RDF>
</x:xmpmeta>"""
CREDITED = Image.fromarray(np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8))


def photo(path: Path, **extra: object) -> Path:
    exif = Image.Exif()
    exif[315], exif[33432], exif[306] = "A. Author", "(c) 2024 A. Author\n all rights", "2024:01:02 03:04:05"
    exif[0x8769], exif[0x8825] = {36867: "2023:01:02 03:04:05"}, {1: "N", 2: (48.0, 8.0, 33.0)}
    CREDITED.save(path, exif=exif.tobytes(), **extra)
    return path


def test_titles_and_rights_are_read_wherever_they_stand(tmp_path, monkeypatch):
    assert credits_of(str(photo(tmp_path / "a.jpg"))) == {
        "Author": "A. Author", "Copyright": "(c) 2024 A. Author all rights", "Creation Time": "2023:01:02 03:04:05",
    }  # fmt: skip
    found = credits_of(str(photo(tmp_path / "b.jpg", xmp=XMP.encode())))
    assert (found["Title"], found["Author"], found["Creation Time"]) == ("Bäume", "A. Löw, B. 李", "2024-05-06")
    assert found["Copyright"] == "(c) 2024 A. Author all rights"
    bomb = "<!DOCTYPE x [<!ENTITY a 'b'>]>" + XMP
    assert credits_of(str(photo(tmp_path / "c.jpg", xmp=bomb.encode())))["Author"] == "A. Author"
    CREDITED.save(tmp_path / "d.jpg")
    entries = {(2, 5): b"Title", (2, 80): [b"One", b"Two"]}
    monkeypatch.setattr(IptcImagePlugin, "getiptcinfo", lambda picture: entries)
    assert credits_of(str(tmp_path / "d.jpg")) == {"Title": "Title", "Author": "One, Two"}
    assert credits_of("coffee") == credits_of(str(tmp_path)) == {}
    (tmp_path / "e.jpg").write_bytes(b"damaged")
    assert credits_of(str(tmp_path / "e.jpg")) == {}


def test_a_png_says_srgb_and_its_credits_twice(tmp_path):
    entries = {"Title": "Bäume", "Author": "A. 李", "Copyright": "(c) A.", "Creation Time": "2024"}
    write_credited(tmp_path / "a.png", np.asarray(CREDITED), entries)
    with Image.open(tmp_path / "a.png") as file:
        file.load()
        assert (file.info["srgb"], file.text) == (0, entries)
        assert file.getexif()[33432] == "(c) A."
    assert credits_of(str(tmp_path / "a.png")) == entries
    assert np.array_equal(read_picture(tmp_path / "a.png"), np.asarray(CREDITED))


@pytest.mark.slow
def test_a_painting_and_its_print_carry_the_credits_of_the_photograph(run_task, tmp_path):
    path = photo(tmp_path / "a.jpg", xmp=XMP.encode())
    run_task(paint, f"image={path}", "look=plain", "strokes=5", "steps=1", "frames=0", "report=false")
    for resolution in (None, 64):
        if resolution:
            words = (f"catalogue={tmp_path / 'catalogue.h5'}", f"resolution={resolution}", "overwrite=true")
            run_task(export, "task=export", "to=png", *words)
        with Image.open(tmp_path / "painting.png") as file:
            assert max(file.size) == (resolution or 32)
            assert (file.info["srgb"], file.text["Title"], file.getexif()[33432][:5]) == (0, "Bäume", "(c) 2")
            assert 0x8825 not in file.getexif(), "the place"
