"""Write ``report.html`` for a sweep or any set of runs, with pictures, plots and a sortable, filterable table."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from brushexp.errors import UserError
from brushexp.pages.html import embed, page
from brushexp.pictures.decode import open_picture
from brushexp.reporting.tables import as_text
from brushexp.results import tables
from brushexp.results.anytime_curves import curve_from, curves_by_image, leaders, mean_curves
from brushexp.results.comparisons import comparisons
from brushexp.results.provenance import remark_on_provenance
from brushexp.results.quantities import digits, quantities
from brushexp.results.runs import differences, shorten
from brushexp.system.files import write_text
from brushexp.system.status import Status

if TYPE_CHECKING:
    from pandas import DataFrame

COST = "seconds"  # metric against which quality is plotted
MOST_COLUMNS = 4  # largest number of settings with columns of their own; more settings share one column
CURVE_DIGITS = 4  # decimals
AREA = 16_000_000  # pixels of all pictures on a page together
SIDES = (640, 452, 320, 226, 160, 113, 80)  # pixels, each with half the area of the previous one
MOST_THUMBNAILS = 4096  # pictures in memory, more than a page holds at the smallest side


def write_sweep_page(folder: Path, frame: DataFrame) -> Path:
    """Write ``report.html`` for a data frame of runs (`brushexp.results.runs`), and return its path."""
    write_text(folder / "report.html", sweep_page(folder, frame))
    return folder / "report.html"


def sweep_page(folder: Path, frame: DataFrame) -> str:
    """Build a page, with embedded pictures, that shows one or more runs; its title is the name of ``folder``."""
    data = _page_data(frame)
    return page(
        "sweep.html.j2",
        title=folder.resolve().name,
        summary=_summary(frame),
        remark=remark_on_provenance(frame),
        shown=data,
        metrics=quantities(),
        means=_means(frame),
        tables=[table for comparison in comparisons() if (table := comparison.table(frame))],
        best=_best(data),
        plotted=_choose_plot(data),
        data=_script_data(data),
    )


def _summary(frame: DataFrame) -> str:
    """State the number of runs (or of paintings, if only the picture varies) and how many of them failed."""
    if not tables.is_album(frame):
        return tables.run_count(frame)
    failed = int((frame["run", "status"] == Status.FAILED).sum())
    count = len(frame) - failed
    return f"{count} painting{'s' * (count != 1)}" + (f"; {failed} failed" if failed else "")


def _page_data(frame: DataFrame) -> dict[str, Any]:
    """Collect the data for the page; ``axes`` maps each varying setting's key to its typed and displayed values."""
    typed = tables.varying_settings(frame)
    axes = {key: {v: name or "not set" for v, name in shorten(values).items()} for key, values in typed.items()}
    settings = frame["setting"].fillna("").iloc[0]
    targets = {run["target"]: run["folder"] / "target.png" for _, run in frame["run"].iterrows()}
    targets = {key: path for key, path in targets.items() if path.is_file()}
    side = side_for(int(frame["run", "picture"].notna().sum()) + len(targets))
    groups, pictures = _groups(frame)
    numbered = {(pictures[group["picture"]], group["label"]): k for k, group in enumerate(groups)}
    rows = _rows(frame, list(targets), numbered, side)
    names = frame["run"].dropna(subset=["image"]).set_index("target")["image"].to_dict()
    ends = {status: status for status in frame["run", "status"]}
    metrics = {key: quantities()[key] for key in tables.shown_metrics(frame)}
    return {
        "axes": axes,
        "same": {key: value for key, value in settings.items() if key not in typed and value},
        "metrics": [
            {"key": key, "name": one.name, "digits": one.digits, "better": one.better} for key, one in metrics.items()
        ],
        "album": tables.is_album(frame),
        "groups": groups,
        "pictures": pictures,
        "targets": [
            {"name": f"target: {names[key]}" if names.get(key) else "target", "picture": thumbnail(path, side)}
            for key, path in targets.items()
        ],
        "filters": axes | ({"status": ends} if len(ends) > 1 else {}),
        "in_columns": len(axes) <= MOST_COLUMNS,
        "rows": rows,
        "pictured": any(row["picture"] for row in rows),
    }


def _rows(frame: DataFrame, targets: list[str], groups: dict[tuple[str, str], int], side: int) -> list[dict[str, Any]]:
    """List the runs; ``target`` and ``group`` are indices, and ``curve`` is a list of pairs of seconds and PSNR."""
    settings, values = frame["setting"].fillna(""), tables.numbers(frame)
    texts = as_text(tables.shown_metrics(frame), digits())
    paths = [PurePath(name).as_posix() for name in frame.index]
    names, labels, rows = shorten(paths), differences(list(frame["run", "overrides"])), []
    for path, (name, run), parts in zip(paths, frame["run"].iterrows(), labels, strict=True):
        report = quote(f"{path}/report.html", errors="surrogateescape")
        curve = curve_from(run["anytime"]) or ()
        row = {"name": names[path], "label": " ".join(parts) or "default", "parts": parts, "command": run["command"]}
        row |= {"chosen": settings.loc[name].to_dict(), "cells": texts.loc[name].to_dict()}
        row |= {"numbers": values.loc[name].dropna().to_dict(), "group": groups.get((run["image"], run["label"]))}
        row["target"] = targets.index(run["target"]) if run["target"] in targets else None
        row |= {"status": run["status"], "error": run["error"] if run["status"] == Status.FAILED else ""}
        row["report"] = report if (run["folder"] / "report.html").is_file() else ""
        row["picture"] = thumbnail(run["picture"], side) if run["picture"] else None
        row["curve"] = [[round(float(value), CURVE_DIGITS) for value in pair] for pair in zip(*curve, strict=True)]
        rows.append(row)
    return rows


def _groups(frame: DataFrame) -> tuple[list[dict[str, Any]], list[str]]:
    """List the compared settings and the names of the painted pictures.

    Each setting has the index of its ``picture``, and ``ahead_from``: the time, in seconds, at which the setting last
    took the lead, or None if it never led.
    """
    keys = list(tables.over_seeds(frame).index)
    pictures = list(dict.fromkeys(image for image, _ in keys))
    means = {image: mean_curves(curves) for image, curves in curves_by_image(frame).items()}
    last = {image: {label: time for time, label in leaders(curves)} for image, curves in means.items() if curves}
    groups = [
        {"label": label, "picture": pictures.index(image), "ahead_from": last.get(image, {}).get(label)}
        for image, label in keys
    ]
    return groups, pictures


def _means(frame: DataFrame) -> DataFrame | None:
    """Tabulate means over seeds; if more than ``MOST_COLUMNS`` settings vary, combine them in a single column."""
    means = tables.means_table(frame)
    if means is None:
        return None
    keys = list(means)[: list(means).index("runs")]
    if len(keys) > MOST_COLUMNS:
        means.insert(0, "settings", means.index.get_level_values("label"))
        return means.drop(columns=keys)
    for key in keys:
        means[key] = means[key].map(shorten(list(means[key].unique())))
    return means


def _best(data: dict[str, Any]) -> dict[str, str]:
    """Find the best value of each metric that varies; the result is empty if several pictures were painted."""
    best = {}
    for metric in data["metrics"] if len(data["pictures"]) <= 1 else ():
        key = metric["key"]
        values = {row["numbers"][key]: row["cells"][key] for row in data["rows"] if key in row["numbers"]}
        if metric["better"] and len(values) > 1:
            best[key] = values[max(values) if metric["better"] == "higher" else min(values)]
    return best


def _choose_plot(data: dict[str, Any]) -> dict[str, Any]:
    """Choose the plot shown first: ``x`` is a metric or a setting (``axis:steps``), and ``y`` is a metric.

    ``x`` and ``y`` are "" if there is nothing to plot. ``xs`` maps the choices for ``x`` to their names.
    """
    rows = [row for row in data["rows"] if row["group"] is not None and not data["album"]]
    names = {
        metric["key"]: metric["name"]
        for metric in data["metrics"]
        if len({row["group"] for row in rows if metric["key"] in row["numbers"]}) > 1
    }
    axes = sorted((key for key in data["axes"] if key != "seed"), key=lambda key: -len(data["axes"][key]))
    y = next((key for key in names if quantities()[key].better and key != COST), "")
    front = bool(y) and COST in names
    x = COST if front else f"axis:{axes[0]}" if y and axes else ""
    return {
        "x": x,
        "y": y if x else "",
        "xs": names | {f"axis:{key}": key for key in axes},
        "front": front,
        "curves": any(row["curve"] for row in rows),
    }


def _script_data(data: dict[str, Any]) -> dict[str, Any]:
    """Select the data for the page's scripts, with setting values replaced by their indices."""
    filters = data["filters"]
    keys = ("name", "label", "error", "cells", "numbers", "command", "report", "target", "group", "curve")
    return {
        "axes": [{"key": key, "values": list(words), "shown": list(words.values())} for key, words in filters.items()],
        **{key: data[key] for key in ("metrics", "groups", "pictures")},
        "rows": [
            {key: row[key] for key in keys}
            | {"chosen": [list(words).index(row["chosen"].get(key, row["status"])) for key, words in filters.items()]}
            for row in data["rows"]
        ],
    }


def side_for(count: int) -> int:
    """Return the largest side in ``SIDES`` at which ``count`` pictures fit in ``AREA``, or the smallest side."""
    return next((side for side in SIDES if count * side**2 <= AREA), SIDES[-1])


def thumbnail(path: Path, side: int) -> dict[str, Any] | None:
    """Embed a picture shrunk to ``side`` pixels; cache the result, and return None if the picture is unreadable."""
    try:
        state = path.stat()
        return _thumbnail(path.resolve(), state.st_mtime_ns, state.st_size, side)
    except (UserError, OSError):
        return None


@lru_cache(MOST_THUMBNAILS)
def _thumbnail(path: Path, changed: int, size: int, side: int) -> dict[str, Any]:
    with open_picture(path) as picture:  # WebP method 2 takes half the time of method 4 for a twentieth more bytes
        return embed(picture.convert("RGB"), side, format="WEBP", quality=80, method=2)
