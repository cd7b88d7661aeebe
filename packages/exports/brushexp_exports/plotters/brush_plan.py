"""Plan paintings with dipped brushes: strokes are painted in order of depth, each in one movement.

Lengths are in millimetres, with x to the right and y down from the paper's upper left corner. Lines are arrays of
complex numbers.
"""

from collections.abc import Iterator
from itertools import groupby

import numpy as np
import shapely

from brushexp.contracts import UserError
from brushexp.contracts.families import ExportJob
from brushexp.contracts.pictures import hex_of
from brushexp_exports.plotters.pen_plan import Layer, order_layers, place_on_paper
from brushexp_exports.plotters.pens import MM, Array, PenExporter, PenPlan, load_vpype

STIR, RINSE, WIPE = 3.0, 5.0, 20.0  # mm to each side in a well, in water and along the cloth
TIMES = 3  # number of times a brush moves back and forth in water and on the cloth
MOST_RUNS = 2000  # maximum number of runs of strokes with the same colour and width


def brush_plan(job: ExportJob, machine: PenExporter) -> PenPlan:
    """Plan the strokes and dips for brushes; raise UserError if the painting is too large or has too many colours."""
    strokes, curves, widths, frame, paper = place_on_paper(job, machine)
    _check_places(machine, frame, paper[1])
    parts, widths = shapely.clip_by_rect(curves, *frame), widths.round(2)
    colors = [hex_of(color) for color in strokes.color.numpy()]
    seen = [k for k in range(len(parts)) if not shapely.is_empty(parts[k]) and widths[k] > 0]
    brushes, wells = sorted({widths[k] for k in seen}, reverse=True), list(dict.fromkeys(colors[k] for k in seen))
    _check_size(machine, [(widths[k], colors[k]) for k in seen], len(wells))
    layers = []
    for k, ((width, color), group) in enumerate(groupby(seen, key=lambda k: (widths[k], colors[k]))):
        brush, pieces = brushes.index(width), [piece for stroke in group for piece in shapely.get_parts(parts[stroke])]
        lines = [shapely.get_coordinates(piece) @ (1, 1j) for piece in pieces]
        layers.append(Layer(k * len(brushes) + brush + 1, brush, color, width, f", {width:g} mm", lines))
    document = order_layers(layers, paper, machine, joins=False)
    painted, loads, held = document.length() / MM, 0, ("", -1)
    for layer in layers:
        collection, well = document.layers[layer.number], machine.tray[wells.index(layer.color)]
        changed, held = held != (layer.color, layer.tool), (layer.color, layer.tool)
        lines = [line / MM for line in collection]
        movements = list(_with_dips(lines, layer.width, well, machine, paper, changed))
        loads += sum(is_dip for _, is_dip in movements)
        all_lines = [MM * line for line, _ in movements]
        document.layers[layer.number] = load_vpype().LineCollection(all_lines, metadata=collection.metadata)
    corners = enumerate(zip(wells, machine.tray, strict=False), start=1)
    places = [f"well {k}: {color} at {at.real:.1f} x {at.imag:.1f} mm" for k, (color, at) in corners]
    notes = [f"{loads} dips, {painted / 1000:.2f} m painted, {painted / 1000 / max(loads, 1):.2f} m per load", *places]
    counts = np.bincount([brushes.index(widths[k]) for k in seen], minlength=len(brushes)).tolist()
    names = [f"brush of {width:g} mm" for width in brushes]
    return PenPlan(document, paper, max(brushes, default=0.0), names, counts, len(parts) - len(seen), job.source, notes)


def _check_places(machine: PenExporter, frame: tuple[float, ...], height: float) -> None:
    """Raise UserError if a well, the water or the cloth overlaps the painting; in ``frame``, y points down."""
    left, right, low, high = frame[0], frame[2], height - frame[3], height - frame[1]
    places: list[tuple[str, float, complex | None]] = [("wells", STIR, place) for place in machine.tray]
    places += [("water", RINSE, machine.place("water")), ("cloth", WIPE, machine.place("cloth"))]
    for name, reach, place in places:
        if place is not None and low < place.imag < high and left < place.real + reach and place.real - reach < right:
            raise UserError(
                f"{machine.key}.{name}: {place.real:g} x {place.imag:g} mm lies in the painting, which extends from "
                f"{left:g} x {low:g} to {right:g} x {high:g} mm; move it outside, or make room: a larger "
                f"{machine.key}.paper, a smaller {machine.key}.width_mm, a wider {machine.key}.margin_mm"
            )


def _check_size(machine: PenExporter, kinds: list[tuple[float, str]], colors: int) -> None:
    if colors > (places := len(machine.tray)):
        cure = f"add wells, or paint with fewer colours: tubes=eight mixtures={places}"
        raise UserError(f"{machine.key}.wells has {places} wells, but the painting has {colors} colours; {cure}")
    if (runs := len([*groupby(kinds)])) > MOST_RUNS:
        raise UserError(f"{machine.key}: brushes and colours change {runs} times; paint with tubes=, or drop wells")


def _with_dips(
    lines: list[Array], brush: float, well: complex, machine: PenExporter, paper: tuple[float, float], changed: bool
) -> Iterator[tuple[Array, bool]]:
    """Yield the movements of a brush, and whether each is a dip; rinse and wipe the brush first if ``changed``."""

    def at(place: complex, reach: float, times: int) -> Array:
        there = place.real + 1j * (paper[1] - place.imag)
        return there + reach * np.array([-1, 1] * times)

    if changed:
        for place, reach in ((machine.place("water"), RINSE), (machine.place("cloth"), WIPE)):
            if place is not None:
                yield at(place, reach, TIMES), False
    load, left = machine.load * brush, -1.0
    for line in lines:
        length = float(np.abs(np.diff(line)).sum())
        if length > left:
            yield at(well, STIR, 1), True
            left = load
        yield line, False
        left -= length
