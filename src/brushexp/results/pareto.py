"""Which runs are worth their time: the front of seconds against PSNR, and against the perceptual distance."""

from __future__ import annotations

import csv
import io
import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean
from typing import TYPE_CHECKING

from brushexp.results.labels import Box, leader, place
from brushexp.results.plotting import COLORS, INK, new_figure, plain, save, tidy, wrapped
from brushexp.results.runs import Picture, Setting, by_picture, paintings
from brushexp.results.table import NOTHING, Result, collect, markdown, numbers
from brushexp.system.files import write_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEIGHT = 7.0  # inches: of the panels of a picture
ROWS = 6  # pictures in a plot at most; the tables have all
FLOOR = 0.01  # seconds: a logarithmic axis has no 0
LETTERS = 26  # in a line of a label
GREY = "#9a9a9a"
DOT = 5.0  # pixels: half the side of what a point covers
FAR, BESIDE = 330.0, 60.0  # pixels: largest distance of a label, and of a number, from its point
ROOM, MARGIN = 0.25, 0.06  # of the height: free on the better side, where labels go, and on the other
TICKS = ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7), tuple(1 + k / 10 for k in range(90)))


@dataclass(frozen=True)
class Point:
    """One setting in the plot.

    Attributes:
        number: in the order of seconds, from 1.
        setting: overrides, and the runs of which the numbers are means.
        seconds: of optimisation.
        psnr: in dB.
        perceptual: distance; None if it was not measured.
        first: on which fronts it lies, of "psnr" and "perceptual".
    """

    number: int
    setting: Setting
    seconds: float
    psnr: float
    perceptual: float | None
    first: tuple[str, ...]


def front(costs: Sequence[tuple[float, float]]) -> list[bool]:
    """Which pairs are on the Pareto front: no other is as low in both and lower in one."""
    return [not any(a <= x and b <= y and (a < x or b < y) for a, b in costs) for x, y in costs]


def points_of(picture: Picture) -> list[Point]:
    """The settings of a picture in the order of seconds, means over seeds."""
    rows = []
    for setting in picture.settings:
        perceptual = numbers(setting.runs, "perceptual")
        seconds, psnr = (mean(numbers(setting.runs, metric)) for metric in ("seconds", "psnr"))
        rows.append((setting, seconds, psnr, mean(perceptual) if perceptual else None))
    rows.sort(key=lambda row: row[1])
    best = front([(seconds, -psnr) for _, seconds, psnr, _ in rows])
    near = front([(seconds, math.inf if distance is None else distance) for _, seconds, _, distance in rows])
    points = []
    for k, (setting, seconds, psnr, distance) in enumerate(rows):
        first = ("psnr",) * best[k] + ("perceptual",) * (near[k] and distance is not None)
        points.append(Point(k + 1, setting, seconds, psnr, distance, first))
    return points


def write_front(folder: Path, results: list[Result] | None = None) -> tuple[Path, Path, Path] | None:
    """Write ``pareto.md``, ``pareto.csv`` and ``pareto.png``; None if no two settings of a picture were finished.

    Args:
        folder: where to.
        results: of which runs; None means those of the sweep in this folder.

    Returns:
        Their paths.
    """
    pictures = by_picture(folder, paintings(collect(folder) if results is None else results))
    found = {picture.name: points_of(picture) for picture in pictures if len(picture.settings) > 1}
    if not found:
        return None
    paths = folder / "pareto.md", folder / "pareto.csv", folder / "pareto.png"
    write_text(paths[0], as_markdown(found))
    write_text(paths[1], as_csv(found))
    save(_plot(found, folder.resolve().name), paths[2])
    return paths


def as_csv(found: dict[str, list[Point]]) -> str:
    """Every point, with the command that repeats it."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    head = ["picture", "number", "seconds", "psnr", "perceptual", "runs", "front_psnr", "front_perceptual"]
    writer.writerow([*head, "overrides", "command"])
    for picture, points in found.items():
        for p in points:
            fronts = ["psnr" in p.first, "perceptual" in p.first]
            row = [picture, p.number, p.seconds, p.psnr, p.perceptual, len(p.setting.runs), *fronts]
            writer.writerow([*row, p.setting.label, p.setting.command])
    return file.getvalue()


def as_markdown(found: dict[str, list[Point]]) -> str:
    """A table for each picture, those on a front marked, and below it the commands that repeat them."""
    lines = ["Seconds of optimisation, means over seeds. On a front: nothing else is as fast and as good."]
    for picture, points in found.items():
        lines += ["", f"## {picture}", "", *_rows(points), "", *_commands(points)]
    return "\n".join([*lines, ""])


def _rows(points: list[Point]) -> list[str]:
    head = ["", "seconds", "psnr", "perceptual", "runs", "front", "overrides"]
    rules = ["---:", "---:", "---:", "---:", "---:", "---", "---"]
    rows = []
    for p in points:
        distance = NOTHING if p.perceptual is None else f"{p.perceptual:.4f}"
        figures = [f"{p.seconds:.2f}", f"{p.psnr:.2f}", distance, str(len(p.setting.runs))]
        rows.append([str(p.number), *figures, ", ".join(p.first), p.setting.label])
    return markdown([head, rules, *rows])


def _commands(points: list[Point]) -> list[str]:
    """What repeats those on a front; first what all of them begin with."""
    commands = {p.number: shlex.split(p.setting.command) for p in points if p.first}
    every = [word for word in next(iter(commands.values())) if all(word in words for words in commands.values())]
    rest = {number: [word for word in words if word not in every] for number, words in commands.items()}
    lines = [f"{number:>4}: {shlex.join(words) or '(no more)'}" for number, words in rest.items()]
    return ["Those on a front are repeated by", "", "```", shlex.join(every), *lines, "```"]


def _plot(found: dict[str, list[Point]], title: str) -> Figure:
    """A row of two panels for each picture."""
    shown = dict(list(found.items())[:ROWS])
    figure = new_figure(HEIGHT * len(shown))
    grid: list[list[Axes]] = figure.subplots(len(shown), 2, squeeze=False).tolist()
    for panels, (name, points) in zip(grid, shown.items(), strict=True):
        _panel(panels[0], points, "psnr")
        _panel(panels[1], points, "perceptual")
        panels[0].set_title(plain(name), fontsize=11, loc="left", color=INK)
    left_out = f"; {len(found) - ROWS} more in the table" * (len(found) > ROWS)
    figure.suptitle(
        f"{plain(title)[:60]}: what is worth its time; grey numbers are explained in pareto.md{left_out}",
        fontsize=11, x=0.01, ha="left",
    )  # fmt: skip
    _write_labels(figure, grid, list(shown.values()))
    return figure


def _value(point: Point, metric: str) -> float | None:
    return point.psnr if metric == "psnr" else point.perceptual


def _places(points: list[Point], metric: str) -> dict[int, tuple[float, float, bool]]:
    """Where each point is drawn, and whether it really lies further down; far outliers stand on the edge."""
    found = {p.number: (max(p.seconds, FLOOR), y) for p in points if (y := _value(p, metric)) is not None}
    best = [found[p.number][1] for p in points if metric in p.first]
    if not best:
        return {}
    span = 1.5 * (max(best) - min(best)) or max(abs(best[0]), 1e-9)
    low, high = (min(best) - span, math.inf) if metric == "psnr" else (-math.inf, max(best) + span)
    return {n: (x, min(max(y, low), high), not low <= y <= high) for n, (x, y) in found.items()}


def _panel(axes: Axes, points: list[Point], metric: str) -> None:
    """Points and front of one metric, without labels."""
    tidy(axes)
    places = _places(points, metric)
    axes.set_xlabel("optimisation, s", fontsize=10)
    better = "higher" if metric == "psnr" else "lower"
    axes.set_ylabel(
        {"psnr": "PSNR, dB", "perceptual": "perceptual distance"}[metric] + f" ({better} is better)", fontsize=10
    )
    if not places:
        axes.text(0.5, 0.5, "not measured", transform=axes.transAxes, ha="center", color=GREY)
        return
    first = [p.number for p in points if metric in p.first]
    xs, ys = [x for x, _, _ in places.values()], [y for _, y, _ in places.values()]
    left, right = min(xs) / 1.5, max(xs) * 1.2
    span = max(ys) - min(ys) or max(abs(ys[0]), 1e-9) * 0.1
    below, above = (MARGIN, ROOM) if metric == "psnr" else (ROOM, MARGIN)
    axes.set(xscale="log", xlim=(left, right), ylim=(min(ys) - below * span, max(ys) + above * span))
    _ticks(axes, left, right)
    low, high = axes.get_ylim()
    if metric == "perceptual":  # the room for labels may lie below 0, where no distance is
        axes.set_yticks([tick for tick in axes.get_yticks() if max(low, 0) <= tick <= high])
    for number, (x, y, outside) in places.items():
        marker = ("v" if metric == "psnr" else "^") if outside else "o"
        color, size = (COLORS[0], 6) if number in first else (GREY, 4)
        axes.plot(x, y, marker, color=color, markersize=size, zorder=3)
    steps = [places[number][:2] for number in first]
    axes.step(
        [*(x for x, _ in steps), right], [*(y for _, y in steps), steps[-1][1]], where="post",
        color=COLORS[0], linewidth=1.3, zorder=2,
    )  # fmt: skip


def _ticks(axes: Axes, low: float, high: float) -> None:
    """Plain numbers on a logarithmic axis, as few as tell the scale."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for steps in TICKS:
        ticks = [step * 10.0**decade for decade in decades for step in steps]
        ticks = [tick for tick in ticks if low <= tick <= high]
        if len(ticks) >= 4:
            break
    axes.minorticks_off()
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])


def _write_labels(figure: Figure, grid: Sequence[Sequence[Axes]], pictures: list[list[Point]]) -> None:
    """Write overrides beside the points of a front and numbers beside the others, where there is room."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415

    FigureCanvasAgg(figure).draw()  # lays out the panels: only now it is known where points are
    figure.set_layout_engine("none")
    for panels, points in zip(grid, pictures, strict=True):
        for axes, metric in zip(panels, ("psnr", "perceptual"), strict=True):
            places = _places(points, metric)
            if places:
                _label(figure, axes, points, metric, places)


def _label(
    figure: Figure, axes: Axes, points: list[Point], metric: str, places: dict[int, tuple[float, float, bool]]
) -> None:
    pixels = {number: tuple(axes.transData.transform((x, y))) for number, (x, y, _) in places.items()}
    frame = axes.get_window_extent()
    area = (frame.x0 + 2, frame.y0 + 2, frame.x1, frame.y1)
    taken: list[Box] = [(x - DOT, y - DOT, x + DOT, y + DOT) for x, y in pixels.values()]
    first = [p for p in points if metric in p.first]
    corners = [pixels[p.number] for p in first]
    for (x, y), (next_x, next_y) in zip(corners, [*corners[1:], (frame.x1, corners[-1][1])], strict=True):
        taken += [(x, y - 1, next_x, y + 1), (next_x - 1, min(y, next_y), next_x + 1, max(y, next_y))]
    texts = {p.number: f"{p.number}  " + in_lines(p.setting.parts or ("default",), LETTERS) for p in first}
    taken += _write(figure, texts, pixels, taken, area, FAR, size=8.5, color=INK)
    others = {p.number: str(p.number) for p in points if p.number in pixels and p not in first}
    _write(figure, others, pixels, taken, area, BESIDE, size=7, color="#707070")


def _write(
    figure: Figure, texts: dict[int, str], pixels: dict[int, tuple[float, float]], taken: list[Box], area: Box,
    far: float, *, size: float, color: str,
) -> list[Box]:  # fmt: skip
    """Write each text beside its point with a line to it, or its number alone, or nothing; return what they cover."""
    from matplotlib.lines import Line2D  # noqa: PLC0415
    from matplotlib.transforms import IdentityTransform  # noqa: PLC0415

    written = [
        figure.text(0, 0, text, fontsize=size, color=color, transform=IdentityTransform(), va="bottom", zorder=5)
        for text in texts.values()
    ]
    boxes = [text.get_window_extent() for text in written]
    points = [pixels[number] for number in texts]
    places = place(points, [(box.width, box.height) for box in boxes], taken, area, far)
    for text, drawn, box, point in zip(written, boxes, places, points, strict=True):
        if box[0] == box[2]:
            text.set_visible(False)
            continue
        text.set_position((box[0] - drawn.x0, box[1] - drawn.y0))
        (x0, y0), *_, (x1, y1) = leader(point, box)
        figure.add_artist(Line2D([x0, x1], [y0, y1], transform=IdentityTransform(), color=GREY, linewidth=0.6))
    return [box for box in places if box[0] < box[2]]


def in_lines(parts: Sequence[str], width: int) -> str:
    """Overrides in lines of so many letters, broken between them if possible."""
    lines = [""]
    for part in parts:
        joined = f"{lines[-1]} {part}".strip()
        if len(joined) <= width or not lines[-1]:
            lines[-1] = joined
        else:
            lines.append(part)
    return "\n".join(wrapped(line, width) for line in lines)
