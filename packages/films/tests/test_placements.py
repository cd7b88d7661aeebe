"""Test that pictures are mirrored, rotated and cropped as a film's metadata specifies."""

import struct
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from brushexp_films.clips import open_clip, timed_pictures
from brushexp_films.cropping import crop_of
from containers import clap, film_with

av = pytest.importorskip("av")
HEIGHT, WIDTH = 48, 64
PICTURE = np.stack(
    [*(4 * axis for axis in np.mgrid[0:HEIGHT, 0:WIDTH]), np.full((HEIGHT, WIDTH), 90)], 2
).astype(np.uint8)  # fmt: skip
CODED = 6  # mean change by coding, in levels
ONE = 65536  # the number 1 in a matrix
MATRICES = {  # a, b, c, d: the pixel (x, y) is shown at (a x + c y, b x + d y)
    (1, 0, 0, 1): lambda p: p,
    (-1, 0, 0, 1): np.fliplr,
    (-1, 0, 0, -1): lambda p: np.rot90(p, 2),
    (1, 0, 0, -1): np.flipud,
    (0, 1, 1, 0): lambda p: p.transpose(1, 0, 2),
    (0, 1, -1, 0): lambda p: np.rot90(p, -1),  # clockwise
    (0, -1, -1, 0): lambda p: np.rot90(p, 2).transpose(1, 0, 2),
    (0, -1, 1, 0): lambda p: np.rot90(p, 1),
}


def film(path: Path) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1" if path.suffix == ".mkv" else "libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for number in range(2):
            frame = av.VideoFrame.from_ndarray(PICTURE, format="rgb24")
            frame.pts, frame.time_base = number, Fraction(1, 25)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def with_matrix(path: Path, matrix: tuple[int, ...], scale: float = 1) -> Path:
    whole = bytearray(path.read_bytes())
    at = whole.index(b"tkhd") + 44
    assert struct.unpack_from(">9i", whole, at) == (ONE, 0, 0, 0, ONE, 0, 0, 0, 1 << 30)
    a, b, c, d = (round(ONE * scale * number) for number in matrix)
    across, down = (ONE * WIDTH if a < 0 or c < 0 else 0), (ONE * HEIGHT if b < 0 or d < 0 else 0)
    struct.pack_into(">9i", whole, at, a, b, 0, c, d, 0, across, down, 1 << 30)
    path.write_bytes(whole)
    return path


def expect(path: Path, expected: np.ndarray) -> None:
    clip = open_clip(path)
    for shown in timed_pictures(clip):
        assert shown.picture.shape == expected.shape == (*clip.size, 3)
        assert np.abs(shown.picture.astype(int) - expected).mean() < CODED


@pytest.mark.parametrize("suffix", ["mp4", "mov"])
@pytest.mark.parametrize("matrix", MATRICES)
def test_each_of_the_eight_matrices_of_a_film_is_heeded(tmp_path, matrix, suffix):
    expect(with_matrix(film(tmp_path / f"a.{suffix}"), matrix), MATRICES[matrix](PICTURE))


@pytest.mark.parametrize("angle", [3, 87, 178, -92])
@pytest.mark.parametrize("is_mirrored", [False, True])
def test_a_film_that_is_turned_by_another_angle_is_turned_by_the_nearest_quarter(tmp_path, angle, is_mirrored):
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    mirror = -1 if is_mirrored else 1
    path = with_matrix(film(tmp_path / "a.mp4"), (mirror * cosine, mirror * sine, -sine, cosine))
    expect(path, np.rot90(np.fliplr(PICTURE) if is_mirrored else PICTURE, -round(angle / 90)))


@pytest.mark.parametrize("suffix", ["mp4", "mov"])
@pytest.mark.parametrize("matrix", [(1, 0, 0, 1), (0, 1, -1, 0), (-1, 0, 0, 1)])
def test_the_clean_aperture_of_a_film_is_what_is_shown_before_it_is_turned(tmp_path, matrix, suffix):
    path = with_matrix(film(tmp_path / f"a.{suffix}"), matrix)
    path.write_bytes(film_with(path.read_bytes(), b"avc1", [clap(32, 24, -16, 8)]))
    expect(path, MATRICES[matrix](PICTURE[16:40, 8:40]))


def test_a_clean_aperture_beyond_the_picture_counts_for_nothing(tmp_path):
    path = film(tmp_path / "a.mp4")
    path.write_bytes(film_with(path.read_bytes(), b"avc1", [clap(320, 24, 0, 0)]))
    expect(path, PICTURE)


def with_margins(path: Path, sides: tuple[bytes, bytes], pixels: tuple[int, int]) -> Path:
    """Insert two crop margins after the picture size in a Matroska film, and shrink the empty element that follows."""
    whole = path.read_bytes()
    at = whole.index(b"\xe0\x8a\xb0\x81")  # the video element of ten bytes, six of which are the picture size
    sides_of_pictures, between, empty = whole[at + 2 : at + 8], whole[at + 12 : at + 16], whole[at + 16 : at + 27]
    assert (between[:2], empty[:1]) == (b"\x55\xee", b"\xec")
    margins = b"".join(side + bytes([0x81, count]) for side, count in zip(sides, pixels, strict=True))
    described = b"\xe0\x8e" + sides_of_pictures + margins + between + b"\xec\x85" + bytes(5)
    path.write_bytes(whole[:at] + described + whole[at + 27 :])
    return path


LEFT, RIGHT, TOP, BOTTOM = b"\x54\xcc", b"\x54\xdd", b"\x54\xbb", b"\x54\xaa"


@pytest.mark.parametrize(("sides", "shown"), [
    ((LEFT, TOP), PICTURE[6:, 10:]), ((RIGHT, BOTTOM), PICTURE[:-6, :-10]), ((LEFT, BOTTOM), PICTURE[:-6, 10:]),
])  # fmt: skip
def test_the_margins_of_a_matroska_film_are_not_shown(tmp_path, sides, shown):
    expect(with_margins(film(tmp_path / "a.mkv"), sides, (10, 6)), shown)


def test_margins_that_leave_nothing_count_for_nothing_and_damage_ends_the_search(tmp_path):
    path = with_margins(film(tmp_path / "a.mkv"), (LEFT, TOP), (WIDTH, 6))
    assert crop_of(path, HEIGHT, WIDTH) is None
    whole = path.read_bytes()
    for at in range(0, 600, 7):
        path.write_bytes(whole[:at] + b"\0\xff\0\xff" + whole[at + 4 :])
        crop_of(path, HEIGHT, WIDTH)
        path.write_bytes(whole[:at])
        crop_of(path, HEIGHT, WIDTH)
