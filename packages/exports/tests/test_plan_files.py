"""Test that stroke-plan files describe pens, layers and paper as machines and their software expect."""

import logging
import re
import sys
from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
import torch
from brushexp_exports.plotters.gcode import Gcode
from brushexp_exports.plotters.hpgl import Hpgl
from brushexp_exports.plotters.pen_plan import pen_plan
from machines import SIZE, inside, job_of, plan_by, read_hpgl
from refusals import refuses
from scenes import random_strokes

from brushexp.errors import UserError
from brushexp.registry import build_named

vpype = pytest.importorskip("vpype", reason="needs pip install 'brushexp[plot]'")

MM = vpype.UNITS["mm"]


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
        assert re.findall("^M0 ; tool (.*), #", text, re.M) == [str(tool) for tool in tools if len(plan.tools) > 1]
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
    ("hpgl", {"margin_mm": 200.0}, "leave no room on 210 x 297 mm; choose a larger paper"),
    ("gcode", {"colors": 0}, "to.gcode.colors=0 is not 1 to 64; try to.gcode.colors=8"),
    ("gcode", {"pens": ["reddish"]}, "'reddish'; write 'to.gcode.pens=[black"),
    ("gcode", {"pens": []}, "give 1 to 256 colours"),
    ("gcode", {"up": "G0 Z5\nM30"}, "is not one line"),
    ("hpgl", {"plotter": "axidraw"}, "not known to vpype; choose one of hp7475a"),
    ("hpgl", {"plotter": "hp7475a", "paper": "a2"}, "does not support to.hpgl.paper=a2; it supports a4, a3"),
    ("hpgl", {"plotter": "designmate"}, "cannot read its data"),
])  # fmt: skip
def test_options_that_make_no_sense_are_refused_in_words(name, options, message):
    refuses(re.escape(message), build_named, "to", name, options)


def test_what_does_not_fit_or_is_not_installed_is_refused_when_it_is_known(tmp_path, monkeypatch):
    with pytest.raises(UserError, match=r"too wide for 210 x 297 mm and its margins; try to\.gcode\.width_mm=190"):
        Gcode(width_mm=191.0, landscape=False).write(job_of(inside(3)), tmp_path)
    with pytest.raises(UserError, match=re.escape("hp7475a has 6 pens, fewer than 8; set to.hpgl.colors=6")):
        Hpgl(plotter="hp7475a").write(job_of(inside(30)), tmp_path)
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr("brushexp_exports.plotters.pens.MOST_STROKES", 4)
    refuses(
        r"to\.hpgl: 5 strokes are more than the 4 that a plan can hold; ", Hpgl().write, job_of(inside(5)), tmp_path
    )
    monkeypatch.setitem(sys.modules, "vpype", None)
    refuses(re.escape("pip install 'brushexp[plot]'"), Gcode)


pytest.importorskip("vpype", reason="needs pip install 'brushexp[plot]'")
