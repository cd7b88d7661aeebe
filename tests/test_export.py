"""Tests of exporters: they all fulfil their contract, and their files show the painting."""

import csv
import io
import json
import logging
import math
import os
import re
import xml.etree.ElementTree as ET
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import catalogues
import numpy as np
import pytest
import torch
from catalogues import CONFIG, assert_same, catalogue, changed, refused
from films import decoded, pixels_of
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf
from PIL import Image, ImageCms
from program import disturb_move, run
from refusals import refuses
from scenes import random_strokes, straight, with_shapes

from brushexp.compositing.profile import smooth_rise
from brushexp.errors import UserError
from brushexp.painting.components import load_strokes
from brushexp.painting.reopen import export_job, renderer_of, with_renderer
from brushexp.plugins.blend.dense import Dense
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.export import svg
from brushexp.plugins.export._prints import bitmap
from brushexp.plugins.export._sprites import draw_sprites
from brushexp.plugins.export.base import Exporter, ExportJob
from brushexp.plugins.export.csv import Csv
from brushexp.plugins.export.json import Json
from brushexp.plugins.export.png import Png
from brushexp.plugins.export.svg import Svg, soft_edge
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.registry import build_named, plugins
from brushexp.results.exports import exported_files as files_beside
from brushexp.results.exports import move_beside
from brushexp.runs.run_folder import clear
from brushexp.shading.light import Light
from brushexp.strokes.bezier import curve_of
from brushexp.strokes.catalogue import FIELDS, Strokes
from brushexp.strokes.saved import json_lines, parse
from brushexp.strokes.storage import Saved, load_catalogue, save_catalogue
from brushexp.system.files import to_bytes, write_text

SIZE = (36, 52)
LEVELS = 3 / 255  # tolerance for faint paint when tiles lie elsewhere
TEXTURED = build_named("renderer", "textured", {}).eval()
EXPORTERS = [plugin.name for plugin in plugins("to")]
resvg = pytest.importorskip("resvg_py", reason="pip install resvg-py: it draws our SVG independently")


def job_of(strokes: Strokes, size: tuple[int, int] = SIZE, *, soft: float = 2.0, taper: float = 0.0) -> ExportJob:
    """Make an export job for strokes in random order on a coloured canvas."""
    depth = torch.randperm(len(strokes), generator=torch.Generator().manual_seed(0))
    canvas = {"background": torch.tensor([0.9, 0.85, 0.7]), "seed": 7, "config": CONFIG}
    renderer, source = Analytic(soft=soft, taper=taper), "run <1> & more.h5"
    return catalogues.job_of(strokes, size, depth=depth, renderer=renderer, source=source, **canvas)


def some(n: int = 9, size: tuple[int, int] = SIZE) -> Strokes:
    return random_strokes(n, size, width=(0.1, 0.3))


def exporter(name: str) -> Exporter:
    try:
        built: Exporter = build_named("to", name, {})
    except UserError as error:
        if "pip install" in str(error):
            pytest.skip(str(error))
        raise
    return built


def written(name: str, what: ExportJob, folder: Path) -> dict[str, bytes]:
    """Export a job, check the exporter's contract, and return the bytes of each file (for a video, of its frames)."""
    folder.mkdir(parents=True)
    paths = exporter(name).write(what, folder)
    assert paths, "the files are told"
    assert all(path.parent == folder for path in paths)
    assert sorted(paths) == sorted(folder.iterdir()), "all of them, and nothing else"
    videos = {path.name: np.array(decoded(path)[0]).tobytes() for path in paths if path.suffix == ".mp4"}
    return {path.name: path.read_bytes() for path in paths} | videos


def drawn(svg: bytes) -> np.ndarray:
    """Draw our SVG with an independent renderer as a picture (H, W, 3)."""
    data = bytes(resvg.svg_to_bytes(svg_string=svg.decode(), skip_system_fonts=True))
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    assert a.shape == b.shape
    return 10 * math.log10(255**2 / max(float(((a.astype(float) - b) ** 2).mean()), 1e-9))


def degenerate() -> Strokes:
    """Make four degenerate strokes: one without length, one without width, one transparent, one off the canvas."""
    strokes = some(4)
    strokes.start[0] = strokes.control[0] = strokes.end[0] = 0.0
    strokes.width[1], strokes.opacity[2] = 0.0, 0.0
    strokes.position[3] = 9e5
    return strokes


EXTREMES = {
    "no strokes": lambda: job_of(some(0)),
    "one stroke": lambda: job_of(some(1)),
    "one pixel": lambda: job_of(some(3, (1, 1)), (1, 1)),
    "a column": lambda: job_of(some(3, (40, 1)), (40, 1)),
    "nothing to see": lambda: job_of(degenerate()),
}


@pytest.mark.parametrize("name", EXPORTERS)
def test_an_exporter_writes_the_same_files_again_leaves_the_work_as_it_was_or_says_that_it_may_not_write(
    name, tmp_path
):
    strokes = some()
    what = job_of(strokes.map(torch.clone))
    depth = what.saved.depth.clone()
    first = written(name, what, tmp_path / "a")
    assert all(first.values()), "no file is empty"
    assert written(name, what, tmp_path / "b") == first
    for field in FIELDS:
        assert torch.equal(getattr(what.strokes, field), getattr(strokes, field))
    assert torch.equal(what.saved.depth, depth)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]
    refuses(r"cannot (write|use)", exporter(name).write, job_of(some(3)), tmp_path / "missing")


@pytest.mark.parametrize("name", EXPORTERS)
def test_an_exporter_that_is_stopped_leaves_the_files_before_and_no_half_one(name, tmp_path, monkeypatch):
    def stop() -> None:
        raise KeyboardInterrupt

    what, exports = job_of(some(4)), exporter(name)
    (tmp_path / "whole").mkdir()
    whole = exports.write(what, tmp_path / "whole")
    for number in range(1, len(whole) + 1):
        folder = tmp_path / str(number)
        folder.mkdir()
        with monkeypatch.context() as patched:
            patched.setattr(os, "replace", os.replace)
            disturb_move("", number, False, stop)
            with pytest.raises(KeyboardInterrupt):
                exports.write(what, folder)
        done = {path.name: path.stat().st_size for path in folder.iterdir()}
        assert len(done) == number - 1
        assert done.items() <= {path.name: path.stat().st_size for path in whole}.items()


@pytest.mark.parametrize("name", EXPORTERS)
@pytest.mark.parametrize("scene", EXTREMES)
def test_an_exporter_writes_an_extreme_painting_or_says_why_not(name, scene, tmp_path):
    why = ""
    try:
        assert written(name, EXTREMES[scene](), tmp_path / "a")
    except UserError as error:
        why = str(error)
    assert "\n" not in why
    assert bool(why) is not bool(list((tmp_path / "a").iterdir())), "nothing is left of what could not be written"


@pytest.mark.parametrize(("taper", "outlines", "least", "shaped"), [
    (0.0, 1, 33, False), (0.0, 2, 38, False), (0.0, 4, 38, False), (0.7, 1, 33, False), (1.0, 2, 36, False),
    (0.0, 1, 31, True), (0.5, 2, 35, True),
])  # fmt: skip
def test_another_renderer_draws_the_svg_like_the_painting(taper, outlines, least, shaped, tmp_path):
    strokes = random_strokes(150, (96, 128), width=(0.1, 0.4), bend=0.3)
    strokes = with_shapes(strokes) if shaped else strokes
    what = job_of(strokes, (96, 128), taper=taper)
    (path,) = Svg(outlines=outlines).write(what, tmp_path)
    assert psnr(drawn(path.read_bytes()), what.picture()) > least


@pytest.mark.parametrize("taper", [0.0, 0.6])
def test_curves_that_fold_and_strokes_without_length_are_drawn(taper, tmp_path):
    shapes = {
        "fold": ([-0.5, 0.0], [1.5, 0.0], [-0.5, 0.02]),
        "sharp": ([-0.8, -0.2], [1.2, 0.0], [-0.8, 0.3]),
        "point": ([0.0, 0.0], [0.0, 0.0], [0.0, 0.0]),
        "control at the start": ([-0.6, 0.3], [-0.6, 0.3], [0.6, -0.3]),
        "control at the end": ([-0.6, 0.3], [0.6, -0.3], [0.6, -0.3]),
    }
    window = (torch.tensor([[26.0, 18.0]]), torch.tensor([30.0]))
    look = (torch.tensor([0.3]), torch.zeros(1, 3), torch.ones(1))
    for name, points in shapes.items():
        stroke = Strokes(*window, *(torch.tensor([point]) for point in points), *look)
        what = replace(job_of(stroke, taper=taper), blend=Dense())
        (path,) = Svg(outlines=2).write(what, tmp_path)
        assert psnr(drawn(path.read_bytes()), what.picture()) > 30, name


@pytest.mark.parametrize("width", [0.05, 0.3, 1.0, 1.9, 2.1, 5.0])
def test_a_thin_stroke_fades_as_it_does_in_the_painting(width, tmp_path):
    what = job_of(straight((8, 6.3), (44, 29.6), width=width, color=(0.0, 0.0, 0.0)))
    bare = to_bytes(what.saved.background[:, None, None])[0, 0].astype(float)
    ours, theirs = what.picture(), drawn(Svg().write(what, tmp_path)[0].read_bytes())
    assert (bare - theirs).sum() == pytest.approx((bare - ours).sum(), rel=0.03, abs=260)


def test_outlines_cover_what_a_soft_stroke_does():
    half = torch.tensor([0.02, 0.4, 0.99, 1.0, 3.0, 20.0], dtype=torch.float64)
    for count in (1, 2, 3, 8):
        middle, offset, alpha = soft_edge(half, torch.full_like(half, 0.7), torch.full_like(half, 2.0), count)
        widths = middle[:, None] + offset
        assert (widths > 0).all()
        assert (widths.diff(dim=1) <= 0).all(), "the widest lies below"
        peak = 1.4 * smooth_rise(half / 2.0)
        torch.testing.assert_close(1 - (1 - alpha).prod(1), peak, msg="as opaque in the middle")
        torch.testing.assert_close((2 * widths * peak[:, None] / count).sum(1), 1.4 * half, msg="as much paint across")


def test_the_svg_has_a_path_for_each_stroke_that_can_be_seen_bottom_first_and_tells_of_textures(tmp_path):
    what = job_of(degenerate())
    (path,) = Svg(digits=3).write(what, tmp_path)
    name = "{http://www.w3.org/2000/svg}"
    root = ET.fromstring(path.read_text())
    assert {key: root.get(key) for key in ("width", "height", "viewBox")} == {
        "width": "52px", "height": "36px", "viewBox": "0 0 52 36"
    }  # fmt: skip
    assert root.find(f"{name}title").text == "4 brush strokes"
    assert "run <1> & more.h5" in root.find(f"{name}desc").text
    canvas, *paths = root.find(f"{name}g")
    assert canvas.get("fill") == "#e6d9b3"
    visible = [i for i in what.bottom_up.tolist() if i in (0, 3)]
    colors = ["#" + bytes(int(c * 255 + 0.5) for c in what.strokes.color[i].tolist()).hex() for i in visible]
    assert [path.get("stroke") for path in paths] == colors
    dot = paths[visible.index(0)]
    x, y = curve_of(what.strokes)[0, 0].tolist()
    assert dot.get("d") == f"M{x:.3f}".rstrip("0") + f" {y:.3f}".rstrip("0") + "h.001"
    assert float(dot.get("stroke-width")) == pytest.approx(
        float(what.strokes.width[0] * what.strokes.scale[0]), abs=1e-3
    )
    assert float(dot.get("stroke-opacity")) == pytest.approx(float(what.strokes.opacity[0]), abs=1e-3)
    sizes = [Svg(digits=digits).write(what, tmp_path)[0].stat().st_size for digits in (0, 2, 6)]
    assert sizes == sorted(sizes)
    textured = changed(replace(job_of(some(4)), renderer=TEXTURED), renderer="textured")
    (path,) = Svg(paths=True).write(textured, tmp_path)
    assert "The renderer textured gives them a texture, which paths cannot hold." in path.read_text()
    assert path.read_text().count("<path") == 4 + 2


ATTRIBUTES_1_1 = {  # the attributes of SVG 1.1 that we use, and of CSS 2 in style
    "svg": {"version", "width", "height", "viewBox", "style"},
    "clipPath": {"id"},
    "mask": {"id", "maskUnits", "x", "y", "width", "height"},
    "g": {"clip-path", "mask", "fill", "stroke-linecap", "stroke-linejoin"},
    "path": {"d", "fill", "fill-opacity", "stroke", "stroke-width", "stroke-opacity"},
    "image": {"id", "x", "y", "width", "height", "preserveAspectRatio", "{http://www.w3.org/1999/xlink}href"},
}


@pytest.mark.parametrize("options", [{}, {"paths": True}])
@pytest.mark.parametrize("renderer", [TEXTURED, Analytic(), Analytic(taper=0.6)])
def test_the_svg_has_only_what_readers_of_svg_1_1_know_and_no_style_takes_its_size_away(renderer, options, tmp_path):
    what = changed(job_of(some(3)), alpha=torch.full((3, 4), 128, dtype=torch.uint8))
    what = replace(what, renderer=renderer, light=Light(depth=1.0))
    root = ET.fromstring(Svg(**options).write(what, tmp_path)[0].read_text())
    tags = [(element.tag.rpartition("}")[2], set(element.attrib)) for element in root.iter()]
    assert {tag: used for tag, used in tags if used - ATTRIBUTES_1_1.get(tag, set())} == {}
    assert {entry.partition(":")[0] for entry in root.get("style").split(";")} == {"max-width", "max-height"}


INK_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"


@pytest.mark.parametrize("renderer", [TEXTURED, Analytic()])
def test_groups_of_layers_and_colours_have_every_stroke_once_and_layers_keep_the_picture(renderer, tmp_path):
    what = replace(job_of(some(40)), renderer=renderer)
    plain = Svg().write(what, tmp_path)[0].read_bytes()
    layered = Svg(layers=4).write(what, tmp_path)[0].read_bytes()
    np.testing.assert_array_equal(drawn(layered), drawn(plain))
    text = Svg(layers=4, colors=3).write(what, tmp_path)[0].read_bytes()
    name = "{http://www.w3.org/2000/svg}"
    root = ET.fromstring(text).find(f"{name}g")
    groups = root.findall(f"{name}g")
    assert [group.get("id") for group in groups] == [f"layer-{k}" for k in (1, 2, 3, 4)]
    shapes = [sum(len(part) for part in group) for group in groups]
    ungrouped = len(ET.fromstring(plain).find(f"{name}g")) - 1
    assert sum(shapes) == ungrouped
    for group in groups:
        labels = [part.get(INK_LABEL) for part in group]
        light = [
            int(label[1:3], 16) * 0.299 + int(label[3:5], 16) * 0.587 + int(label[5:], 16) * 0.114 for label in labels
        ]
        assert light == sorted(light), "from dark to light"
    assert len({part.get(INK_LABEL) for group in groups for part in group}) == 3


def test_millimetres_change_the_units_of_an_svg_and_not_its_picture(tmp_path):
    what = job_of(some(20))
    pixels = Svg().write(what, tmp_path)[0].read_bytes()
    root = ET.fromstring(text := Svg(width_mm=520).write(what, tmp_path)[0].read_bytes())
    assert (root.get("width"), root.get("height"), root.get("viewBox")) == ("520mm", "360mm", "0 0 520 360")
    smaller = text.replace(b'width="520mm" height="360mm"', b'width="52px" height="36px"')
    assert psnr(drawn(smaller), drawn(pixels)) > 40


def test_the_size_of_bitmaps_and_of_a_page_is_told_before_they_are_written(tmp_path, caplog):
    caplog.set_level("INFO")
    what = replace(job_of(some(200, (720, 1040)), (720, 1040)), renderer=TEXTURED)
    told = []

    def tell(path, lines):
        told.extend(caplog.messages)
        write_text(path, lines)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("brushexp.plugins.export.svg.write_text", tell)
        (path,) = Svg().write(what, tmp_path)
    sprites = draw_sprites(what)
    megabytes, count = svg.megabytes_of(sprites), len(sprites.number)
    assert path.stat().st_size / 1e6 == pytest.approx(megabytes, rel=0.2)
    assert told == [f"strokes.svg: about {megabytes:.1f} MB of {count} bitmaps; to.svg.paths=true writes paths"]
    build_named("to", "pdf", {}).write(job_of(some()), tmp_path)
    assert "painting.pdf: 0.4 x 0.3 cm at 300 dpi; to.pdf.size_cm=60x40 paints it larger" in caplog.messages
    build_named("to", "pdf", {"size_cm": "6x2.5", "dpi": 80}).write(job_of(some()), tmp_path)
    assert "painting.pdf: 3.6 x 2.5 cm at 80 dpi" in caplog.messages


@pytest.mark.parametrize("source", ["a\x00b\x1b\ud800.h5", "<script>alert(1)</script>", "--> ]]> &amp; \"'", "ö 画"])
def test_no_name_of_a_file_breaks_the_svg(source, tmp_path):
    (path,) = Svg().write(replace(job_of(some(2)), source=source), tmp_path)
    root = ET.fromstring(path.read_text(encoding="utf-8"))
    legible = re.sub("[\x00-\x1f\ud800]", "?", source)
    assert f"from {legible};" in root.find("{http://www.w3.org/2000/svg}desc").text
    tags = {element.tag.rpartition("}")[2] for element in root.iter()}
    assert tags == {"svg", "title", "desc", "clipPath", "g", "path"}


@pytest.mark.parametrize(("zoom", "least"), [(1, 45), (3, 30)])
def test_textured_strokes_in_the_light_are_in_the_svg_as_they_are(zoom, least, tmp_path, monkeypatch):
    monkeypatch.setattr("brushexp.plugins.export._sprites.MOST_PIXELS", 1e5)  # too few for strokes three times as large
    strokes = random_strokes(150, (96, 128), width=(0.1, 0.4), bend=0.3).moved(zoom=zoom)
    what = replace(job_of(strokes, (96 * zoom, 128 * zoom)), renderer=TEXTURED, light=Light(depth=1.0))
    (path,) = Svg().write(what, tmp_path)
    assert psnr(drawn(path.read_bytes()), what.picture()) > least
    numbers = re.findall('id="stroke-([0-9]+)"', path.read_text())
    order = [number for number in what.bottom_up.tolist() if str(number) in numbers]
    assert numbers == [str(number) for number in order]
    assert len(numbers) > 70
    (path,) = Svg(paths=True).write(what, tmp_path)
    assert "<image" not in path.read_text()


def test_strokes_that_are_longer_than_the_sheet_of_sprites_are_drawn_whole(monkeypatch):
    monkeypatch.setattr("brushexp.plugins.export._sprites.SHEET_WIDTH", 100)
    strokes = random_strokes(3, (96, 128), width=(0.02, 0.03), bend=0.1).moved(zoom=30)
    what = replace(job_of(strokes, (2880, 3840)), renderer=TEXTURED)
    sprites = draw_sprites(what)
    assert (sprites.boxes[:, 2:] <= 100).all()
    layers = what.renderer(strokes)
    extent = (layers.curve.amax(1) - layers.curve.amin(1)).numpy()[sprites.number]
    assert extent.max() > 100
    assert (sprites.boxes[:, 2:] >= sprites.zoom * extent).all()


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (9, 5), (5, 9)])
def test_a_small_bitmap_is_read_as_it_was(size):
    pixels = np.random.default_rng(0).integers(0, 256, (9, 9, 4), np.uint8)[: size[0], : size[1]]
    with Image.open(io.BytesIO(bitmap(pixels))) as image:
        np.testing.assert_array_equal(np.asarray(image), pixels)
        assert image.mode == "RGBA"


def test_sprites_are_the_strokes_alone_without_colour_where_there_is_no_paint():
    strokes = random_strokes(12, SIZE, width=(0.1, 0.4), bend=0.3)
    what = replace(job_of(strokes), renderer=TEXTURED, light=Light(depth=1.0))
    for number, (left, top), sprite in draw_sprites(what).bitmaps():
        moved, size = strokes[[number]].moved(shift=(-left, -top)), sprite.shape[:2]
        black, white = (
            Tiled()(TEXTURED(moved), torch.tensor([0]), size, torch.full((3,), shade)).image for shade in (0.0, 1.0)
        )
        alpha = 1 - (white - black).mean(0)
        np.testing.assert_allclose(sprite[..., 3] / 255, alpha.detach(), atol=LEVELS)
        assert not sprite[sprite[..., 3] == 0].any()
        visible = sprite[..., 3] > 30
        color = (black / alpha.clamp_min(1e-6)).permute(1, 2, 0).detach().numpy().clip(0, 1)
        np.testing.assert_allclose(sprite[visible][:, :3] / 255, color[visible], atol=LEVELS)


def test_pictures_that_are_painted_already_make_the_same_svg(tmp_path):
    job = replace(job_of(some()), light=Light(depth=1.0))
    flat = replace(job, light=Light()).picture()
    (path,) = Svg().write(job, tmp_path)
    text = path.read_bytes()
    Svg().write(job, tmp_path, (flat, job.picture()))
    assert path.read_bytes() == text
    Svg().write(job, tmp_path, (flat, flat))
    assert path.read_bytes() != text
    assert job.at_most(26).size == (18, 26)


@pytest.mark.parametrize("name", ["png", "pdf"])
def test_a_print_has_its_size_on_paper_and_the_same_pixels(name, tmp_path, caplog):
    options = {"size_cm": "6x2.5", "dpi": 80}
    with caplog.at_level(logging.INFO):
        (path,) = build_named("to", name, options).write(job_of(some()), tmp_path)
    assert ("3.6 x 2.5 cm at 80 dpi" in caplog.text) == (name == "pdf")
    large = job_of(some()).scaled(114 / 52)
    assert large.size == (79, 114)
    data = path.read_bytes()
    if name == "png":
        with Image.open(path) as image:
            assert image.info["dpi"] == pytest.approx((80, 80), abs=0.02)
            read = np.asarray(image)
    else:
        assert b"/MediaBox [0 0 102.6000 71.1000]" in data
        for number, place in enumerate(re.findall(rb"(\d{10}) 00000 n", data), start=1):
            assert data[int(place) :].startswith(b"%d 0 obj" % number)
        assert data[int(re.search(rb"startxref\n(\d+)", data)[1]) :].startswith(b"xref")
        begin, length = data.index(b"stream\n", data.index(b"5 0 obj")) + 7, int(re.search(rb"6 0 obj\n(\d+)", data)[1])
        rows = np.frombuffer(zlib.decompress(data[begin : begin + length]), np.uint8).reshape(79, 1 + 3 * 114)
        assert (rows[:, 0] == 2).all()
        read = np.cumsum(rows[:, 1:], axis=0, dtype=np.uint8).reshape(79, 114, 3)
    np.testing.assert_array_equal(read, large.picture())


def read_png(job, folder, **options):
    (path,) = build_named("to", "png", options).write(job, folder)
    with Image.open(path) as image:
        return np.asarray(image)


def test_a_sheet_has_bleed_beyond_its_edges_or_a_margin_within_or_is_filled(tmp_path, caplog):
    job = job_of(some())  # 36 x 52 pixels
    plain = read_png(job, tmp_path, size_cm="6x2.5", dpi=80.0)
    bled = read_png(job, tmp_path, size_cm="6x2.5", dpi=80.0, bleed=3.0)  # 9 pixels
    np.testing.assert_array_equal(bled, np.pad(plain, ((9, 9), (9, 9), (0, 0)), mode="symmetric"))
    framed = read_png(job, tmp_path, size_cm="6x2.5", dpi=80.0, margin=3.0, bleed=1.0)  # 9 and 3 pixels
    assert framed.shape == (79 + 6, round(61 * 52 / 36) + 24, 3)
    assert (framed[:12] == 255).all()
    assert (framed[:, -12:] == 255).all()
    np.testing.assert_array_equal(framed[12:-12, 12:-12], job.scaled(61 / 36).picture())
    filled = read_png(job, tmp_path, size_cm="2.5x2.5", dpi=80.0, fill=True)
    np.testing.assert_array_equal(filled, job.scaled(79 / 36).picture()[:, 17:-18])
    with caplog.at_level(logging.INFO):
        (path,) = build_named("to", "pdf", {"size_cm": "6x2.5", "dpi": 80.0, "bleed": 3.0}).write(job, tmp_path)
    assert "3.6 x 2.5 cm at 80 dpi, plus 3 mm of bleed" in caplog.text
    assert b"/MediaBox [0 0 118.8000 87.3000]" in path.read_bytes()
    assert b"/TrimBox [8.1000 8.1000 110.7000 79.2000]" in path.read_bytes()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"fill": True}, r"fill=true needs a paper size; add to\.png\.size_cm=60x40"),
        (
            {"size_cm": "4x3", "margin": 15.0},
            r"margin=15 leaves no room on to\.png\.size_cm=4x3; try to\.png\.margin=10",
        ),
        ({"bleed": 50.0}, r"bleed=50 is larger than the picture; try to\.png\.bleed=3"),
        ({"size_cm": "1x500", "fill": True}, r"size_cm=1x500 paints 85302 pixels a side, not 1 to 65536"),
    ],
)
def test_sheets_that_cannot_be_are_refused(options, words, tmp_path):
    refuses(words, lambda: build_named("to", "png", options).write(job_of(some()), tmp_path))


def test_a_jpeg_is_near_the_painting_and_says_what_its_colours_are(tmp_path):
    large = job_of(some()).scaled(114 / 52)
    sizes = []
    for quality, least in ((95, 40), (30, 25)):
        (path,) = build_named("to", "jpg", {"size_cm": "6x2.5", "dpi": 80, "quality": quality}).write(
            job_of(some()), tmp_path
        )
        with Image.open(path) as image:
            assert (image.format, image.info["dpi"]) == ("JPEG", (80, 80))
            profile = ImageCms.ImageCmsProfile(io.BytesIO(image.info["icc_profile"]))
            assert "sRGB" in ImageCms.getProfileDescription(profile)
            assert psnr(np.asarray(image), large.picture()) > least
        sizes.append(path.stat().st_size)
    assert sizes[1] < 0.7 * sizes[0]
    with pytest.raises(UserError, match=r"to=jpg holds 65500 pixels per side, .* has 65536; .* or to=png"):
        build_named("to", "jpg", {}).write(job_of(some(1)).scaled(65536 / 52), tmp_path)


@pytest.mark.parametrize("options", [{"size_cm": "60"}, {"size_cm": "600x400", "dpi": 9000}, {"size_cm": "0x0"}])
def test_a_size_on_paper_that_cannot_be_is_refused(options, tmp_path):
    with pytest.raises(UserError, match=r"to\.png\.size_cm=.*try to\.png\."):
        build_named("to", "png", options).write(job_of(some(2)), tmp_path)


def test_the_weave_of_the_canvas_is_the_same_in_bands_and_keeps_the_colours(tmp_path, monkeypatch):
    pictures = []
    for width in (2**20, 60):
        monkeypatch.setattr("brushexp.compositing.bands.BAND", width * 7)
        (path,) = Png(weave=0.5).write(job_of(some()), tmp_path)
        pictures.append(np.asarray(Image.open(path)).astype(int))
    assert np.abs(pictures[0] - pictures[1]).max() <= 1
    away = pictures[0] - job_of(some()).picture().astype(int)
    assert np.abs(away).max() > 8
    assert np.abs(away.mean()) < 3


def exported(what: Saved, folder: Path) -> Path:
    (path,) = Json().write(export_job(what), folder)
    return path


@pytest.mark.parametrize("n", [0, 1, 7, 3000])
def test_a_catalogue_comes_back_from_json_as_it_was(n, tmp_path):
    assert_same(load_catalogue(exported(catalogue(n), tmp_path)), catalogue(n))


@given(st.lists(st.floats(width=32, allow_nan=False, allow_infinity=False), min_size=6, max_size=6))
def test_every_number_comes_back_to_the_last_bit(numbers):
    saved = catalogue(1)
    what = saved.strokes
    what.start[0], what.control[0], what.end[0] = torch.tensor(numbers).split(2)
    read = parse("".join(json_lines(saved))).strokes
    for name in FIELDS:
        assert getattr(read, name).numpy().tobytes() == getattr(what, name).numpy().tobytes()


def edited(folder: Path) -> tuple[Path, dict[str, Any]]:
    """Export a catalogue as JSON, and return the file's path and its parsed contents."""
    path = exported(catalogue(), folder)
    return path, json.loads(path.read_text(encoding="utf-8"))


def test_edited_strokes_are_painted(tmp_path):
    path, data = edited(tmp_path)
    assert list(data)[:4] == ["format", "format_version", "height", "width"]
    assert set(data["units"]) == set(data["strokes"][0]) == {*FIELDS, "brush", "depth"}
    assert sum('"position": [' in line for line in path.read_text().splitlines()) == 7, "each on a line of its own"
    order = np.argsort([stroke.pop("depth") for stroke in data["strokes"]])
    data["strokes"] = [data["strokes"][i] for i in order][1:]
    data["strokes"][0]["color"] = [1, 0, 0.5]
    path.write_text("\ufeff" + json.dumps(data, indent=1), encoding="utf-8")  # some editors write it so
    read = load_catalogue(path)
    assert read.depth.tolist() == list(range(6)), "without depth, the first is at the bottom"
    assert read.strokes.color[0].tolist() == [1, 0, 0.5]
    assert export_job(read, resolution=100).picture().shape == (60, 100, 3)
    assert len(load_strokes(path, (60, 100))) == 6, "and task=paint goes on from them"
    path, data = edited(tmp_path)
    bottom = min(range(7), key=lambda k: data["strokes"][k]["depth"])
    del data["strokes"][bottom]
    path.write_text(json.dumps(data))
    others, read = torch.tensor([k for k in range(7) if k != bottom]), load_catalogue(path)
    assert torch.equal(read.strokes.position, catalogue().strokes.position[others])
    assert torch.equal(read.depth, catalogue().depth[others] - 1), "the others keep their order"
    assert torch.equal(read.strokes.brush, others), "and their brushes"


@pytest.mark.parametrize(("change", "message"), [
    (lambda d: d.update(format="x"), "not a brushexp catalogue"),
    (lambda d: d.update(format_version=5), "has format_version 5, and this brushexp reads 4; update brushexp"),
    (lambda d: d.update(format_version=True), "format_version is True; a whole number is needed"),
    (lambda d: d.update(width=3.5), "width is 3.5; a whole number is needed"),
    (lambda d: d.update(background=[0.1, 0.2]), r"background is \[0.1, 0.2\]; a list of 3 numbers is needed"),
    (lambda d: d.update(renderer=None), "renderer is None; text is needed"),
    (lambda d: d.update(config=[1]), r"config is \[1\]; a list of the lines"),
    (lambda d: d.pop("config"), "config is None; a list is needed"),
    (lambda d: d["strokes"].append(3), "stroke 7 is 3; {...} with its fields is needed"),
    (lambda d: d["strokes"][2].pop("depth"), "stroke 2: depth is None; a whole number is needed"),
    (lambda d: d["strokes"][2].update(colour=[]), "stroke 2 has a field 'colour'; valid: position"),
    (lambda d: d["strokes"][2].update(brush=1.5), "stroke 2: brush is 1.5; a whole number is needed"),
    (lambda d: d["strokes"][2].update(brush=10**400), "brush is not a whole number"),
    (lambda d: d["strokes"][2].update(width=True), "stroke 2: width is True; a number is needed"),
    (lambda d: d["strokes"][2].update(start=[1]), r"stroke 2: start is \[1\]; a list of 2 numbers is needed"),
    (lambda d: d["strokes"][2].update(opacity=1.5), r"stroke 2: opacity is 1.5; it must lie in \[0, 1\]"),
    (lambda d: d["strokes"][2].update(scale=1e300), "stroke 2: scale is inf; it must lie in"),
    (lambda d: d["strokes"][2].update(scale=10**400), "is damaged or cut short; save it again"),
    (lambda d: d["strokes"][2].update(scale=math.nan), "stroke 2: scale is nan; it must lie in"),
    (lambda d: d["strokes"][2].update(depth=d["strokes"][5]["depth"]), "2 strokes have depth"),
])  # fmt: skip
def test_a_wrong_value_is_explained(change, message, tmp_path):
    path, data = edited(tmp_path)
    change(data)
    path.write_text(json.dumps(data))
    assert re.search(message, refused(path))


def test_strokes_that_could_not_be_read_back_are_not_written(tmp_path):
    small = replace(catalogue(), strokes=replace(catalogue().strokes, scale=torch.full((7,), 0.01)))
    job = export_job(small, resolution=1)
    refuses(r"to=json .*scale is .*; choose another resolution", Json().write, job, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("config", [
    "renderer: analytic", "renderer: null", "renderer: [1]", "renderer: {soft: 1, soft: 2}", "a: !!int x",
    "renderer: {taper: '${nope}'}", "renderer: {taper: '${'}", "a: !!python/name:os.system x", "? [a, b]\n: c",
])  # fmt: skip
def test_settings_that_someone_spoilt_are_explained(config, tmp_path):
    save_catalogue(tmp_path / "a.h5", replace(catalogue(), config=config))
    refuses("config of the catalogue", renderer_of, load_catalogue(tmp_path / "a.h5"))


@pytest.mark.parametrize(("text", "message"), [
    ("", r"not JSON \(line 1, column 1"),
    ('{"format": "brushexp catalogue",\n}', r"not JSON \(line 2, column 1"),
    ("[1, 2]", "not a brushexp catalogue"),
    ("[" * 100_000, "too many nested brackets"),
    ("\x89HDF\r\n\x1a\n\xff\xfe", "not text in UTF-8"),
])  # fmt: skip
def test_a_wrong_text_is_explained(text, message, tmp_path):
    (tmp_path / "a.JSON").write_bytes(text.encode("latin-1"))
    assert re.search(message, refused(tmp_path / "a.JSON"))


def test_the_table_has_the_strokes_in_pixels_bottom_first(tmp_path):
    strokes = Strokes.join(
        straight((10, 20), (30, 20), width=4), straight((5, 30), (5, 10), width=1, color=(0, 0.5, 1), opacity=0.25)
    )
    strokes = replace(strokes, drift=torch.tensor([[0.0, 0.0, 0.0], [-0.3, 0.25, 0.1]]))  # 0 and 1 allow no drift
    what = changed(job_of(strokes), depth=torch.tensor([1, 0]).int())
    (path,) = Csv().write(what, tmp_path)
    first, second = csv.DictReader(path.read_text().splitlines())
    numbers = {key: float(value) for key, value in first.items()}
    assert numbers == pytest.approx(
        {
            "stroke": 1, "start_x_px": 5, "start_y_px": 30, "control_x_px": 5, "control_y_px": 20, "end_x_px": 5,
            "end_y_px": 10, "width_px": 1, "red": 0, "green": 0.5, "blue": 1, "opacity": 0.25, "softness_px": 0,
            "widening": 0, "red_drift": 0, "green_drift": 0.25, "blue_drift": 0, "length_px": 20, "direction_deg": -90,
        }
    )  # fmt: skip
    assert (second["stroke"], second["direction_deg"], second["length_px"]) == ("0", "0", "20")
    (path,) = Csv().write(job_of(degenerate()), tmp_path)
    (point,) = [row for row in csv.DictReader(path.read_text().splitlines()) if row["stroke"] == "0"]
    assert (point["direction_deg"], float(point["length_px"])) == ("", pytest.approx(0, abs=1e-6)), "of a point"


@pytest.mark.parametrize("compression", [1, 9])
def test_the_png_has_the_pixels_of_the_painting(compression, tmp_path, monkeypatch):
    what = job_of(some(40))
    expected = what.picture()
    monkeypatch.setattr("brushexp.compositing.bands.BAND", 52 * 7)
    monkeypatch.setattr("brushexp.plugins.export.base.LARGE", 1)  # as for large pictures, with a progress bar
    (path,) = Png(compression=compression).write(what, tmp_path)
    assert np.array_equal(pixels_of(path), expected)


def test_other_weights_are_told_and_a_chosen_renderer_becomes_that_of_the_catalogue(tmp_path, caplog):
    with_renderer(replace(catalogue(), renderer_hash="0123"), None, "a.h5")
    assert "painted with other weights of renderer=analytic" in caplog.text
    chosen = OmegaConf.create({"_target_": "brushexp.plugins.renderer.analytic.Analytic", "soft": 5.0, "taper": 0.5})
    saved, renderer = with_renderer(catalogue(), chosen, "a.h5")
    assert (renderer.soft, renderer.taper) == (5.0, 0.5)
    (path,) = Json().write(export_job(saved, renderer), tmp_path)
    again = renderer_of(load_catalogue(path))
    assert (again.soft, again.taper) == (5.0, 0.5)
    assert OmegaConf.create(saved.config).image == "größe.png"


def test_the_program_writes_all_of_them_at_once(tmp_path):
    path = exported(catalogue(), tmp_path)
    typed = ["task=export", f"catalogue={path}", "to=svg,json,csv,png", "threads=1", f"output={tmp_path}/out"]
    result = run(*typed, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert_same(load_catalogue(tmp_path / "out" / "strokes.json"), catalogue())
    for name in ("strokes.svg", "strokes.json", "strokes.csv", "painting.png"):
        assert re.search(rf"{name}: [\d.e-]+ MB \([\d.]+ s\)", result.stdout), "each with its size and time"
    svg, png = (tmp_path / "out" / name for name in ("strokes.svg", "painting.png"))
    assert psnr(drawn(svg.read_bytes()), pixels_of(png)) > 30


def a_run(folder: Path) -> Path:
    """Make the folder of a finished run, with a note that its owner added."""
    folder.mkdir()
    save_catalogue(folder / "catalogue.h5", job_of(some()).saved)
    for name in ("painting.png", "notes.txt"):
        (folder / name).write_text("mine")
    (folder / "metrics.json").write_text('{"status": "completed"}')
    (folder / ".hydra").mkdir()
    (folder / ".hydra" / "files.txt").write_text("catalogue.h5\npainting.png\nmetrics.json\n")
    return folder


@pytest.mark.parametrize("typed", ["my run", "my run/catalogue.h5"])
def test_an_export_lands_beside_its_painting_and_replaces_only_an_export_and_only_on_request(tmp_path, typed):
    folder = a_run(tmp_path / "my run")
    before = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    words = ("task=export", typed, "to=json,png", "threads=1")
    done = run(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"{folder / 'painting_export.png'}:" in done.stdout or "my run/painting_export.png:" in done.stdout
    (folder / "strokes.json").write_text("of an older painting")
    refused = run(*words, cwd=tmp_path)
    assert refused.returncode == 1
    assert "exists already; replace it with overwrite=true, or choose another folder: output=" in refused.stderr
    assert (folder / "strokes.json").read_text() == "of an older painting"
    assert len(list((folder / "exports").iterdir())) == 1, "refused before a folder is made"
    assert run(*words, "overwrite=true", cwd=tmp_path).returncode == 0
    assert (folder / "strokes.json").read_text() != "of an older painting"
    assert {path: path.read_bytes() for path in before} == before
    assert [path.name for path in tmp_path.iterdir()] == ["my run"]

    clear(folder, OmegaConf.create({"task": "paint"}))  # as overwrite=true does for the run
    assert [path.name for path in folder.rglob("*") if path.is_file() and path.parent.name != ".hydra"] == ["notes.txt"]


def test_names_that_the_run_and_an_export_have_taken_lose_no_file(tmp_path):
    folder = a_run(tmp_path / "x")
    (folder / "painting_export.png").write_text("mine")
    record = folder / "exports" / "now"
    record.mkdir(parents=True)
    (record / "painting.png").write_text("new")
    assert move_beside([record / "painting.png"], folder) == [record / "painting.png"]
    assert (record / "painting.png").read_text() == "new"
    for name in ("painting.png", "painting_export.png"):
        assert (folder / name).read_text() == "mine"
    (record / "metrics.json").write_text('{"files": {"png": ["../x/painting_export.png", "gone.png"], "odd": null}}')
    assert files_beside(folder) == {}, "a damaged record is skipped"
    (record / "metrics.json").write_text('{"files": {"png": ["../x/painting_export.png", "gone.png"]}}')
    assert files_beside(folder) == {folder / "painting_export.png": "png"}
    assert move_beside([record / "painting.png"], folder) == [folder / "painting_export.png"]


def test_exports_of_a_catalogue_alone_or_in_a_sweep_land_in_outputs(tmp_path):
    save_catalogue(tmp_path / "catalogue.h5", job_of(some()).saved)
    assert run("task=export", "catalogue.h5", "to=json", "threads=1", cwd=tmp_path).returncode == 0
    assert len(list(tmp_path.glob("outputs/*/strokes.json"))) == 1
    (tmp_path / "metrics.json").write_text('{"status": "completed"}')
    done = run("-m", "task=export", "catalogue.h5", "to=json", "resolution=20,30", "threads=1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(list(tmp_path.glob("outputs/*/*/strokes.json"))) == 2
    assert not (tmp_path / "exports").exists()
