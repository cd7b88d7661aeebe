"""``report.html`` of a sweep, or of any runs: to sort, to filter, to put side by side, and plots to point at."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from brushexp.errors import UserError
from brushexp.pages.html import embedded, page
from brushexp.pictures.decode import open_picture
from brushexp.reporting.tables import as_text
from brushexp.results import tables
from brushexp.results.anytime_curves import ahead, curve_from, curves_by_image, mean_curves
from brushexp.results.paired import difference_rows, paired_differences, paired_table, told_of
from brushexp.results.quantities import digits, quantities
from brushexp.results.runs import differences, shortened
from brushexp.system.files import write_text

if TYPE_CHECKING:
    from pandas import DataFrame

COST = "seconds"  # what quality is plotted against
MOST_COLUMNS = 4  # settings with a column each; of more, each run tells those that were set
NOT_SET = "not set"
CURVE_DIGITS = 4  # after the point
AREA = 16_000_000  # pixels: of all pictures of a page together
SIDES = (640, 452, 320, 226, 160, 113, 80)  # pixels: each half the area of the one before
QUALITY = 80  # of WebP
KEPT = 4096  # pictures: more than a page holds at its smallest side, so memory stays below some pages


def write_sweep_page(folder: Path, frame: DataFrame) -> Path:
    """Write ``report.html`` of some runs, see `brushexp.results.runs`."""
    write_text(folder / "report.html", sweep_page(folder, frame))
    return folder / "report.html"


def sweep_page(folder: Path, frame: DataFrame) -> str:
    """The page about at least one run, with their pictures in it; names of runs are folders as seen from ``folder``.

    The more pictures, the smaller they are, so that all have 16 million pixels together, which makes 3 to 5 MB.
    """
    shown = _page_data(frame)
    return page(
        "sweep.html.j2",
        title=folder.resolve().name,
        summary=tables.run_count(frame),
        shown=shown,
        metrics=quantities(),
        means=_means(frame),
        paired=_paired(frame),
        best=_best(shown),
        plotted=_plotted(shown),
        data=_script_data(shown),
    )


def _page_data(frame: DataFrame) -> dict[str, Any]:
    """All that the page shows; ``axes`` is what varies: key -> value as typed -> value as it is shown.

    Of an ``album`` paintings come first and targets last, and nothing is plotted.
    """
    typed = tables.varying(frame)
    axes = {key: {v: name or NOT_SET for v, name in shortened(values).items()} for key, values in typed.items()}
    settings = frame["setting"].fillna("").iloc[0]
    targets = {run["target"]: run["folder"] / "target.png" for _, run in frame["run"].iterrows()}
    targets = {key: path for key, path in targets.items() if path.is_file()}
    side = side_for(int(frame["run", "picture"].notna().sum()) + len(targets))
    groups, pictures = _groups(frame)
    numbered = {(pictures[group["picture"]], group["label"]): k for k, group in enumerate(groups)}
    names = frame["run"].dropna(subset=["image"]).set_index("target")["image"].to_dict()
    ends = {status: status for status in frame["run", "status"]}
    return {
        "axes": axes,
        "same": {key: value for key, value in settings.items() if key not in typed and value},
        "metrics": [
            {"key": key, "name": shown.name, "digits": shown.digits, "better": shown.better}
            for key, shown in quantities().items()
            if key in tables.shown_metrics(frame)
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
        "rows": _rows(frame, list(targets), numbered, side),
    }


def _rows(frame: DataFrame, targets: list[str], groups: dict[tuple[str, str], int], side: int) -> list[dict[str, Any]]:
    """The runs; ``target`` and ``group`` are their numbers on the page, ``curve`` pairs of seconds and PSNR.

    ``report``, the address of a run's own page, is quoted, so that it is no address of another kind.
    """
    settings, values = frame["setting"].fillna(""), tables.numbers(frame)
    texts = as_text(tables.shown_metrics(frame), digits())
    called = shortened([PurePath(name).as_posix() for name in frame.index])
    rows = []
    for (name, run), parts in zip(frame["run"].iterrows(), differences(list(frame["run", "overrides"])), strict=True):
        report = quote((PurePath(name) / "report.html").as_posix(), errors="surrogateescape")
        curve = curve_from(run["anytime"]) or ()
        rows.append(
            {
                "name": called[PurePath(name).as_posix()],
                "label": " ".join(parts) or "default",
                "parts": parts,
                "chosen": settings.loc[name].to_dict(),
                "cells": texts.loc[name].to_dict(),
                "numbers": values.loc[name].dropna().to_dict(),
                "target": targets.index(run["target"]) if run["target"] in targets else None,
                "group": groups.get((run["image"], run["label"])),
                "status": run["status"],
                "error": run["error"] if run["status"] == "failed" else "",
                "command": run["command"],
                "report": report if (run["folder"] / "report.html").is_file() else "",
                "picture": thumbnail(run["picture"], side) if run["picture"] else None,
                "curve": [[round(float(value), CURVE_DIGITS) for value in pair] for pair in zip(*curve, strict=True)],
            }
        )
    return rows


def _groups(frame: DataFrame) -> tuple[list[dict[str, Any]], list[str]]:
    """The settings that are compared, runs that differ in the seed alone, and names of what was painted.

    ``picture`` is the number of what was painted (numbers of two are never compared), and ``ahead_from`` the seconds
    from which on a setting was ahead of the others for the last time, None if it never was.
    """
    keys = list(tables.over_seeds(frame).index)
    pictures = list(dict.fromkeys(image for image, _ in keys))
    means = {image: mean_curves(curves) for image, curves in curves_by_image(frame).items()}
    last = {image: {label: time for time, label in ahead(curves)} for image, curves in means.items() if curves}
    groups = [
        {"label": label, "picture": pictures.index(image), "ahead_from": last.get(image, {}).get(label)}
        for image, label in keys
    ]
    return groups, pictures


def _means(frame: DataFrame) -> DataFrame | None:
    """Means over seeds; with many settings, one column says what was set."""
    means = tables.means_table(frame)
    if means is None:
        return None
    keys = list(means)[: list(means).index("runs")]
    if len(keys) > MOST_COLUMNS:
        means.insert(0, "settings", means.index.get_level_values("label"))
        return means.drop(columns=keys)
    for key in keys:
        means[key] = means[key].map(shortened(list(means[key].unique())))
    return means


def _paired(frame: DataFrame) -> dict[str, Any] | None:
    """Differences to the first setting by picture or seed; None if nothing is paired."""
    paired = paired_differences(paired_table(frame))
    if not paired:
        return None
    return {"told": told_of(paired).replace("*", "").replace("`", ""), "rows": difference_rows(paired)}


def _best(shown: dict[str, Any]) -> dict[str, str]:
    """How the best number of each metric is written; nothing where several pictures were painted."""
    found = {}
    for metric in shown["metrics"] if len(shown["pictures"]) <= 1 else ():
        key = metric["key"]
        values = {row["numbers"][key]: row["cells"][key] for row in shown["rows"] if key in row["numbers"]}
        if metric["better"] and len(values) > 1:
            found[key] = values[max(values) if metric["better"] == "higher" else min(values)]
    return found


def _plotted(shown: dict[str, Any]) -> dict[str, Any]:
    """What the plots begin with: ``x`` (a metric, or a setting as ``axis:steps``) and ``y`` (a metric) of the points.

    Both are "" if there are no two to compare; ``xs`` is all that can be chosen for ``x``, with names.
    """
    rows = [row for row in shown["rows"] if row["group"] is not None and not shown["album"]]
    names = {
        metric["key"]: metric["name"]
        for metric in shown["metrics"]
        if len({row["group"] for row in rows if metric["key"] in row["numbers"]}) > 1
    }
    axes = sorted((key for key in shown["axes"] if key != "seed"), key=lambda key: -len(shown["axes"][key]))
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


def _script_data(shown: dict[str, Any]) -> dict[str, Any]:
    """What the scripts of the page know beside what they see in it: the same, with the number of each value chosen."""
    filters = shown["filters"]
    keys = ("name", "label", "error", "cells", "numbers", "command", "report", "target", "group", "curve")
    return {
        "axes": [{"key": key, "values": list(words), "shown": list(words.values())} for key, words in filters.items()],
        **{key: shown[key] for key in ("metrics", "groups", "pictures")},
        "rows": [
            {key: row[key] for key in keys}
            | {"chosen": [list(words).index(row["chosen"].get(key, row["status"])) for key, words in filters.items()]}
            for row in shown["rows"]
        ],
    }


def side_for(count: int) -> int:
    """Longer side in pixels of each of so many pictures: the largest with which all of them keep to ``AREA``."""
    return next((side for side in SIDES if count * side**2 <= AREA), SIDES[-1])


def thumbnail(path: Path, side: int) -> dict[str, Any] | None:
    """A picture no larger than this, encoded once in the life of a process; None if it cannot be read."""
    try:
        found = path.stat()
        return _encoded(path.resolve(), found.st_mtime_ns, found.st_size, side)
    except (UserError, OSError):
        return None


@lru_cache(KEPT)
def _encoded(path: Path, changed: int, size: int, side: int) -> dict[str, Any]:
    """The same; ``changed`` and ``size`` tell one state of the file from another."""
    with open_picture(path) as opened:  # WebP of method 2: half the time of 4, a twentieth more bytes
        return embedded(opened.convert("RGB"), side, format="WEBP", quality=QUALITY, method=2)
