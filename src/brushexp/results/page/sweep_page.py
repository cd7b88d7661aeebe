"""``report.html`` of a sweep, or of any runs: to sort, to filter, to put side by side, and plots to point at."""

from __future__ import annotations

from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from brushexp.results.anytime_curves import ahead, curve_from, curves_by_image, mean_curves
from brushexp.results.page.html import page
from brushexp.results.page.thumbnails import side_for, thumbnail
from brushexp.results.runs import differences, shortened
from brushexp.results.tables import (
    DIGITS,
    METRICS,
    as_text,
    mean_texts,
    numbers,
    over_seeds,
    run_count,
    shown_metrics,
    varying,
)
from brushexp.system.files import write_text

if TYPE_CHECKING:
    from pandas import DataFrame, Series

COST = "seconds"  # what quality is plotted against
MOST_COLUMNS = 4  # settings with a column each; of more, each run tells those that were set
NOT_SET = "not set"
CURVE_DIGITS = 4  # after the point


def write_sweep_page(folder: Path, frame: DataFrame) -> Path:
    """Write ``report.html`` of some runs, see `brushexp.results.runs`."""
    write_text(folder / "report.html", sweep_page(folder, frame))
    return folder / "report.html"


def sweep_page(folder: Path, frame: DataFrame) -> str:
    """The page about some runs, with their pictures in it.

    A picture has at most 640 pixels on its longer side; the more pictures, the smaller they are, so that all have
    16 million pixels together, which makes 3 to 5 MB.

    Args:
        folder: where the page will lie; the name of a run is its folder as seen from there.
        frame: at least one run.
    """
    shown = page_data(frame)
    mean_axes, means = _means(frame)
    return page(
        "sweep.html.j2",
        title=folder.resolve().name,
        summary=run_count(frame),
        shown=shown,
        mean_axes=mean_axes,
        means=means,
        best=_best(shown),
        plotted=_plotted(shown),
        data=_script_data(shown),
    )


def page_data(frame: DataFrame) -> dict[str, Any]:
    """All that the page shows.

    Returns:
        ``axes``, what varies: key -> value as typed -> value as it is shown; ``same``, settings that all runs share;
        ``metrics``; ``rows``, see `_rows`; ``groups``, runs that differ in the seed alone: ``label``, ``picture``
        (number of what was painted: numbers of two are never compared) and ``ahead_from`` (seconds from which on it was
        ahead of the others for the last time; None if it never was); ``pictures``, names of what was painted;
        ``targets``, each with ``name`` and ``picture``; ``side``, largest of a picture in pixels; ``filters``, what
        runs can be chosen by: the axes, and how they ended if that differs; ``in_columns``, whether each axis has a
        column of its own.
    """
    typed = varying(frame)
    axes = {key: {v: name or NOT_SET for v, name in shortened(values).items()} for key, values in typed.items()}
    settings = frame["setting"].fillna("")
    same = {key: value for key, value in settings.iloc[0].items() if key not in typed and value}
    targets = {run["target"]: run for _, run in frame["run"].iterrows() if (run["folder"] / "target.png").is_file()}
    side = side_for(int(frame["run", "picture"].notna().sum()) + len(targets))
    groups, pictures = _groups(frame)
    names = {run["target"]: run["image"] for _, run in frame["run"].dropna(subset=["image"]).iterrows()}
    ends = {status: status for status in frame["run", "status"]}
    shown = {
        "axes": axes,
        "same": same,
        "metrics": [{"key": key, **vars(METRICS[key])} for key in shown_metrics(frame)],
        "groups": groups,
        "pictures": pictures,
        "targets": [
            {
                "name": f"target: {names[key]}" if names.get(key) else "target",
                "picture": thumbnail(run["folder"] / "target.png", side),
            }
            for key, run in targets.items()
        ],
        "side": side,
        "filters": axes | ({"status": ends} if len(ends) > 1 else {}),
        "in_columns": len(axes) <= MOST_COLUMNS,
    }
    numbered = {(pictures[group["picture"]], group["label"]): k for k, group in enumerate(groups)}
    return shown | {"rows": _rows(frame, list(axes), list(targets), numbered, side)}


def _rows(
    frame: DataFrame, axes: list[str], targets: list[str], groups: dict[tuple[str, str], int], side: int
) -> list[dict[str, Any]]:
    """The runs.

    Returns:
        of each ``name``, its number or the end of the path to it; ``parts``, the overrides by which it differs from
        the others, and ``label``, these on one line; ``chosen``, its values of the axes; ``cells``, each metric as
        text, and ``numbers``; ``target`` and ``group``, their numbers on the page or None; and what `_row` tells.
    """
    settings, texts, values = frame["setting"].fillna(""), as_text(shown_metrics(frame), DIGITS), numbers(frame)
    called = shortened([PurePath(name).as_posix() for name in frame.index])
    parts = differences(list(frame["run", "overrides"]))
    return [
        _row(name, run, side)
        | {
            "name": called[PurePath(name).as_posix()],
            "label": " ".join(part) or "default",
            "parts": part,
            "chosen": {key: settings.loc[name, key] for key in axes},
            "cells": texts.loc[name].to_dict(),
            "numbers": values.loc[name].dropna().to_dict(),
            "target": targets.index(run["target"]) if run["target"] in targets else None,
            "group": groups.get((run["image"], run["label"])),
        }
        for (name, run), part in zip(frame["run"].iterrows(), parts, strict=True)
    ]


def _row(name: str, run: Series, side: int) -> dict[str, Any]:
    """What a run tells without the others.

    Returns:
        ``status``; ``error``, why it failed, or ""; ``command``, which repeats it; ``report``, address of its own page,
        quoted, so that it is no address of another kind, or ""; ``picture``; ``curve``, pairs of seconds and PSNR.
    """
    address = PurePath(name) / "report.html"
    curve = curve_from(run["anytime"]) or ()
    return {
        "status": run["status"],
        "error": run["error"] if run["status"] == "failed" else "",
        "command": run["command"],
        "report": quote(address.as_posix(), errors="surrogateescape")
        if (run["folder"] / "report.html").is_file()
        else "",
        "picture": thumbnail(run["picture"], side) if run["picture"] else None,
        "curve": [[round(float(value), CURVE_DIGITS) for value in pair] for pair in zip(*curve, strict=True)],
    }


def _groups(frame: DataFrame) -> tuple[list[dict[str, Any]], list[str]]:
    """The settings that are compared, and names of what was painted."""
    keys = list(over_seeds(frame).index)
    pictures = list(dict.fromkeys(image for image, _ in keys))
    means = {image: mean_curves(curves) for image, curves in curves_by_image(frame).items()}
    last = {image: {label: time for time, label in ahead(curves)} for image, curves in means.items() if curves}
    groups = [
        {"label": label, "picture": pictures.index(image), "ahead_from": last.get(image, {}).get(label)}
        for image, label in keys
    ]
    return groups, pictures


def _means(frame: DataFrame) -> tuple[list[str], list[dict[str, Any]]]:
    """Means over seeds, nothing if these do not vary: heads of the settings, and a row for each of them.

    A row has ``chosen``, the values of the settings (of more than four, one text of those that are set), ``runs``, how
    many, and of each metric ``cells``, mean and standard deviation as text, and ``numbers``, the mean.
    """
    typed = varying(frame)
    if "seed" not in typed:
        return [], []
    words = {key: shortened(values) for key, values in typed.items() if key != "seed"}
    means = over_seeds(frame)
    rows = []
    for key, texts in mean_texts(means).iterrows():
        setting = means["setting"].loc[key].fillna("")
        chosen = {axis: names[setting[axis]] for axis, names in words.items()}
        together = " ".join(f"{axis}={value}" for axis, value in chosen.items() if value) or "default"
        rows.append(
            {
                "chosen": [v or NOT_SET for v in chosen.values()] if len(words) <= MOST_COLUMNS else [together],
                "runs": means.loc[key, ("run", "runs")],
                "cells": texts.to_dict(),
                "numbers": means["mean"].loc[key].dropna().to_dict(),
            }
        )
    return (list(words) if len(words) <= MOST_COLUMNS else ["settings"]), rows


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
    """What the plots begin with.

    Returns:
        ``x`` (metric, or a setting as ``axis:steps``) and ``y`` (metric) of the points, both "" if there are no two to
        compare; ``xs``, all that can be chosen for ``x``, with names; ``front``, whether quality is plotted against
        cost; ``curves``, whether there are curves.
    """
    rows = [row for row in shown["rows"] if row["group"] is not None]
    names = {
        metric["key"]: metric["name"]
        for metric in shown["metrics"]
        if len({row["group"] for row in rows if metric["key"] in row["numbers"]}) > 1
    }
    axes = sorted((key for key in shown["axes"] if key != "seed"), key=lambda key: -len(shown["axes"][key]))
    y = next((key for key in names if METRICS[key].better and key != COST), "")
    front = bool(y) and COST in names
    x = COST if front else f"axis:{axes[0]}" if y and axes else ""
    return {
        "x": x,
        "y": y if x else "",
        "xs": names | {f"axis:{key}": key for key in axes},
        "front": front,
        "curves": any(row["curve"] for row in shown["rows"]),
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
