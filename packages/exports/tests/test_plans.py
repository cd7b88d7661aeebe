"""Test that a machine following a stroke plan draws the painting on the paper, in an order that saves time."""

import re
from dataclasses import replace
from itertools import groupby, pairwise

import catalogues
import numpy as np
import pytest
import torch
from brushexp_exports.plotters.gcode import Gcode
from brushexp_exports.plotters.hpgl import Hpgl
from brushexp_exports.plotters.pen_plan import JOINED_PENS, pen_plan
from machines import READERS, SIZE, inside, job_of, plan_by
from scenes import random_strokes, straight
from test_plan_files import MM, vpype

from brushexp.plugins.export.base import ExportJob
from brushexp.strokes.bezier import curve_of, half_width_of, strokes_along
from brushexp.strokes.catalogue import Strokes

GRID = 0.025 / 2 * 2**0.5  # maximum rounding error of HPGL in mm


def curves_on_paper(strokes: Strokes, exporter: Gcode | Hpgl, size=SIZE) -> tuple[np.ndarray, np.ndarray]:
    """Return complex points (N, 200) on the curves and half widths (N,), in mm; the origin is the lower left corner."""
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
    """Compute the distances (P,) from complex points (P,) to a polyline (M,)."""
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


@BOTH
def test_the_plan_says_how_far_the_machine_goes_with_and_without_a_line(tmp_path, kind):
    job = job_of(random_strokes(25, SIZE))
    lines, exporter = drawn_by(kind, job, tmp_path, colors=4, layers=2)
    plan = pen_plan(job, exporter)
    assert plan.drawn == pytest.approx(sum(np.abs(np.diff(line)).sum() for _, line in lines), rel=0.01)
    ways = [abs(after[0] - before[-1]) for (_, before), (_, after) in pairwise(lines)]
    assert plan.travel == pytest.approx(sum(ways), rel=0.01)


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
        assert beyond.max() <= JOINED_PENS * exporter.pen_mm, "the pen is lifted for any longer move"


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
    assert plan_by(catalogues.changed(both, strokes=faint)).left_out == 0, "faint paint is transparent"
    cross = job_of(Strokes.join(across, above))
    options = {"pens": ["lime", "blue"], "passes": 1}
    whole, cut = (plan_by(cross, hidden=hidden, **options) for hidden in ("skip", "cut"))
    (green,) = (lines for _, tool, lines in cut.runs() if tool == 1)
    assert len(green) == 2
    assert whole.drawn - cut.drawn == pytest.approx(8.0 * 277 / 90, abs=2.5 * 0.5)
    assert plan_by(cross, layers=2, **options).drawn == pytest.approx(whole.drawn), "paint covers lower layers"


def test_pens_have_the_colours_that_are_seen_or_given_and_layers_keep_the_depth_of_strokes():
    red = straight((0.0, 30.0), (90.0, 30.0), width=60.0)
    grey = straight((20.0, 30.0), (70.0, 30.0), width=10.0, color=(0.0, 0.0, 0.0), opacity=0.5)
    mixed = [[int(color[k : k + 2], 16) for k in (1, 3, 5)] for color in plan_by(job_of(Strokes.join(red, grey))).tools]
    assert np.abs(np.array(mixed) - [[255, 0, 0], [128, 0, 0]]).max() <= 8  # edge pixels have mixed colours
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
