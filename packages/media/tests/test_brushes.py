"""Test that brush files from other programs are read, and that strokes keep thin starts and frayed ends."""

import io
import struct
import zipfile

import numpy as np
import pytest
import torch
from brushexp_media.brushes.brush import Brush, dry_brush
from brushexp_media.brushes.gimp import Stamp, read_stamps
from brushexp_media.brushes.marks import columns_for, drag_stamps, place_of, read_marks
from brushexp_media.brushes.photoshop import read_abr
from brushexp_media.brushes.rule import BRUSH
from brushexp_media.brushes.task import STROKES, sheet_of
from PIL import Image
from torch.testing import assert_close

import brushexp
from brushexp.cli.program import expand_arguments
from brushexp.errors import UserError
from brushexp.plugins.renderer.base import window_pictures


def gbr(mask: np.ndarray, spacing: int = 20, depth: int = 1, version: int = 2) -> bytes:
    """Encode a brush in GIMP's format; with a depth of 4, the mask is the alpha channel of a pixmap."""
    pixels = mask if depth == 1 else np.dstack([np.full((*mask.shape, 3), 90, np.uint8), mask])
    rest = b"GIMP" + struct.pack(">I", spacing) if version == 2 else b""
    head = struct.pack(">5I", 20 + len(rest) + 4, version, mask.shape[1], mask.shape[0], depth)
    return head + rest + b"dot\0" + pixels.tobytes()


def wedge(height: int = 60, width: int = 400) -> np.ndarray:
    """Draw the coverage of a stroke with a thin start, and a square end at which the lower hairs are missing."""
    y, x = np.mgrid[-1 : 1 : 1j * height, 0 : 1 : 1j * width]
    return ((np.abs(y) <= np.minimum(1, 0.1 + 3 * x)) & (x < np.where(y > 0, 0.7, 1.1))).astype(np.float32)


def framed(mark: np.ndarray, ground: float = 0.0) -> np.ndarray:
    return np.pad(mark, 20, constant_values=ground)


DOT = (255 * (np.hypot(*np.mgrid[-1:1:16j, -1:1:16j]) < 0.9)).astype(np.uint8)


def packed(row: bytes) -> bytes:
    """Compress a row with PackBits, using runs of equal bytes and single literal bytes."""
    parts, at = b"", 0
    while at < len(row):
        run = next((k for k in range(1, min(128, len(row) - at)) if row[at + k] != row[at]), min(128, len(row) - at))
        parts += struct.pack(">b", 1 - run) + row[at : at + 1] if run > 1 else b"\0" + row[at : at + 1]
        at += run
    return parts


def sampled(mask: np.ndarray, depth: int = 8, is_packed: bool = False, cut: int = 0) -> bytes:
    """Encode the bounds, depth and pixels of a Photoshop brush, without the last ``cut`` bytes of packed rows."""
    height, width = mask.shape
    pixels = mask if depth == 8 else (mask.astype(np.uint16) * 257).astype(">u2")
    rows = [packed(row.tobytes()) for row in pixels]
    rows = [row[: len(row) - cut] for row in rows]
    sizes = struct.pack(f">{height}H", *map(len, rows))
    data = sizes + b"".join(rows) if is_packed else pixels.tobytes()
    return struct.pack(">4iHB", 5, 7, 5 + height, 7 + width, depth, is_packed) + data


def old_abr(masks, version: int, spacing: int = 40, cut: int = 0) -> bytes:
    """Encode a brush set as Photoshop did up to version 6; its first brush is a formula."""
    formula = struct.pack(">HI", 1, 14) + bytes(14)
    parts = [formula]
    for mask in masks:
        name = "dot\0".encode("utf-16-be")
        head = struct.pack(">IH", 0, spacing) + (struct.pack(">I", len(name) // 2) + name if version == 2 else b"")
        brush = head + bytes(9) + sampled(mask, is_packed=True, cut=cut)
        parts.append(struct.pack(">HI", 2, len(brush)) + brush)
    return struct.pack(">HH", version, len(parts)) + b"".join(parts)


def abr_in_sections(masks, magic: bytes = b"8BIM", minor: int = 2, version: int = 6, depth: int = 8) -> bytes:
    """Encode a brush set as Photoshop has done since version 7, with other sections before and after the brushes."""
    brushes = b""
    for k, mask in enumerate(masks):
        brush = bytes(37 + {1: 10, 2: 264}[minor]) + sampled(mask, depth, is_packed=bool(k % 2))
        brushes += struct.pack(">I", len(brush)) + brush + bytes(-len(brush) % 4)
    sections = {b"patt": b"1234", b"samp": brushes, b"desc": b""}
    body = b"".join(magic + name + struct.pack(">I", len(data)) + data for name, data in sections.items())
    return struct.pack(">HH", version, minor) + body


def archive(files: dict[str, bytes]) -> bytes:
    with zipfile.ZipFile(file := io.BytesIO(), "w", zipfile.ZIP_DEFLATED) as made:
        for name, data in files.items():
            made.writestr(name, data)
    return file.getvalue()


def png(levels: np.ndarray) -> bytes:
    Image.fromarray(levels).save(file := io.BytesIO(), "PNG")
    return file.getvalue()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("kind", ["bright", "dark", "scan", "alpha", "upright"])
def test_a_picture_of_a_stroke_is_coverage(folder, kind):
    mark = framed(wedge())
    noise = 0.02 * np.random.default_rng(0).standard_normal(mark.shape)
    grey = {"bright": mark, "dark": 1 - mark, "scan": 0.9 - 0.7 * mark + noise, "alpha": mark, "upright": mark}[kind]
    levels = (255 * grey.clip(0, 1)).round().astype(np.uint8)
    if kind == "alpha":
        levels = np.dstack([np.full((*mark.shape, 3), 77, np.uint8), levels])
    Image.fromarray(np.rot90(levels, -1) if kind == "upright" else levels).save("stroke.png")
    (read,) = read_marks(["stroke.png"])
    assert read.coverage.shape == (60, 400)
    assert np.abs(read.coverage - wedge()).max() < (0.2 if kind == "scan" else 1e-6)
    assert_close(np.array(place_of(read.coverage)), np.array([30.0, 30.0]), atol=1.0, rtol=0)


@pytest.mark.parametrize(("depth", "version"), [(1, 2), (4, 2), (1, 1)])
def test_a_brush_of_gimp_is_its_stamp(depth, version):
    (stamp,) = read_stamps(gbr(DOT, 35, depth, version))
    assert_close(stamp.coverage, DOT.astype(np.float32) / 255)
    assert stamp.spacing == (0.35 if version == 2 else 0.25)


def test_a_pipe_has_all_of_its_stamps_each_first_in_one_mark(folder):
    stamps = [DOT, DOT[:8], DOT[:, :4]]
    (folder / "pipe.gih").write_bytes(b"Leaves\n3 ncells:3 sel0:random\n" + b"".join(map(gbr, stamps)))
    assert [stamp.coverage.shape for stamp in read_stamps((folder / "pipe.gih").read_bytes())] == [
        (16, 16), (8, 16), (16, 4),
    ]  # fmt: skip
    assert [mark.name for mark in read_marks(["pipe.gih"])] == ["pipe.gih 1", "pipe.gih 2", "pipe.gih 3"]


RAMP = np.arange(15 * 9, dtype=np.uint8).reshape(9, 15)  # odd sizes, so that records are padded to four bytes


@pytest.mark.parametrize("version", [1, 2])
def test_old_sets_of_photoshop_have_the_stamps_of_their_sampled_brushes(version):
    stamps = read_abr(old_abr([DOT, RAMP], version, spacing=40))
    for stamp, mask in zip(stamps, (DOT, RAMP), strict=True):
        assert_close(stamp.coverage, mask.astype(np.float32) / 255)
        assert stamp.spacing == 0.4


@pytest.mark.parametrize("version", [6, 7, 10])
@pytest.mark.parametrize("minor", [1, 2])
@pytest.mark.parametrize("depth", [8, 16])
def test_newer_sets_of_photoshop_have_theirs_in_sections(version, minor, depth):
    stamps = read_abr(abr_in_sections([RAMP, DOT, RAMP], minor=minor, version=version, depth=depth))
    for stamp, mask in zip(stamps, (RAMP, DOT, RAMP), strict=True):
        assert_close(stamp.coverage, mask.astype(np.float32) / 255)


@pytest.mark.parametrize("whole", [old_abr([DOT, RAMP], 2), abr_in_sections([RAMP, DOT])])
def test_a_set_cut_short_within_its_brushes_is_refused(whole):
    behind = len(whole) - whole.rfind(b"8BIMdesc") if b"8BIM" in whole else 0
    for end in range(len(whole) - behind):
        with pytest.raises(UserError, match=r"is damaged|no brush with a picture"):
            read_abr(whole[:end])


def test_each_brush_of_a_set_is_a_mark_and_of_large_sets_the_first_are_used(folder, caplog):
    (folder / "set.abr").write_bytes(abr_in_sections([DOT, RAMP]))
    assert [mark.name for mark in read_marks(["set.abr"])] == ["set.abr 1", "set.abr 2"]
    (folder / "many.abr").write_bytes(old_abr([DOT] * 70, 1))
    assert len(read_marks(["many.abr"])) == 64
    assert "many.abr has more than 64 brushes; the first 64 are used" in caplog.text


def test_shapes_of_procreate_and_bundles_of_krita_are_brushes(folder):
    shape, grain = png(np.pad(DOT, 4)), png(DOT)
    files = {"A/Shape.png": shape, "A/Grain.png": grain, "A/Reset/Shape.png": shape, "B/Brush.archive": b"x"}
    (folder / "x.brushset").write_bytes(archive(files | {"brushset.plist": b"x"}))
    (folder / "x.brush").write_bytes(archive({"Shape.png": shape, "Brush.archive": b"x"}))
    bundle = {"brushes/b.gbr": gbr(DOT), "brushes/a.png": png(255 - np.pad(DOT, 4)), "paintoppresets/c.kpp": b"x"}
    (folder / "x.bundle").write_bytes(archive(bundle | {"brushes/d.abr": abr_in_sections([DOT, DOT])}))
    names = {
        "x.brushset": ["x.brushset: A.png"],
        "x.brush": ["x.brush: brush.png"],
        "x.bundle": ["x.bundle: a.png", "x.bundle: b.gbr", "x.bundle: d.abr 1", "x.bundle: d.abr 2"],
    }
    for file, expected in names.items():
        marks = read_marks([file])
        assert [mark.name for mark in marks] == expected
        for mark in marks:
            assert len(mark.coverage) in (14, 16), "marks are dabs of the dot, dark on white or bright on black"
            assert mark.coverage.max() == 1


def test_a_stamp_is_dragged_with_its_spacing_and_dabs_lie_over_each_other():
    half = Stamp(np.full((4, 4), 0.5, np.float32), 0.5)
    assert_close(drag_stamps([half])[0, :8], np.float32([0.5, 0.5, 0.75, 0.75, 0.75, 0.75, 0.75, 0.75]))
    apart = drag_stamps([Stamp(np.ones((4, 4), np.float32), 2.0)])[0]
    assert_close(apart[:16], np.float32([1, 1, 1, 1, 0, 0, 0, 0] * 2))


def test_a_folder_has_all_of_its_brushes_and_proportions_are_kept(folder):
    for name in ("b.png", "a.gbr", "notes.txt"):
        (folder / name).write_bytes(gbr(DOT) if name == "a.gbr" else b"")
    Image.fromarray((255 * framed(wedge())).astype(np.uint8)).save("b.png")
    marks = read_marks(["."])
    assert [mark.name for mark in marks] == ["a.gbr", "b.png"]
    assert columns_for(marks[1:]) == 256, "strokes are 13 half widths long, and 12 is the nearest length"
    sheet = sheet_of(marks, Brush(files=["."]).eval())
    assert (sheet.reshape(2, -1) < 128).any(1).all(), "each row shows its mark"


@pytest.mark.parametrize("length", [0.5, 0.9])
def test_strokes_have_a_thin_start_and_a_frayed_end_at_any_length(folder, length):
    Image.fromarray((255 * framed(wedge())).astype(np.uint8)).save("stroke.png")
    parameters = torch.tensor([[-length, 0, 0, 0, length, 0, -0.2, 0, 0, 0]])
    alpha = window_pictures(Brush(files=["stroke.png"]).eval(), parameters, 256)[0, 3]
    columns = torch.nonzero(alpha.amax(0) > 0.3).flatten()
    first, last = int(columns[0]), int(columns[-1])
    covered = (alpha > 0.5).sum(0)
    middle = covered[(first + last) // 2]
    assert covered[first + 2] < 0.5 * middle, "thin"
    half = alpha.shape[0] // 2
    upper, lower = alpha[:half, last - 3].sum(), alpha[half:, last - 3].sum()
    assert lower < 0.1 * upper, "its lower hairs end early"


def test_a_painting_with_files_is_the_same_again_and_differs_from_that_of_the_dry_brush(folder):
    (folder / "dot.gbr").write_bytes(gbr(DOT))
    picture = (255 * np.random.default_rng(0).random((24, 32, 3))).astype(np.uint8)
    options = {"strokes": 20, "steps": 2, "frames": 0, "report": False, "threads": 1, "renderer": "brush"}
    one, again = (brushexp.paint(picture, **options, **{"renderer.files": ["dot.gbr"]}).image for _ in range(2))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, brushexp.paint(picture, **options).image)
    assert 0.2 < dry_brush().mean() < 0.8


def test_brush_is_a_word_of_the_command_line(folder):
    Image.fromarray((255 * framed(wedge())).astype(np.uint8)).save("a, b.png")
    words = expand_arguments(["coffee", "renderer=textured", "brush=a, b.png"])
    assert words == ["image=coffee", "renderer=brush", f'renderer.files=["{folder}/a, b.png"]']
    assert expand_arguments(["brush=x.gbr,y.gbr"])[-1] == "renderer.files=[x.gbr,y.gbr]"


@pytest.mark.parametrize(("name", "data", "message"), [
    ("x.abr", b"\0\6", "is damaged: it ends too early; save the set anew from Photoshop"),
    ("x.abr", b"\0\3\0\1", "is no set of brushes of Photoshop that can be read (version 3.1)"),
    ("x.abr", abr_in_sections([])[:-4] + b"\0\0\1\0", "is damaged: it ends too early"),
    ("x.abr", abr_in_sections([], b"8BIX"), "is damaged: a section does not begin where it should"),
    ("x.abr", abr_in_sections([DOT])[:-80], "is damaged: it ends too early"),
    ("x.abr", abr_in_sections([DOT], depth=1), "is damaged: a brush has 1 bits a pixel"),
    ("x.abr", abr_in_sections([DOT[:0]]), "is damaged: a brush has 16 x 0 pixels"),
    ("x.abr", old_abr([DOT], 1, cut=2), "is damaged: a row of a brush has not as many pixels"),
    ("x.abr", old_abr([], 1), "has no brush with a picture; paint a stroke with it"),
    ("x.brushset", b"PK", "is damaged, or no archive of brushes"),
    ("x.brushset", archive({"a/Brush.archive": b"x"}), "names brushes that are built into its program"),
    ("x.bundle", archive({"brushes/a.gbr": b"GIMP"}), "is no brush of GIMP that can be read"),
    ("x.kpp", b"\x89PNG", "a preset of Krita, whose brush is another file"),
    ("x.gbr", gbr(DOT)[:100], "claims 16 x 16 pixels, of which not all are there"),
    ("x.gbr", gbr(DOT[:0]), "claims 16 x 0 pixels"),
    ("x.gbr", struct.pack(">5I", 28, 3, 9, 9, 18) + b"GIMP\0\0\0\0", "no brush of GIMP that can be read"),
    ("x.gih", b"Leaves\n999999 ncells:3\n", "no brush of GIMP that can be read"),
    ("x.gih", b"Leaves\n2 ncells:2\n" + gbr(DOT), "is damaged"),
    ("x.gbr", gbr(0 * DOT), "has no mark on it"),
    ("x.png", b"<html>", "is a web page"),
    (".", b"", "has no brush in it"),
    ("y.png", b"", "is not there; give a picture of a stroke"),
])  # fmt: skip
def test_what_is_no_brush_is_told_with_a_cure(folder, name, data, message):
    if name[0] == "x":
        (folder / name).write_bytes(data)
    with pytest.raises(UserError) as refused:
        BRUSH.check("renderer.files", [name])
    assert message in str(refused.value)
    assert str(refused.value).startswith("renderer.files: brush=")


def test_the_strokes_of_the_sheet_are_valid():
    assert np.abs(STROKES).max() <= 1
