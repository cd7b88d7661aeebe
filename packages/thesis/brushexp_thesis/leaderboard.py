"""``task=leaderboard``: compare finished runs, other people's paintings, and published figures."""

import logging
import os
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePath
from textwrap import shorten
from typing import Any
from urllib.parse import quote

import numpy as np
from brushexp_studies import plotting
from brushexp_studies.paired import CONFIDENCE, interval
from brushexp_studies.plotting import COLORS, DASHES, FIGURE_SIZE, INK
from matplotlib.axes import Axes
from omegaconf import DictConfig

from brushexp.contracts import UserError
from brushexp.contracts.files import as_shown, write_text
from brushexp.contracts.pages import page, side_for, thumbnail
from brushexp.contracts.results import gather, remark_on_provenance, words_of
from brushexp.contracts.runs import Status
from brushexp_thesis import standings_tables as tables
from brushexp_thesis.added import add_paintings
from brushexp_thesis.published import SHIPPED_FIGURES, PublishedFigures, read_published
from brushexp_thesis.standings import COLUMNS, Row, Section, count_of, entries_of, sections_of

log = logging.getLogger(__name__)
TEMPLATES = Path(__file__).with_name("templates")


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write a page and tables that compare the runs in ``cfg.runs`` and the paintings in ``cfg.add``."""
    published = read_published(Path(cfg.published) if cfg.published else SHIPPED_FIGURES)
    folders = [Path(path) for path in cfg.runs]
    if cfg.add is not None:
        name, numbers = cfg.name or Path(cfg.add).stem, {"n_strokes": cfg.strokes, "seconds": cfg.seconds}
        add_paintings(folder / "added", Path(cfg.add), cfg.target, name, numbers, cfg.lpips_backbone, cfg.lpips_weights)
        folders.append(folder / "added")
    if not folders:
        raise UserError("nothing to compare; try runs=outputs, or add=painting.png target=photo.jpg name=theirs")
    runs = gather(folders, folder)
    entries = entries_of(runs)
    if not entries:
        raise UserError(f"runs={','.join(cfg.runs)}: no finished painting found; set runs= to folders that contain one")
    finished = {str(entry.folder) for entry in entries}
    others = sorted({as_shown(Path(path)) for path in runs["run"]["folder"] if str(path) not in finished})
    if others:
        log.warning("left out, because they are not finished paintings: %s", shorten(", ".join(others), 300))
    remark = remark_on_provenance(runs[[str(path) in finished for path in runs["run"]["folder"]]])
    if remark:
        log.warning(remark)
    sections = sections_of(entries, published)
    beside = {id(one) for section in sections for one in section.published}
    elsewhere = [one for one in published if id(one) not in beside]
    words = [word for word in words_of(folder) if word.partition("=")[0] not in ("output", "overwrite", "note")]
    write_standings_plot(folder, sections)
    note = " ".join(filter(None, (cfg.note, remark)))
    write_leaderboard_page(folder, sections, elsewhere, note)
    command = shlex.join(["brushexp", *words])
    table = tables.write_leaderboard_tables(folder, sections, elsewhere, command, note)
    log.info("%s: %d paintings in %d sections", as_shown(table), len(entries), len(sections))
    return {"paintings": len(entries), "status": Status.COMPLETED}  # without a metrics.json, because this is not a run


def write_leaderboard_page(
    folder: Path, sections: Sequence[Section], elsewhere: Sequence[PublishedFigures], note: str = ""
) -> Path:
    """Write ``report.html``, which includes the plot and shows each picture in the first section that contains it."""
    home = {target: section for section in reversed(sections) for target in section.pictures}
    side = side_for(sum((1 + len(section.rows)) for section in home.values()))
    html = page(
        "leaderboard.html.j2",
        TEMPLATES,
        title="Leaderboard",
        note=note,
        plot=thumbnail(folder / "anytime.png", 1400),
        explained=tables.EXPLANATION.replace("*", ""),
        sections=[
            {
                "title": section.title,
                "short": section.title.partition(":")[0],
                "cells": tables.without_empty(tables.table_cells(section)),
                "seconds": tables.at_equal_seconds(section),
                "paintings": list(_paintings(folder, section, home, side)),
            }
            for section in sections
        ],
        equal_seconds=tables.EQUAL_SECONDS,
        elsewhere=tables.without_empty([tables.published_cells(one, one.of.pictures) for one in elsewhere]),
        elsewhere_explained=tables.ELSEWHERE,
        better={metric.name: metric.better for metric in COLUMNS.values()},
        words=("painter", "settings", "pictures"),
    )
    write_text(folder / "report.html", html)
    return folder / "report.html"


def _paintings(folder: Path, section: Section, home: dict[str, Section], side: int) -> Iterator[dict[str, Any]]:
    for k, (target, name) in enumerate(section.pictures.items()):
        if home[target] is section:
            picture = thumbnail(section.rows[0].entries[k].folder / "target.png", side)
            items = [{"name": "target", "picture": picture}, *(_painting(folder, row, k, side) for row in section.rows)]
            yield {"name": name, "shown": [item for item in items if item["picture"]]}


def _painting(folder: Path, row: Row, k: int, side: int) -> dict[str, Any]:
    entry = row.entries[k]
    report = entry.folder / "report.html"
    address = quote(PurePath(os.path.relpath(report, folder.resolve())).as_posix(), errors="surrogateescape")
    strokes = "" if entry.strokes is None else f", {count_of(entry.strokes)} strokes"
    return {
        "name": row.label,
        "caption": f"{row.numbers['psnr'][k]:.2f} dB{strokes}",
        "report": address if report.is_file() else "",
        "command": entry.command,
        "picture": thumbnail(entry.folder / "painting.png", side),
    }


def write_standings_plot(folder: Path, sections: Sequence[Section]) -> Path | None:
    """Plot PSNR against time in ``anytime.png`` for the first four sections in which at least two rows have curves.

    Returns None, and writes no plot, if there is no such section.
    """
    compared = [section for section in sections if section.times][:4]
    if not compared:
        return None
    figure = plotting.new_figure(1.2 * FIGURE_SIZE[1] * len(compared))
    for axes, section in zip(figure.subplots(len(compared), squeeze=False)[:, 0], compared, strict=True):
        _draw_section(axes, section)
    return plotting.save_figure(figure, folder / "anytime.png")


def _draw_section(axes: Axes, section: Section) -> None:
    plotting.tidy(axes)
    rows = [row for row in section.rows if row.curves][: len(COLORS) * len(DASHES)]
    end = max(curve[0][-1] for row in rows for curve in row.curves)
    for k, row in enumerate(rows):
        begin = max(0.05, *(curve[0][0] for curve in row.curves))
        times = np.geomspace(begin, max(end, begin), 80)
        mean, low, high = np.array([interval(row.psnr_at(time)) for time in times]).T
        label = plotting.label_lines(f"{row.label}, {count_of(row.strokes)}", 40)
        axes.plot(times, mean, color=COLORS[k % len(COLORS)], linestyle=DASHES[k // len(COLORS)], label=label)
        if len(row.curves) > 1:
            axes.fill_between(times, low, high, color=COLORS[k % len(COLORS)], alpha=0.06, linewidth=0)
    plotting.fit_scale(axes, "x", [curve[0][-1] for row in rows for curve in row.curves])
    axes.set_title(plotting.without_math(section.title), fontsize=11, loc="left", color=INK)
    axes.set_xlabel("wall time of the optimisation, s; finished paintings stay", fontsize=10)
    axes.set_ylabel(f"mean PSNR, dB, {CONFIDENCE:.0%} interval", fontsize=10)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=9, frameon=False)
