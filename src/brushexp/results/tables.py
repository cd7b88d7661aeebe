"""Write the tables of a sweep: one with a row per run, and one with means over seeds."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from brushexp.reporting.tables import as_text, csv_table, escape_markdown, latex_table, markdown_table
from brushexp.results.provenance import remark_on_provenance
from brushexp.results.quantities import digits, quantities
from brushexp.system.files import write_text
from brushexp.system.status import Status

if TYPE_CHECKING:
    from pandas import DataFrame

LONGEST_ERROR = 200  # maximum number of characters of an error message in table.md


def write_run_tables(folder: Path, frame: DataFrame) -> None:
    """Write ``table.csv`` (all columns in full precision), ``table.md`` and, for papers, ``table.tex``."""
    metrics = frame["metric"].dropna(axis=1, how="all")
    settings = _settings(frame, list(frame["setting"].dropna(axis=1, how="all")), ["run", "status", "error", *metrics])
    every = frame["run"][["status", "error"]].join(settings).join(metrics).rename_axis("run").reset_index()
    write_text(folder / "table.csv", csv_table(every))
    runs, means = runs_table(frame), means_table(frame)
    lines = [] if means is None else ["Mean ± standard deviation over seeds.", "", markdown_table(means), ""]
    lines += [f"{run_count(frame)}.", ""]
    if remark := remark_on_provenance(frame):
        lines += [escape_markdown(remark), ""]
    write_text(folder / "table.md", "\n".join([*lines, markdown_table(runs, digits()), ""]))
    short = runs.drop(columns=["run", "status"]) if means is None else means
    write_text(folder / "table.tex", latex_table(short, digits()))


def runs_table(frame: DataFrame) -> DataFrame:
    """Return a table with one row per run: the settings that vary, the status and the displayed metrics."""
    metrics = shown_metrics(frame)
    settings = _settings(frame, list(varying_settings(frame)), ["run", "status", *metrics]).fillna("")
    errors = (": " + frame["run", "error"]).fillna("").map(lambda text: textwrap.shorten(text, LONGEST_ERROR))
    return settings.assign(status=frame["run", "status"] + errors).join(metrics).rename_axis("run").reset_index()


def means_table(frame: DataFrame) -> DataFrame | None:
    """Return a table of means over seeds (``21.00 ± 1.41``), one row per setting; None if seeds do not vary."""
    keys = list(varying_settings(frame))
    if "seed" not in keys:
        return None
    means = over_seeds(frame)
    texts = as_text(means["mean"].dropna(axis=1, how="all"), digits())
    texts += (" ± " + as_text(means["std"][list(texts)], digits())).where(means["std"].notna(), "")
    settings = _settings(means, [key for key in keys if key != "seed"], ["runs", *texts]).fillna("")
    return settings.assign(runs=means["run", "runs"]).join(texts)


def _settings(frame: DataFrame, keys: list[str], others: Collection[str]) -> DataFrame:
    """Select columns of settings, and rename those that clash with ``others`` to ``override.<name>``."""
    return frame["setting"][keys].rename(columns={key: f"override.{key}" for key in keys if key in others})


def varying_settings(frame: DataFrame) -> dict[str, list[str]]:
    """Map each setting that differs between runs to its values in order of appearance; "" means not set."""
    settings = frame["setting"].fillna("")
    return {key: list(settings[key].unique()) for key in settings if settings[key].nunique() > 1}


def is_album(frame: DataFrame) -> bool:
    """Check whether all runs painted different pictures and share all other settings."""
    return bool(frame["run", "target"].is_unique) and list(varying_settings(frame)) == ["image"]


def numbers(frame: DataFrame) -> DataFrame:
    """Return the displayed metrics, always including ``psnr`` and ``seconds``; missing or infinite numbers are NaN."""
    import pandas as pd  # noqa: PLC0415

    metrics = frame["metric"][[key for key in quantities() if key in frame["metric"]]]
    values = metrics.apply(pd.to_numeric, errors="coerce").astype(float)
    return values.where(values.abs() < math.inf)


def over_seeds(frame: DataFrame) -> DataFrame:
    """Average runs that differ only in their seed; return one row per group, indexed by image and label.

    There are four groups of columns: "run" (``command`` of the first run, and ``runs``, the number of runs), "setting",
    "mean" and "std", the sample standard deviation of each metric (missing for a single run).
    """
    import pandas as pd  # noqa: PLC0415

    compared = frame[frame["run", "label"].notna()]
    keys = [compared["run", "image"].rename("image"), compared["run", "label"].rename("label")]
    groups = numbers(compared).groupby(keys, sort=False)
    runs = compared["run"][["command"]].groupby(keys, sort=False).first().assign(runs=groups.size())
    settings = compared["setting"].groupby(keys, sort=False).first()
    return pd.concat({"run": runs, "setting": settings, "mean": groups.mean(), "std": groups.std()}, axis=1)


def shown_metrics(frame: DataFrame) -> DataFrame:
    """Return the displayed metrics that at least one run has."""
    return frame["metric"][[key for key in quantities() if key in frame["metric"]]].dropna(axis=1, how="all")


def run_count(frame: DataFrame) -> str:
    """Return how many runs there are and how many failed, in words: ``3 runs, 1 failed``."""
    failed = (frame["run", "status"] == Status.FAILED).sum()
    return f"{len(frame)} run{'s' * (len(frame) != 1)}, {failed} failed"
