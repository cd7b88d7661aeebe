"""Read files for plotters and milling machines as the lines that each tool draws, in millimetres."""

import re
from dataclasses import replace

import catalogues
import numpy as np
import torch
from brushexp_exports.plotters.gcode import Gcode
from brushexp_exports.plotters.hpgl import Hpgl
from brushexp_exports.plotters.pen_plan import pen_plan
from brushexp_exports.plotters.pens import PenPlan
from scenes import random_strokes

from brushexp.plugins.export.base import ExportJob
from brushexp.strokes.catalogue import Strokes

SIZE = (60, 90)  # on landscape A4 with margins of 10 mm, a pixel is 277 / 90 mm


def job_of(strokes: Strokes, depth=None, size=SIZE) -> ExportJob:
    return catalogues.job_of(strokes, size, depth=depth, background=torch.ones(3), source="a/catalogue.h5")


def inside(n: int, seed: int = 0) -> Strokes:
    """Make opaque strokes of different colours that do not extend beyond the canvas."""
    strokes = random_strokes(n, SIZE, seed=seed, bend=0.1)
    place = torch.rand(n, 2, generator=torch.Generator().manual_seed(seed)) * 0.3 + 0.35
    return replace(strokes, position=place * torch.tensor([90.0, 60.0]), opacity=torch.ones(n))


def plan_by(job: ExportJob, **options) -> PenPlan:
    return pen_plan(job, Gcode(**options))


def read_gcode(text: str) -> list[tuple[int, np.ndarray]]:
    """Return the tool and the points of every drawn line; fail on commands that should never reach a machine."""
    lines, down, place = [], False, 0j
    tool = 0 if "M0" in text else 1  # a plan for one pen begins with that pen in the holder
    blocks = [row for row in text.splitlines() if not row.startswith(";")]
    assert (blocks[:2], blocks[-1]) == (["G21", "G90"], "M2")
    for block in blocks:
        if change := re.fullmatch(r"M0 ; tool (\d+), .+", block):
            assert not down, "the pen must be up when tools are changed"
            tool = int(change[1])
        elif block == "G0 Z5":
            down = False
        elif block == "G1 Z0 F600":
            assert tool, "nothing is drawn without a tool"
            down = True
            lines.append((tool, [place]))
        elif move := re.fullmatch(r"(G[01]) X(\S+) Y(\S+)", block):
            assert down == (move[1] == "G1"), "the pen must be up for fast moves and down for slow moves"
            place = complex(float(move[2]), float(move[3]))
            if down:
                lines[-1][1].append(place)
        elif block == "G0 X0 Y0":
            assert not down
        else:
            assert block in ("G21", "G90", "G1 F1500", "M2")
    return [(tool, np.array(points)) for tool, points in lines]


def read_hpgl(text: str) -> list[tuple[int, np.ndarray]]:
    """Return the pen and the points, in millimetres, of every drawn line."""
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
