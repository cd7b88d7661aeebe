"""Files as cameras, phones, scanners and browsers leave them: their colours, their sizes, and what they are not."""

import io
import os
import struct
import sys
import zlib
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms
from PIL.PngImagePlugin import PngInfo
from signals import TO_ADOBE, TO_BT2020, TO_P3, hlg, pq, srgb

from brushexp.errors import UserError
from brushexp.pictures import kinds
from brushexp.pictures.credits import credits_of
from brushexp.pictures.decode import decode_image, open_picture, picture_size, read_picture
from brushexp.pictures.folders import left_out, pictures_in
from brushexp.pictures.limits import check_pixels, check_whole, halvings, size_of_jxl
from brushexp.pictures.load import PICTURE, load_picture, size_of_picture

HEIGHT, WIDTH = 6, 8
LINEAR = np.random.default_rng(0).random((HEIGHT, WIDTH, 3)) * 0.9  # light of sRGB, 1 is white


def levels(values: np.ndarray) -> np.ndarray:
    return np.rint(255 * values).astype(np.uint8)


def expect(path: Path, light: np.ndarray = LINEAR, worst: float = 3.5) -> None:
    """A file shows this light, but for the rounding of its own 8 bits, which dark colours multiply."""
    found = read_picture(path)
    found = found if found.dtype == np.uint8 else 255 * found
    assert np.abs(found - 255 * srgb(light)).mean() < 1.5
    assert np.abs(found - 255 * srgb(light)).max() < worst


def in_space(matrix: list[list[float]]) -> np.ndarray:
    return LINEAR @ np.array(matrix).T


def chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png_with(picture: np.ndarray, *extra: bytes) -> bytes:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "PNG")
    return file.getvalue()[:33] + b"".join(extra) + file.getvalue()[33:]


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
    (tmp_path / "wide.png").write_bytes(png_with(numbers, wide, named))  # cICP counts before all others
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
    if extra[0][4:8] == b"gAMA":  # grey of 16 bits keeps them
        rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in deep)
        first = chunk(b"IHDR", struct.pack(">IIBBBBB", WIDTH, HEIGHT, 16, 0, 0, 0, 0))
        packed = chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
        (tmp_path / "grey.png").write_bytes(b"\x89PNG\r\n\x1a\n" + first + b"".join(extra[:1]) + packed)
        exponent = 1e5 / struct.unpack(">I", extra[0][8:12])[0]
        if exponent < 2:
            expected = srgb((deep / 65535) ** exponent)
            np.testing.assert_allclose(read_picture(tmp_path / "grey.png")[..., :1], expected, atol=1e-4)


def test_other_formats_say_their_colours_too(tmp_path):
    linear = Image.fromarray(levels(LINEAR))
    file = io.BytesIO()
    linear.save(file, "QOI")
    (tmp_path / "light.qoi").write_bytes(file.getvalue()[:13] + b"\1" + file.getvalue()[14:])
    expect(tmp_path / "light.qoi", worst=16)
    Image.fromarray(levels(srgb(in_space(TO_P3)))).save(tmp_path / "p3.avif", quality=100, subsampling="4:4:4")
    data = (tmp_path / "p3.avif").read_bytes()
    at = data.index(b"colrnclx") + 8
    (tmp_path / "p3.avif").write_bytes(data[:at] + struct.pack(">H", 12) + data[at + 2 :])
    expect(tmp_path / "p3.avif", worst=9)
    swapped = swapped_profile()
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


def swapped_profile() -> bytes:
    """An sRGB profile whose red and green primaries are exchanged."""
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    return profile.replace(b"rXYZ", b"____", 1).replace(b"gXYZ", b"rXYZ", 1).replace(b"____", b"gXYZ")


def refusal(path: Path, side: int | None = None) -> str:
    with pytest.raises(UserError) as caught:
        load_picture(str(path), side)
    assert "\n" not in str(caught.value)
    with pytest.raises(UserError):
        size_of_picture(str(path), "image", side)  # before a run has a folder
    return str(caught.value)


FULL = np.random.default_rng(1).integers(0, 256, (48, 64, 3), np.uint8)


def raw(path: Path, sensor: str | None, sub: bool = True, version: bool = False) -> Path:
    """A TIFF whose first page is a thumbnail, as raw photographs are."""
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
    os.utime(path, ns=(1, 1))  # sizes of files that stay as they are, are known
    assert "make it smaller" in refusal(path, 60)


def test_pictures_are_opened_without_a_word_of_their_size_by_pillow(tmp_path, monkeypatch):
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)  # Pillow warns above it, and raises above twice as many
    about = PngInfo()
    about.add_text("Title", "Road")
    Image.fromarray(smooth(40, 60)).save(tmp_path / "a.png", pnginfo=about)
    assert credits_of(str(tmp_path / "a.png")) == {"Title": "Road"}
    with open_picture(tmp_path / "a.png") as picture:
        assert picture.size == (60, 40)
    assert Image.MAX_IMAGE_PIXELS == 100


def test_halvings_lead_to_no_less_than_is_wanted_and_fit_into_memory():
    assert halvings(11648, 8736, 512, 3) == 3
    assert halvings(11648, 8736, 6000, 3) == 0
    assert halvings(30000, 30000, 10000, 3) == 2, "900 megapixels at once are too many"
    assert halvings(9000, 9000, 16, 3) == 0, "no picture of up to 100 megapixels changes"
    for kind, most in (("GIF", 100), ("JXL", 100), ("PNG", 200), ("WEBP", 200)):
        with pytest.raises(UserError, match=f"at most {most} megapixels are read: make it smaller"):
            check_pixels(most * 1000 + 1, 1000, kind, 64)
    check_pixels(31_000, 31_000, "JPEG", 64)
    check_whole(20_000, 10_000)
    with pytest.raises(UserError, match="at most 100 megapixels, or as"):
        check_whole(10_001, 10_000, is_deep=True)


@pytest.mark.parametrize(("start", "message"), [
    (b"\x76\x2f\x31\x01\x02", "tone-map it"),
    (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n", "tone-map it"),
    (b"%PDF-1.7", "pdftoppm"),
    (b"<?xml version='1.0'?>\n<svg xmlns=", "drawing of vectors"),
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


def test_cmyk_of_16_bits_is_refused_in_plain_words(tmp_path):
    tifffile.imwrite(tmp_path / "ink.tif", np.zeros((8, 6, 4), np.uint16), photometric="separated")
    assert "is a TIFF of CMYK with 16 bits a colour; save it with 8 bits" in refusal(tmp_path / "ink.tif")


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
    lines = left_out(str(tmp_path))
    for words in ("x.DNG left out: raw", "x.MOV, y.mp4 left out: a film", "x.svg left out", "notes.txt left out: no p"):
        assert any(words in line for line in lines), (words, lines)
    assert any("more left out: for what is in such folders, image='" in line and "/*/*.jpg'" in line for line in lines)
    assert any("gone.png left out: they lead to no file" in line for line in lines)
    assert len(lines) == 6
    for path in tmp_path.glob("*.[ajmTpq]*"):
        path.unlink()
    with pytest.raises(UserError, match=r"no picture is there; .*x.DNG left out: raw photographs"):
        pictures_in(str(tmp_path / "x*"))
