"""Plan what a machine paints with brushes that it dips: strokes in the order of their depth, each in one movement.

Lengths are millimetres, x to the right and y down from the paper's upper left corner; lines are complex numbers.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import shapely

from brushexp.errors import UserError
from brushexp.pictures.color import hex_of
from brushexp.plugins.export.base import ExportJob
from brushexp_plotters._pen_plan import on_paper, ordered
from brushexp_plotters._pens import MM, Array, PenExporter, PenPlan, load_vpype

STIR, RINSE, WIPE = 3.0, 5.0, 20.0  # mm to both sides in a well and in water, and along the cloth
TIMES = 3  # that a brush goes back and forth in water, and on the cloth
MOST_RUNS = 2000  # of strokes of one colour and width


@dataclass(frozen=True)
class Run:
    """Strokes that are painted one after the other, of one brush and one colour."""

    brush: int  # from 0: the largest first
    well: int  # from 0: in the order in which colours are first used
    lines: list[Array]


def brush_plan(job: ExportJob, machine: PenExporter) -> PenPlan:
    """Plan what brushes paint and where they are dipped; a UserError if wells or the paper cannot hold it."""
    strokes, curves, widths, frame, paper = on_paper(job, machine)
    parts, widths = shapely.clip_by_rect(curves, *frame), widths.round(2)
    colors = [hex_of(color) for color in strokes.color.numpy()]
    seen = [k for k in range(len(parts)) if not shapely.is_empty(parts[k]) and widths[k] > 0]
    brushes, wells = sorted({widths[k] for k in seen}, reverse=True), list(dict.fromkeys(colors[k] for k in seen))
    _check_size(machine, seen, [(widths[k], colors[k]) for k in seen], len(wells))
    runs = [
        Run(brushes.index(width), wells.index(color), [line for k in group for line in _lines(parts[k])])
        for (width, color), group in groupby(seen, key=lambda k: (widths[k], colors[k]))
    ]
    document = ordered(_document(runs, brushes, wells, paper), machine, joins=False)
    painted, loads = document.length() / MM, 0
    for k, run in enumerate(runs):
        number = k * len(brushes) + run.brush + 1
        changed = k == 0 or (runs[k - 1].well, runs[k - 1].brush) != (run.well, run.brush)
        properties = document.layers[number].metadata
        lines = list(_with_dips([line / MM for line in document.layers[number]], run, brushes, machine, paper, changed))
        loads += sum(is_dip for _, is_dip in lines)
        document.layers[number] = load_vpype().LineCollection([MM * line for line, _ in lines], metadata=properties)
    places = [f"well {k + 1}: {color} at {_words(machine.tray[k])} mm" for k, color in enumerate(wells)]
    notes = [f"{loads} dips, {painted / 1000:.2f} m painted, {painted / 1000 / max(loads, 1):.2f} m per load", *places]
    counts = np.bincount([brushes.index(widths[k]) for k in seen], minlength=len(brushes)).tolist()
    names = [f"brush of {width:g} mm" for width in brushes]
    return PenPlan(document, paper, max(brushes, default=0.0), names, counts, len(parts) - len(seen), job.source, notes)


def _check_size(machine: PenExporter, seen: list[int], kinds: list[tuple[float, str]], colors: int) -> None:
    if colors > len(machine.tray):
        cure = f"give as many, or paint with fewer: tubes=eight mixtures={len(machine.tray)}"
        raise UserError(
            f"{machine.key}.wells has {len(machine.tray)} places, and the painting {colors} colours; {cure}"
        )
    if (runs := len([*groupby(kinds)])) > MOST_RUNS:
        raise UserError(f"{machine.key}: brushes and colours change {runs} times; paint with tubes=, or drop wells")


def _words(place: complex) -> str:
    return f"{place.real:.1f} x {place.imag:.1f}"


def _lines(part: shapely.Geometry) -> list[Array]:
    return [shapely.get_coordinates(each) @ (1, 1j) for each in shapely.get_parts(part)]


def _document(runs: list[Run], brushes: list[float], wells: list[str], paper: tuple[float, float]) -> object:
    """Make a document of vpype with a layer for each run."""
    vpype = load_vpype()
    document = vpype.Document(page_size=tuple(MM * side for side in paper))
    for k, run in enumerate(runs):
        number, color, width = k * len(brushes) + run.brush + 1, wells[run.well], brushes[run.brush]
        document.add(vpype.LineCollection([MM * line for line in run.lines]), number)
        properties = {"tool": run.brush + 1, "color": color, "vp_color": color, "vp_pen_width": MM * width}
        properties["vp_name"] = f"{number} - {color}, {width:g} mm"
        for key, value in properties.items():
            document.layers[number].set_property(key, value)
    return document


def _with_dips(
    lines: list[Array], run: Run, brushes: list[float], machine: PenExporter, paper: tuple[float, float], changed: bool
) -> Iterator[tuple[Array, bool]]:
    """Put rinsing, wiping and dipping before the lines of a run, and dips between them; tell which are dips."""

    def at(place: complex, reach: float, times: int) -> Array:
        there = place.real + 1j * (paper[1] - place.imag)
        return there + reach * np.array([-1, 1] * times)

    if changed:
        for place, reach in ((machine.place("water"), RINSE), (machine.place("cloth"), WIPE)):
            if place is not None:
                yield at(place, reach, TIMES), False
    load, left = machine.load * brushes[run.brush], -1.0
    for line in lines:
        length = float(np.abs(np.diff(line)).sum())
        if length > left:
            yield at(machine.tray[run.well], STIR, 1), True
            left = load
        yield line, False
        left -= length
