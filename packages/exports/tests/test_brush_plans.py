"""Test that a machine following a plan for dipped brushes paints each stroke with paint from the correct well."""

from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
import torch
from brushexp_exports.plotters.brush_plan import RINSE, STIR, WIPE, brush_plan
from brushexp_exports.plotters.gcode import Gcode
from brushexp_exports.plotters.hpgl import Hpgl
from machines import READERS, SIZE, inside, job_of
from refusals import refuses
from test_plans import BOTH

from brushexp.errors import UserError
from brushexp.registry import build_named
from brushexp.strokes.bezier import curve_of
from brushexp.strokes.catalogue import Strokes

TRAY = {"wells": "20x12:120x12:3x1", "water": "150x12", "cloth": "200x12", "margin_mm": 30.0, "load": 10.0}
COLORS = torch.tensor([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
NEAR = 0.1  # tolerance in mm; HPGL has steps of 0.025 mm, and lines are simplified


def by_stages(n: int = 24) -> Strokes:
    """Make strokes of two widths and three colours, sorted by width and then by colour."""
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
    assert stages == sorted(stages), "strokes are painted in order of depth"


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
    with pytest.raises(UserError, match="has 2 wells, but the painting has 3 colours; add wells, or paint with fewer"):
        read(Gcode, job_of(by_stages()), tmp_path, wells="20x12:40x12:2x1")
    assert not list(tmp_path.iterdir())
    lines, _ = read(Gcode, job_of(by_stages()), tmp_path)
    assert [tool for tool, _ in groupby(tool for tool, _ in lines)] == [1, 2]


@pytest.mark.parametrize(("options", "what"), [
    ({"wells": "20x12:120x60:3x2"}, "wells: 70 x 60 mm lies"),
    ({"water": "100x100"}, "water: 100 x 100 mm lies"),
    ({"cloth": "25x100"}, "cloth: 25 x 100 mm lies"),  # the brush is wiped 20 mm to each side
])  # fmt: skip
def test_a_brush_is_not_dipped_rinsed_or_wiped_in_the_painting(options, what):
    cure = "move it outside, or make room: a larger to.gcode.paper, "
    where = f"to.gcode.{what} in the painting, which extends from 36 x 30 to 261 x 180 mm; {cure}"
    refuses(where, brush_plan, job_of(by_stages()), Gcode(**{**TRAY, **options}))
    brush_plan(job_of(by_stages()), Gcode(**TRAY | {"cloth": "10x100"}))


@BOTH
def test_extremes_are_painted_too(tmp_path, kind):
    assert read(kind, job_of(Strokes.none()), tmp_path)[0] == []
    one = read(kind, job_of(by_stages(1)), tmp_path, water=None, cloth=None)[0]
    assert len(one) == 2
    long = replace(inside(1), color=COLORS[:1])
    assert len(read(kind, job_of(long), tmp_path, load=1.0, water=None, cloth=None)[0]) == 2


@pytest.mark.parametrize(("options", "message"), [
    ({"wells": "20x12"}, "is not a tray of 1 to 500 wells; try to.gcode.wells=20x15:230x45:8x3"),
    ({"wells": "0x0:9x9:0x3"}, "is not a tray"),
    ({"wells": "0x0:9x9:99x99"}, "is not a tray"),
    ({"wells": "0x0:9x9:3x1", "water": "left"}, "to.gcode.water=left is not a place in mm"),
    ({"wells": "0x0:9x9:3x1", "load": 0.0}, "to.gcode.load=0 is not"),
])  # fmt: skip
def test_places_that_are_none_are_refused(options, message):

    refuses(message, build_named, "to", "gcode", options)
