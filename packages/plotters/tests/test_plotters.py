"""Stroke plans: what a machine reads is the painting, in an order that saves its time, and in its own words."""

import logging
import re
import sys
from dataclasses import replace
from itertools import groupby

import catalogues
import numpy as np
import pytest
import torch
from brushexp_plotters._brush_plan import RINSE, STIR, WIPE, brush_plan
from brushexp_plotters._pen_plan import JOINED_PENS, pen_plan
from brushexp_plotters._pens import PenPlan
from brushexp_plotters.gcode import Gcode
from brushexp_plotters.hpgl import Hpgl
from refusals import refuses
from scenes import random_strokes, straight

from brushexp.errors import UserError
from brushexp.plugins.export.base import ExportJob
from brushexp.registry import build_named
from brushexp.strokes.bezier import curve_of, half_width_of, strokes_along
from brushexp.strokes.catalogue import Strokes

vpype = pytest.importorskip("vpype", reason="needs pip install 'brushexp[plot]'")

MM = vpype.UNITS["mm"]
GRID = 0.025 / 2 * 2**0.5  # mm by which HPGL rounds at most


SIZE = (60, 90)  # not square: on A4 across with margins of 10 mm, 277 / 90 mm per pixel


def job_of(strokes: Strokes, depth=None, size=SIZE) -> ExportJob:
    return catalogues.job_of(strokes, size, depth=depth, background=torch.ones(3), source="a/catalogue.h5")


def inside(n: int, seed: int = 0) -> Strokes:
    """Strokes that lie wholly on the canvas, opaque, in different colours."""
    strokes = random_strokes(n, SIZE, seed=seed, bend=0.1)
    place = torch.rand(n, 2, generator=torch.Generator().manual_seed(seed)) * 0.3 + 0.35
    return replace(strokes, position=place * torch.tensor([90.0, 60.0]), opacity=torch.ones(n))


def plan_by(job: ExportJob, **options) -> PenPlan:
    return pen_plan(job, Gcode(**options))


def read_gcode(text: str) -> list[tuple[int, np.ndarray]]:
    """Tool and points of every line that is drawn; refuses what no machine should be told."""
    lines, down, place = [], False, 0j
    tool = 0 if "M6" in text else 1  # which a plan of one pen begins with
    blocks = [row for row in text.splitlines() if not row.startswith(";")]
    assert (blocks[:2], blocks[-1]) == (["G21", "G90"], "M2")
    for block in blocks:
        if block.startswith("M6 T"):
            assert not down, "tools are changed with the pen up"
            tool = int(block[4:])
        elif block == "G0 Z5":
            down = False
        elif block == "G1 Z0 F600":
            assert tool, "nothing is drawn without a tool"
            down = True
            lines.append((tool, [place]))
        elif move := re.fullmatch(r"(G[01]) X(\S+) Y(\S+)", block):
            assert down == (move[1] == "G1"), "quick moves with the pen up, slow ones with the pen down"
            place = complex(float(move[2]), float(move[3]))
            if down:
                lines[-1][1].append(place)
        elif block == "G0 X0 Y0":
            assert not down
        else:
            assert block in ("G21", "G90", "G1 F1500", "M2")
    return [(tool, np.array(points)) for tool, points in lines]


def read_hpgl(text: str) -> list[tuple[int, np.ndarray]]:
    """Pen and points in mm of every line that is drawn."""
    lines, pen, relative, place = [], 0, False, 0j
    for command in text.strip().rstrip(";").split(";"):
        name, numbers = command[:2], np.array([float(x) for x in command[2:].split(",") if x])
        points = numbers[::2] + 1j * numbers[1::2] if name in ("PU", "PD") else numbers
        points = place + points.cumsum() if relative else points
        if name == "SP":
            pen = int(command[2:])
        elif name in ("PR", "PA"):
            relative = name == "PR"
        elif name == "PD":
            assert pen, "nothing is drawn without a pen"
            lines.append((pen, np.concatenate([[place], points]) / 40))
        else:
            assert name in ("IN", "DF", "PU", "PS", "VS")
        if name in ("PU", "PD") and len(points):
            place = points[-1]
    return lines


READERS = {Gcode: read_gcode, Hpgl: read_hpgl}


def curves_on_paper(strokes: Strokes, exporter: Gcode | Hpgl, size=SIZE) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 200) of the curves in mm from the lower left corner, y up, and half widths (N,)."""
    paper, corner, scale = exporter.frame(size)
    t = np.linspace(0, 1, 200)
    weights = np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2])
    x, y = np.moveaxis(curve_of(strokes.map(torch.Tensor.double)).numpy(), 2, 0) @ weights
    half = half_width_of(strokes).double().numpy() * scale
    return corner[0] + scale * x + 1j * (paper[1] - corner[1] - scale * y), half


BOTH = pytest.mark.parametrize("kind", [Gcode, Hpgl])


def drawn_by(kind, job: ExportJob, folder, **options) -> tuple[list[tuple[int, np.ndarray]], Gcode | Hpgl]:
    exporter = kind(**options)
    return READERS[kind](exporter.write(job, folder)[0].read_text()), exporter


def away(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Distance of points (P,) from a polyline (M,)."""
    start, leg = line[:-1], np.diff(line)
    along = np.real(np.conj(leg) * (points[:, None] - start)) / np.maximum(np.abs(leg) ** 2, 1e-30)
    return np.abs(points[:, None] - start - np.clip(along, 0, 1) * leg).min(1)


def test_the_picture_of_the_plan_is_the_plan_and_shows_where_the_paint_of_a_stroke_beside_it_reaches_in(tmp_path):
    lines, exporter = drawn_by(Gcode, job_of(straight((12, -5), (52, -5), width=30)), tmp_path, pen_mm=2)
    paper, corner, scale = exporter.frame(SIZE)
    depth = max((paper[1] - corner[1] - line.imag).max() / scale for _, line in lines)
    assert 5 < depth < 10 + 1e-6
    exporter, job = Gcode(layers=2), job_of(random_strokes(25, SIZE))
    _, picture = exporter.write(job, tmp_path)
    plan = pen_plan(job, exporter)
    read, width, height = vpype.read_svg(str(picture), 0.1)
    assert read.length() / MM == pytest.approx(plan.drawn, rel=0.001)
    assert (width, height) == pytest.approx((297 * MM, 210 * MM), rel=1e-4)
    assert re.findall(r'stroke="(#\w+)"', picture.read_text()) == [plan.tools[tool - 1] for _, tool, _ in plan.runs()]


@pytest.mark.parametrize("points", [(0, 30, 10), (5, 5, 20 + 3j), (0, 40 + 0.01j, 0), (3, 30 + 20j, 60 - 5j)])
def test_passes_fill_a_stroke_and_stay_in_it(points):
    curve = torch.view_as_real(torch.tensor(points, dtype=torch.complex64) + (15 + 30j))
    stroke = strokes_along(curve[None], 6.0, torch.zeros(1, 3), 1.0)
    options = {"pen_mm": 0.5, "tolerance_mm": 0.01, "width_mm": 90.0}
    (curve,), (half,) = curves_on_paper(stroke, Gcode(**options))
    ((_, _, (way,)),) = plan_by(job_of(stroke), **options).runs()
    way = way.conj() / MM + 1j * 210
    assert away(way, curve).max() <= half - 0.25 + 0.02
    generator = np.random.default_rng(1)
    places = curve[generator.integers(len(curve), size=300)]
    places = places + half * generator.random(300) ** 0.5 * np.exp(2j * np.pi * generator.random(300))
    assert away(places, way).max() <= 0.25 + 0.05
    lengths = [plan_by(job_of(stroke), passes=n, **options).drawn for n in range(1, 6)]
    assert lengths == sorted(lengths)
    assert lengths[0] == pytest.approx(np.abs(np.diff(curve)).sum(), rel=0.01)


@BOTH
def test_what_is_read_back_are_the_strokes(tmp_path, kind):
    strokes, tolerance = inside(12), 0.03
    lines, exporter = drawn_by(kind, job_of(strokes), tmp_path, passes=1, hidden="draw", tolerance_mm=tolerance)
    curves, _ = curves_on_paper(strokes, exporter)
    assert len(lines) == 12
    matched = set()
    for _, line in lines:
        apart = [max(away(curve, line).max(), away(line, curve).max() - 0.01) for curve in curves]
        matched.add(int(np.argmin(apart)))
        assert min(apart) <= tolerance + GRID
    assert matched == set(range(12))


@BOTH
@pytest.mark.parametrize("options", [{}, {"hidden": "skip", "layers": 3}, {"hidden": "draw", "pen_mm": 3.0}])
def test_everything_is_on_the_picture_and_in_a_stroke(tmp_path, kind, options):
    strokes = random_strokes(30, SIZE, seed=3)
    lines, exporter = drawn_by(kind, job_of(strokes), tmp_path, **options)
    paper, corner, scale = exporter.frame(SIZE)
    assert paper == (297, 210)
    curves, half = curves_on_paper(strokes, exporter)
    assert len(lines) > 10
    for _, line in lines:
        left, top = corner[0], paper[1] - corner[1]
        assert left - GRID <= line.real.min() <= line.real.max() <= left + scale * SIZE[1] + GRID
        assert top - scale * SIZE[0] - GRID <= line.imag.min() <= line.imag.max() <= top + GRID
        middles = (line[:-1] + line[1:]) / 2
        beyond = np.min([np.abs(middles[:, None] - c).min(1) - h for c, h in zip(curves, half, strict=True)], axis=0)
        assert beyond.max() <= JOINED_PENS * exporter.pen_mm, "the pen leaves the paper before it goes anywhere"


@BOTH
def test_tools_are_taken_once_in_each_layer_from_light_to_dark(tmp_path, kind):
    job = job_of(random_strokes(80, SIZE, seed=4))
    lines, exporter = drawn_by(kind, job, tmp_path, colors=5, layers=3, hidden="skip")
    plan = pen_plan(job, exporter)
    runs = [(layer, tool) for layer, tool, _ in plan.runs()]
    assert [tool for tool, _ in groupby(tool for tool, _ in lines)] == [tool for tool, _ in groupby(t for _, t in runs)]
    assert runs == sorted(set(runs))
    light = [sum(bytes.fromhex(color[1:])) for color in plan.tools]
    assert 2 <= len(light) <= 5
    assert light[0] > light[-1]
    assert sum(plan.strokes) + plan.left_out == 80


def test_what_is_hidden_is_left_out():
    below = straight((30.0, 30.0), (60.0, 30.0), width=2.0)
    above = straight((20.0, 30.0), (70.0, 30.0), width=8.0, color=(0, 0, 1.0))
    across = straight((45.0, 5.0), (45.0, 55.0), width=4.0, color=(0.0, 0.5, 0.0))
    both = job_of(Strokes.join(below, above))
    assert [plan_by(both, hidden=hidden).left_out for hidden in ("cut", "skip", "draw")] == [1, 1, 0]
    faint = replace(both.strokes, opacity=torch.tensor([1.0, 0.3]))
    assert plan_by(catalogues.changed(both, strokes=faint)).left_out == 0, "it shines through"
    cross = job_of(Strokes.join(across, above))
    options = {"pens": ["lime", "blue"], "passes": 1}
    whole, cut = (plan_by(cross, hidden=hidden, **options) for hidden in ("skip", "cut"))
    (green,) = (lines for _, tool, lines in cut.runs() if tool == 1)
    assert len(green) == 2
    assert whole.drawn - cut.drawn == pytest.approx(8.0 * 277 / 90, abs=2.5 * 0.5)
    assert plan_by(cross, layers=2, **options).drawn == pytest.approx(whole.drawn), "paint covers paint"


def test_pens_have_the_colours_that_are_seen_or_given_and_layers_keep_the_depth_of_strokes():
    red = straight((0.0, 30.0), (90.0, 30.0), width=60.0)
    grey = straight((20.0, 30.0), (70.0, 30.0), width=10.0, color=(0.0, 0.0, 0.0), opacity=0.5)
    mixed = [[int(color[k : k + 2], 16) for k in (1, 3, 5)] for color in plan_by(job_of(Strokes.join(red, grey))).tools]
    assert np.abs(np.array(mixed) - [[255, 0, 0], [128, 0, 0]]).max() <= 8  # pixels at edges are mixed
    lines = (
        straight((5.0, 10.0), (80.0, 10.0), color=(0.9, 0.1, 0.1)),
        straight((5.0, 40.0), (80.0, 40.0), color=(0.1,) * 3),
    )
    plan = plan_by(job_of(Strokes.join(*lines)), pens=["black", "#f00", "blue"])
    assert (plan.tools, plan.strokes) == (["#ff0000", "#000000"], [1, 1])

    below = straight((20.0, 30.0), (70.0, 30.0), color=(0.0, 0.0, 0.0))
    above = straight((45.0, 5.0), (45.0, 55.0), color=(1.0, 0.9, 0.5))
    job = job_of(Strokes.join(above, below), depth=torch.tensor([1, 0]).int())
    tools = {n: [(layer, tool) for layer, tool, _ in plan_by(job, layers=n).runs()] for n in (1, 2)}
    assert tools == {1: [(1, 1), (1, 2)], 2: [(1, 2), (2, 1)]}


@pytest.mark.parametrize(("kind", "hidden"), [(Gcode, "cut"), (Hpgl, "skip"), (Gcode, "draw")])
def test_odd_paintings_are_drawn_as_well(tmp_path, kind, hidden):
    odd = {
        "none": job_of(Strokes.none()),
        "off the canvas": job_of(straight((-50.0, -50.0), (-20.0, -60.0))),
        "a dot": job_of(straight((40.0, 30.0), (40.0, 30.0), width=0.1)),
        "a blot": job_of(straight((40.0, 30.0), (40.0, 30.0), width=9.0)),
        "one pixel": job_of(straight((0.2, 0.2), (0.8, 0.7), width=0.3), size=(1, 1)),
        "one over all": job_of(straight((-3e5, 30.0), (4e5, 31.0), width=3e5)),
        "far control": job_of(replace(straight((10.0, 9.0), (80.0, 50.0)), control=torch.tensor([[900.0, 1e3]]))),
        "no width": job_of(straight((10.0, 9.0), (80.0, 50.0), width=0.0)),
        "no opacity": job_of(straight((10.0, 9.0), (80.0, 50.0), opacity=0.0)),
        "a long strip": job_of(straight((1.0, 0.5), (999.0, 0.5), width=0.5), size=(1, 1000)),
    }
    count = {name: len(drawn_by(kind, job, tmp_path, hidden=hidden, paper="a5")[0]) for name, job in odd.items()}
    assert {name for name, n in count.items() if n == 0} == {"none", "off the canvas", "no width", "no opacity"}
    assert max(count.values()) < 200
    assert count["a dot"] == count["a blot"] == 1


def test_vpype_does_not_silence_what_is_said_afterwards(tmp_path):
    root = logging.getLogger()
    level, handlers = root.level, [*root.handlers]
    root.setLevel(logging.INFO)
    root.handlers.clear()
    try:
        Gcode().write(job_of(inside(2)), tmp_path)
        assert (root.level, root.handlers) == (logging.INFO, [])
    finally:
        root.setLevel(level)
        root.handlers[:] = handlers


@pytest.mark.parametrize("layers", [1, 3])
def test_a_pen_that_is_held_is_not_taken_again_and_layers_begin_with_a_number_as_axidraw_wants(tmp_path, layers):
    job = job_of(random_strokes(40, SIZE, seed=4))
    for options in ({"pens": ["black"]}, {"pens": ["#101010", "white"]}, {"colors": 3}):
        machine = Gcode(layers=layers, hidden="skip", **options)
        plan, text = pen_plan(job, machine), machine.write(job, tmp_path)[0].read_text()
        tools = [tool for tool, _ in groupby(tool for _, tool, _ in plan.runs())]
        assert re.findall("^M6 T(.*)$", text, re.M) == [str(tool) for tool in tools if len(plan.tools) > 1]
    plan = plan_by(job_of(random_strokes(80, SIZE, seed=4)), layers=layers, colors=3)
    names = re.findall('inkscape:label="([^"]*)"', plan.svg())
    numbers = [int(re.match("([0-9]+) - ", name)[1]) for name in names]
    assert numbers == sorted(set(numbers))
    assert [re.search("#[0-9a-f]{6}", name)[0] for name in names] == [
        plan.tools[tool - 1] for _, tool, _ in plan.runs()
    ]


def test_the_header_says_what_is_needed_in_harmless_letters_and_the_machines_own_words_are_used(tmp_path):
    job = replace(job_of(random_strokes(25, SIZE)), source="größe!?~\n(M30)<&>;.h5")
    for kind, name in ((Gcode, "painting.gcode"), (Hpgl, "painting.hpgl.txt")):
        exporter = kind(colors=4)
        exporter.write(job, tmp_path)
        plan, text = pen_plan(job, exporter), (tmp_path / name).read_text()
        head = [row.removeprefix("; ") for row in text.splitlines()][: 5 + len(plan.tools)]
        assert not set("!?~()<>&$%") & set("".join(head))
        assert text.isascii()
        assert "gr__e_____M30_____.h5" in head[0]
        assert f"{plan.lifts} pen lifts" in head[2]
        assert f"drawn {plan.drawn / 1000:.2f} m, travel {plan.travel / 1000:.2f} m" in head[3]
        assert head[5:] == [f"tool {k}: {plan.tools[k - 1]}, {plan.strokes[k - 1]} strokes" for k in range(1, 5)]
    own = {"up": "M5", "down": "M3 S90", "change": "M0 ; pen {tool} {color}", "feed": 1e6}
    text = Gcode(**own).write(job, tmp_path)[0].read_text()
    assert "M3 S90\nG1 F1000000\nG1 X" in text
    assert re.search(r"^M0 ; pen 1 #[0-9a-f]{6}$", text, re.M)


@pytest.mark.parametrize("plotter", ["hp7475a", "artisan", "dmp_161", "sketchmate"])
def test_nothing_is_lost_on_a_plotter_that_vpype_knows(tmp_path, plotter):
    exporter = Hpgl(plotter=plotter, colors=3, margin_mm=0, speed=10)
    job = job_of(replace(inside(9), position=torch.rand(9, 2) * torch.tensor([90.0, 60.0])))
    text = exporter.write(job, tmp_path)[0].read_text()
    device = vpype.config_manager.get_plotter_config(plotter)
    paper = device.paper_config("a4")
    lines = [line * 40 for _, line in read_hpgl(text)]
    length = sum(np.abs(np.diff(line)).sum() for line in lines) * device.plotter_unit_length / vpype.UNITS["mm"]
    assert length == pytest.approx(pen_plan(job, exporter).drawn, rel=0.02)
    points = np.concatenate(lines)
    assert paper.x_range[0] <= points.real.min() <= points.real.max() <= paper.x_range[1]
    assert paper.y_range[0] <= points.imag.min() <= points.imag.max() <= paper.y_range[1]
    assert "VS10;" in text


@pytest.mark.parametrize(("paper", "landscape", "width", "expected"), [
    ("a4", None, None, ((297, 210), 277 / 90)),
    ("a4", False, None, ((210, 297), 190 / 90)),
    ("300x200mm", None, 90.0, ((300, 200), 1.0)),
])  # fmt: skip
def test_the_picture_lies_in_the_middle_of_the_paper(paper, landscape, width, expected):
    page, corner, scale = Gcode(paper=paper, landscape=landscape, width_mm=width).frame(SIZE)
    assert (page, scale) == (expected[0], pytest.approx(expected[1]))
    assert 2 * corner == pytest.approx([page[0] - 90 * scale, page[1] - 60 * scale])


@pytest.mark.parametrize(("name", "options", "message"), [
    ("gcode", {"paper": "a44"}, "paper=a44 is not a paper; choose one of a0, a1"),
    ("gcode", {"paper": "tight"}, "is not a paper"),
    ("gcode", {"paper": "300x200"}, "such as to.gcode.paper=300x200mm"),
    ("hpgl", {"margin_mm": 200.0}, "leave nothing of 210 x 297 mm; choose a larger paper"),
    ("gcode", {"colors": 0}, "to.gcode.colors=0 is not 1 to 64; try to.gcode.colors=1"),
    ("gcode", {"pens": ["reddish"]}, "'reddish'; write 'to.gcode.pens=[black"),
    ("gcode", {"pens": []}, "give 1 to 256 colours"),
    ("gcode", {"up": "G0 Z5\nM30"}, "is not one line"),
    ("hpgl", {"plotter": "axidraw"}, "not known to vpype; choose one of hp7475a"),
    ("hpgl", {"plotter": "hp7475a", "paper": "a2"}, "does not take to.hpgl.paper=a2; it takes a4, a3"),
    ("hpgl", {"plotter": "designmate"}, "cannot read what it knows"),
])  # fmt: skip
def test_options_that_make_no_sense_are_refused_in_words(name, options, message):
    refuses(re.escape(message), build_named, "to", name, options)


def test_what_does_not_fit_or_is_not_installed_is_refused_when_it_is_known(tmp_path, monkeypatch):
    with pytest.raises(UserError, match=r"too wide for 210 x 297 mm and its margins; try to\.gcode\.width_mm=190"):
        Gcode(width_mm=191.0, landscape=False).write(job_of(inside(3)), tmp_path)
    with pytest.raises(UserError, match=re.escape("hp7475a has 6 pens, fewer than 8; set to.hpgl.colors=6")):
        Hpgl(plotter="hp7475a").write(job_of(inside(30)), tmp_path)
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr("brushexp_plotters._pens.MOST_STROKES", 4)
    refuses(r"to\.hpgl: 5 strokes are more than the 4 that a plan holds; ", Hpgl().write, job_of(inside(5)), tmp_path)
    monkeypatch.setitem(sys.modules, "vpype", None)
    refuses(re.escape("pip install 'brushexp[plot]'"), Gcode)


pytest.importorskip("vpype", reason="needs pip install 'brushexp[plot]'")

TRAY = {"wells": "20x12:120x12:3x1", "water": "150x12", "cloth": "200x12", "margin_mm": 30.0, "load": 10.0}
COLORS = torch.tensor([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
NEAR = 0.1  # mm: HPGL has steps of 0.025 mm, and lines are simplified


def by_stages(n: int = 24) -> Strokes:
    """Strokes of two widths and three colours, sorted by both."""
    strokes = inside(n)
    number = torch.arange(n) * 6 // max(n, 1)
    width = torch.where(number < 3, 6.0, 3.0)
    return replace(strokes, color=COLORS[number % 3], width=width / strokes.scale)


def read(kind, job, folder, **options) -> tuple[list[tuple[int, np.ndarray]], Gcode | Hpgl]:
    exporter = kind(**{**TRAY, **options})
    return READERS[kind](exporter.write(job, folder)[0].read_text()), exporter


def is_at(line: np.ndarray, place: complex, reach: float) -> bool:
    return np.abs(line.imag - place.imag).max() < NEAR and np.abs(line.real - place.real).max() < reach + NEAR


@BOTH
def test_a_machine_paints_the_strokes_with_the_paint_and_brush_of_each(tmp_path, kind):
    strokes = by_stages()
    lines, exporter = read(kind, job_of(strokes), tmp_path)
    paper, corner, scale = exporter.frame(SIZE)
    curves = torch.view_as_complex(curve_of(strokes).double().contiguous()).numpy() * scale
    curves = corner[0] + curves.real + 1j * (paper[1] - corner[1] - curves.imag)
    well, left, painted = None, 0.0, []
    for tool, line in lines:
        dipped = [k for k, place in enumerate(exporter.tray) if is_at(line, place, STIR)]
        if dipped:
            (well,), left = dipped, 10.0 * (6.0, 3.0)[tool - 1] * scale
        elif is_at(line, 150 + 12j, RINSE) or is_at(line, 200 + 12j, WIPE):
            well = None
        else:
            assert well is not None, "a rinsed brush is dipped before it paints"
            length = np.abs(np.diff(line)).sum()
            assert length <= left + NEAR or left == 10.0 * (6.0, 3.0)[tool - 1] * scale
            left -= length
            ends = np.abs(curves[:, [0, 2]] - line[[0, -1]]).max(1)
            back = np.abs(curves[:, [2, 0]] - line[[0, -1]]).max(1)
            k = int(np.minimum(ends, back).argmin())
            assert min(ends[k], back[k]) < NEAR
            assert (well, tool) == (k * 6 // 24 % 3, 1 + k * 6 // 24 // 3)
            painted.append(k)
    assert sorted(painted) == list(range(24))
    stages = [k * 6 // 24 for k in painted]
    assert stages == sorted(stages), "the order of depth"


def test_the_report_says_how_much_is_painted_with_how_many_loads_and_where_the_wells_are():
    strokes = by_stages()
    plan, scale = brush_plan(job_of(strokes), Gcode(**TRAY)), Gcode(**TRAY).frame(SIZE)[2]
    rows = plan.report(1500, 5000)
    assert rows[5:7] == [
        f"tool {k + 1}: brush of {round(width * scale, 2):g} mm, 12 strokes" for k, width in enumerate((6, 3))
    ]
    assert "dips, " in rows[7]
    assert rows[8] == "well 1: #ff0000 at 20.0 x 12.0 mm"
    assert rows[10] == "well 3: #0000ff at 120.0 x 12.0 mm"
    fewer = brush_plan(job_of(strokes), Gcode(**{**TRAY, "load": 1000.0}))
    assert fewer.notes[0].startswith("6 dips")
    assert fewer.lifts < plan.lifts


def test_brushes_are_changed_as_seldom_as_stages_allow_and_a_tray_that_is_too_small_is_refused(tmp_path):
    with pytest.raises(UserError, match="has 2 places, and the painting 3 colours; give as many, or paint with fewer"):
        read(Gcode, job_of(by_stages()), tmp_path, wells="20x12:40x12:2x1")
    assert not list(tmp_path.iterdir())
    lines, _ = read(Gcode, job_of(by_stages()), tmp_path)
    assert [tool for tool, _ in groupby(tool for tool, _ in lines)] == [1, 2]


@BOTH
def test_extremes_are_painted_too(tmp_path, kind):
    assert read(kind, job_of(Strokes.none()), tmp_path)[0] == []
    one = read(kind, job_of(by_stages(1)), tmp_path, water=None, cloth=None)[0]
    assert len(one) == 2
    long = replace(inside(1), color=COLORS[:1])
    assert len(read(kind, job_of(long), tmp_path, load=1.0, water=None, cloth=None)[0]) == 2


@pytest.mark.parametrize(("options", "message"), [
    ({"wells": "20x12"}, "is no tray of 1 to 500 wells; try to.gcode.wells=20x15:230x45:8x3"),
    ({"wells": "0x0:9x9:0x3"}, "is no tray"),
    ({"wells": "0x0:9x9:99x99"}, "is no tray"),
    ({"wells": "0x0:9x9:3x1", "water": "left"}, "to.gcode.water=left is no place in mm"),
    ({"wells": "0x0:9x9:3x1", "load": 0.0}, "to.gcode.load=0 is not"),
])  # fmt: skip
def test_places_that_are_none_are_refused(options, message):
    from brushexp.registry import build_named  # noqa: PLC0415

    refuses(message, build_named, "to", "gcode", options)
