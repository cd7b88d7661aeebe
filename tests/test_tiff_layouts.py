"""Tests that TIFF files of every layout are read as libtiff reads them, or refused with the decoder they need."""

import itertools
import logging
import struct
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image
from refusals import refusal as refused
from tiffs import (
    BLACK_IS_ZERO,
    CMYK,
    DEFLATE,
    HEIGHT,
    NONE,
    OLD_DEFLATE,
    PACKBITS,
    PALETTE,
    RGB,
    SHORT,
    WHITE_IS_ZERO,
    WIDTH,
    Layout,
    chain,
    ramps,
    tiff,
)

from brushexp.pictures.decode import decode_image, picture_size, read_picture
from brushexp.pictures.tiff import has_codecs, pages_in
from brushexp.pictures.tiff_directories import MOST_DIRECTORIES, directories, first_directory

CHANNELS = {WHITE_IS_ZERO: 1, BLACK_IS_ZERO: 1, RGB: 3, PALETTE: 1}
LAYOUTS = [{"rows": 10}, {"rows": 100}, {"rows": 1}, {"tile": (16, 16)}, {"tile": (32, 16), "swaps_names": True}]
DEPTHS = {NONE: (1, 2, 4, 8, 12, 16), DEFLATE: (1, 4, 8, 16), OLD_DEFLATE: (8,), PACKBITS: (1, 8, 16)}
LEVEL = 1 / 255


def color_map(bits: int, top: int) -> np.ndarray:
    """Make a colour map (3, 2**bits) with values up to 255, or up to 65535 if ``top`` exceeds 255."""
    ramp = np.linspace(0, 255, 2**bits).astype(int)
    return np.stack([ramp, ramp[::-1], ramp * 7 % 256]) * (257 if top > 255 else 1)


def picture_of(samples: np.ndarray, layout: Layout) -> np.ndarray:
    """Convert samples (H, W, C) to colours (H, W, 3) in [0, 1]."""
    if layout.photometric == PALETTE:
        numbers = np.array(next(values for tag, _, values in layout.tags if tag == 320)).reshape(3, -1)
        levels = numbers if numbers.max() < 256 else numbers >> 8
        return np.moveaxis(levels[:, samples[..., 0]], 0, 2) / 255
    unit = samples / (2**layout.bits - 1)
    unit = 1 - unit if layout.photometric == WHITE_IS_ZERO else unit
    return np.broadcast_to(unit, (HEIGHT, WIDTH, 3))


def expect(path: Path, expected: np.ndarray, atol: float = 1.001 * LEVEL) -> None:
    found = read_picture(path)
    found = found / 255 if found.dtype == np.uint8 else found
    assert found.shape == (*picture_size(path), 3) == expected.shape
    assert np.abs(found - expected).max() <= atol


def layouts(compression: int, bits: int):
    ways = itertools.product(CHANNELS, (False, True), (False, True), (False, True), LAYOUTS)
    for photometric, is_big_endian, is_big, is_planar, pieces in ways:
        if (is_planar and photometric != RGB) or (photometric == PALETTE and bits > 8):
            continue
        tags = ((320, SHORT, color_map(bits, 65535).ravel().tolist()),) if photometric == PALETTE else ()
        common = {"photometric": photometric, "is_big_endian": is_big_endian, "is_big": is_big, "tags": tags}
        yield Layout(bits, compression=compression, is_planar=is_planar, **common, **pieces)


@pytest.mark.parametrize(("compression", "bits"), [(one, bits) for one, depths in DEPTHS.items() for bits in depths])
def test_every_layout_is_read_or_refused_by_what_it_needs(tmp_path, compression, bits):
    path, refusals = tmp_path / "a.tif", 0
    for layout in layouts(compression, bits):
        samples = ramps(CHANNELS[layout.photometric], bits)
        path.write_bytes(tiff(samples, layout))
        try:
            expect(path, picture_of(samples, layout))
        except ValueError as error:
            words = f"is a TIFF of {bits} bits a sample, which needs a decoder; pip install 'brushexp[tiff]'"
            assert str(error).endswith(words), layout  # noqa: PT017
            refusals += 1
    assert not refusals or not has_codecs()
    assert not refusals or bits in (2, 4, 12)


@pytest.mark.parametrize("compression", [NONE, PACKBITS, DEFLATE])
@pytest.mark.parametrize("bits", [1, 2, 4, 8])
def test_a_colour_map_of_8_bits_is_read_as_such(tmp_path, bits, compression):
    samples = ramps(1, bits)
    for top, is_big_endian in itertools.product((255, 65535), (False, True)):
        tags = ((320, SHORT, color_map(bits, top).ravel().tolist()),)
        layout = Layout(bits, photometric=PALETTE, compression=compression, is_big_endian=is_big_endian, tags=tags)
        (tmp_path / "scan.tif").write_bytes(tiff(samples, layout))
        expect(tmp_path / "scan.tif", picture_of(samples, layout))
        with Image.open(tmp_path / "scan.tif") as picture:  # from Python, too
            assert np.array_equal(decode_image(picture), read_picture(tmp_path / "scan.tif"))
            picture.load()
            assert np.array_equal(decode_image(picture), read_picture(tmp_path / "scan.tif"))


@pytest.mark.parametrize("bits", [1, 8])
@pytest.mark.parametrize("photometric", CHANNELS)
@pytest.mark.parametrize("is_planar", [False, True])
def test_bytes_that_begin_with_their_last_bit_are_turned(tmp_path, bits, photometric, is_planar):
    if is_planar and photometric != RGB:
        pytest.skip("one plane alone")
    tags = ((320, SHORT, color_map(bits, 65535).ravel().tolist()),) if photometric == PALETTE else ()
    samples = ramps(CHANNELS[photometric], bits)
    for pieces in LAYOUTS:
        layout = Layout(bits, photometric=photometric, is_planar=is_planar, last_bit_first=True, tags=tags, **pieces)
        (tmp_path / "fax.tif").write_bytes(tiff(samples, layout))
        expect(tmp_path / "fax.tif", picture_of(samples, layout))


@pytest.mark.parametrize("predictor", [1, 2])
@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("is_big_endian", [False, True])
def test_differences_of_neighbours_are_summed(tmp_path, predictor, bits, is_big_endian):
    for is_planar in (False, True):
        layout = Layout(
            bits, compression=DEFLATE, predictor=predictor, is_big_endian=is_big_endian, is_planar=is_planar
        )
        (tmp_path / "a.tif").write_bytes(tiff(ramps(3, bits), layout))
        expect(tmp_path / "a.tif", picture_of(ramps(3, bits), layout))


@pytest.mark.parametrize("without", [(278,), (279,), (284,), (259,), (278, 279), (258,), (277,)])
def test_tags_that_may_be_missing_have_the_value_that_the_standard_gives_them(tmp_path, without):
    bits, photometric = (1, BLACK_IS_ZERO) if without == (258,) else (8, BLACK_IS_ZERO)
    layout = Layout(bits, photometric=photometric, rows=HEIGHT, without=without)
    (tmp_path / "a.tif").write_bytes(tiff(ramps(1, bits), layout))
    expect(tmp_path / "a.tif", picture_of(ramps(1, bits), layout))


@pytest.mark.parametrize("layout", [
    Layout(photometric=CMYK), Layout(photometric=CMYK, is_big=True, is_big_endian=True),
    Layout(photometric=CMYK, compression=DEFLATE, is_planar=True), Layout(photometric=CMYK, last_bit_first=True),
])  # fmt: skip
def test_inks_of_8_bits_are_read_in_every_layout(tmp_path, layout):
    inks = ramps(4, 8)
    (tmp_path / "inks.tif").write_bytes(tiff(inks, layout))
    light = Image.fromarray(inks.astype(np.uint8), "CMYK").convert("RGB")
    expect(tmp_path / "inks.tif", np.asarray(light) / 255)


@pytest.mark.parametrize("compression", ["zlib", None])
@pytest.mark.parametrize("order", ["<", ">"])
def test_grey_floats_are_read_in_both_orders_of_bytes(tmp_path, order, compression):
    floats = (ramps(1, 16)[..., 0] / 65535).astype(np.float32)
    tifffile.imwrite(tmp_path / "a.tif", floats, photometric="minisblack", byteorder=order, compression=compression)
    expect(tmp_path / "a.tif", np.repeat(floats[..., None], 3, 2), 1e-6)


@pytest.mark.parametrize("is_big_endian", [False, True])
@pytest.mark.parametrize("tile", [None, (16, 16)])
def test_grey_floats_with_a_predictor_are_read_by_libtiff(tmp_path, is_big_endian, tile):
    floats = (ramps(1, 16) / 65535).astype(np.float32)
    layout = Layout(
        32, photometric=BLACK_IS_ZERO, compression=DEFLATE, predictor=3, is_big_endian=is_big_endian, tile=tile,
        tags=((339, SHORT, [3]),),
    )  # fmt: skip
    (tmp_path / "a.tif").write_bytes(tiff(floats.view(np.uint32).astype(np.int64), layout))
    expect(tmp_path / "a.tif", np.repeat(floats, 3, 2), 1e-6)


LIBVIPS = [
    *(("RGB", one) for one in (None, "tiff_lzw", "tiff_adobe_deflate", "packbits", "jpeg")),
    *(("L", one) for one in (None, "tiff_lzw", "tiff_adobe_deflate", "packbits", "jpeg")),
    *(("1", one) for one in (None, "tiff_ccitt", "group3", "group4", "tiff_lzw", "packbits")),
    *(("P", one) for one in (None, "tiff_lzw", "packbits")), ("RGBA", "tiff_lzw"), ("I;16", "tiff_lzw"),
]  # fmt: skip


@pytest.mark.parametrize(("mode", "compression"), LIBVIPS)
@pytest.mark.parametrize("is_big", [False, True])
def test_what_pillow_writes_is_read_as_libvips_reads_it(tmp_path, mode, compression, is_big):
    vips = pytest.importorskip("pyvips")
    if mode == "I;16":
        picture = Image.fromarray(ramps(1, 16)[..., 0].astype(np.uint16))
    else:
        picture = Image.fromarray(ramps(3, 8).astype(np.uint8)).convert(mode)
    picture.save(tmp_path / "a.tif", compression=compression, big_tiff=is_big)
    other = vips.Image.new_from_file(str(tmp_path / "a.tif"))
    other = other.flatten(background=[255] * (other.bands - 1)) if other.hasalpha() else other
    levels = other.numpy() / (65535 if other.format == "ushort" else 255)
    levels = levels if levels.ndim == 3 else levels[..., None]
    expect(tmp_path / "a.tif", np.broadcast_to(levels, (HEIGHT, WIDTH, 3)), 2 * LEVEL)


VIPS_OPTIONS = [
    {"compression": "lzw", "predictor": "horizontal"}, {"compression": "deflate", "tile": True},
    {"compression": "none", "tile": True, "bigtiff": True}, {"compression": "jpeg", "Q": 98, "tile": True},
    {"compression": "deflate", "pyramid": True, "tile": True}, {"compression": "none", "miniswhite": True},
    {"compression": "deflate", "pyramid": True, "subifd": True, "tile": True}, {"compression": "packbits"},
]  # fmt: skip


@pytest.mark.parametrize("options", VIPS_OPTIONS, ids=lambda options: "-".join(map(str, options.values())))
@pytest.mark.parametrize(("channels", "bits"), [(1, 8), (3, 8), (1, 16), (3, 16)])
def test_what_libvips_writes_is_read_as_it_was(tmp_path, channels, bits, options):
    vips = pytest.importorskip("pyvips")
    if options["compression"] == "jpeg" and bits == 16:
        pytest.skip("JPEG has 8 bits")
    samples = ramps(channels, bits)
    space = {(1, 8): "b-w", (3, 8): "srgb", (1, 16): "grey16", (3, 16): "rgb16"}[channels, bits]
    kind = np.uint8 if bits == 8 else np.uint16
    picture = vips.Image.new_from_array(samples.astype(kind)).copy(interpretation=space)
    picture.tiffsave(str(tmp_path / "a.tif"), tile_width=16, tile_height=16, **options)
    if options.get("miniswhite") and (channels == 3 or bits == 16):
        pytest.skip("which has ink alone in grey of 8 bits")
    atol = 12 * LEVEL if options["compression"] == "jpeg" else 1.001 * LEVEL
    expect(tmp_path / "a.tif", np.broadcast_to(samples / (2**bits - 1), (HEIGHT, WIDTH, 3)), atol)


@pytest.mark.parametrize(("options", "needs"), [
    ({"compression": "lzw"}, "packed as LZW"), ({"compression": "lerc"}, "packed as LERC"),
    ({"compression": "zlib", "predictor": 3}, "of floats with a predictor"),
])  # fmt: skip
def test_packings_are_read_where_imagecodecs_is_installed(tmp_path, options, needs):
    pytest.importorskip("imagecodecs")
    floats = (ramps(3, 16) / 65535).astype(np.float32)
    tifffile.imwrite(tmp_path / "a.tif", floats, photometric="rgb", **options)
    expect(tmp_path / "a.tif", floats, 1e-6)


def retagged(tag: int, value: int) -> bytes:
    """Make a three-channel TIFF of floats, with one tag set to another value."""
    layout = Layout(32, tags=((339, SHORT, [3] * 3),))
    floats = (ramps(3, 16) / 65535).astype(np.float32).view(np.uint32).astype(np.int64)
    data = bytearray(tiff(floats, layout))
    at = data.index(struct.pack("<HH", tag, SHORT))
    data[at + 8 : at + 10] = struct.pack("<H", value)
    return bytes(data)


@pytest.mark.skipif(has_codecs(), reason="with imagecodecs they are read")
@pytest.mark.parametrize(("compression", "words"), [
    (5, "packed as LZW"), (34887, "packed as LERC"), (50000, "packed as Zstandard"), (50002, "packed as JPEG XL"),
])  # fmt: skip
def test_a_whole_file_that_needs_a_decoder_says_which_and_not_to_get_it_again(tmp_path, compression, words):
    (tmp_path / "a.tif").write_bytes(retagged(259, compression))
    for read in (read_picture, picture_size):
        message = refused(read, tmp_path / "a.tif")
        assert message.endswith(f"is a TIFF {words}, which needs a decoder; pip install 'brushexp[tiff]'")
    (tmp_path / "b.tif").write_bytes(tiff(ramps(3, 12), Layout(12, is_big_endian=True)))
    assert "is a TIFF of 12 bits a sample, which needs a decoder" in refused(read_picture, tmp_path / "b.tif")


@pytest.mark.parametrize("back_to", [0, 1, 2])
def test_pages_that_lead_in_a_circle_are_each_looked_at_once(tmp_path, caplog, back_to):
    path = tmp_path / "circle.tif"
    path.write_bytes(chain(3, back_to))
    start = time.process_time()
    assert pages_in(path) == 3
    assert picture_size(path) == (16, 16)
    with caplog.at_level(logging.WARNING):
        assert read_picture(path).shape == (16, 16, 3)
    assert "has 3 pages, and only the first is used" in caplog.text
    assert time.process_time() - start < 10


def test_directories_are_walked_as_far_as_they_go_and_to_a_limit(tmp_path):
    path = tmp_path / "a.tif"
    path.write_bytes(chain(MOST_DIRECTORIES + 5, None))
    assert pages_in(path) == MOST_DIRECTORIES
    path.write_bytes(chain(4, None)[:250])  # within the third
    assert [page.number(256) for page in directories(path)] == [16, 16]
    for data in (
        b"II*\0",
        b"MM\0+\0\x08\0\0",
        b"II*\0\xff\xff\xff\xff",
        b"II+\0\x08\0\0\0" + b"\xff" * 8,
        b"II*\0" + bytes(4),
    ):
        path.write_bytes(data)
        assert first_directory(path) is None


def test_directories_below_a_page_that_lead_back_to_it_are_looked_at_once(tmp_path):
    data = bytearray(chain(2, 0))
    at = data.index(struct.pack("<HH", 278, 4))
    data[at : at + 12] = struct.pack("<HHII", 330, 4, 1, 8)  # replaces the rows per strip
    (tmp_path / "a.tif").write_bytes(data)
    assert read_picture(tmp_path / "a.tif").shape == (16, 16, 3)


def test_what_is_whole_is_never_rescued_and_what_is_cut_says_how_much_is_missing(tmp_path, caplog):
    whole = tiff(ramps(3, 8), Layout(compression=NONE, tile=(16, 16), swaps_names=True))
    path = tmp_path / "tiles.tif"
    path.write_bytes(whole)
    with caplog.at_level(logging.WARNING):
        expect(path, ramps(3, 8) / 255)
        assert "cut short" not in caplog.text
        path.write_bytes(tiff(ramps(3, 8), Layout())[:-40])
        read_picture(path)
        assert "is truncated and painted as it is: 2.7% of the picture is missing" in caplog.text


def test_no_word_of_a_library_is_in_a_refusal(tmp_path):
    chance = np.random.default_rng(0)
    whole = tiff(ramps(3, 8), Layout(compression=PACKBITS))
    foreign = ("Error", "tuple", "argument", "division", "decoder error", "imagecodecs", "not enough", "buffer")
    for _ in range(300):
        at = int(chance.integers(len(whole) if chance.random() < 0.3 else 200))
        (tmp_path / "a.tif").write_bytes(whole[:at] + chance.bytes(2) + whole[at + 2 :])
        with warnings.catch_warnings(action="ignore"):
            try:
                read_picture(tmp_path / "a.tif")
            except ValueError as error:
                assert not [word for word in foreign if word in str(error)], error  # noqa: PT017
