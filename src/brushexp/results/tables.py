"""Tables as CSV, Markdown and LaTeX: one way to write any of them."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from brushexp.system.files import write_text

if TYPE_CHECKING:
    from pandas import DataFrame

    # A row per element, a column per key, or a data frame, whose index is not shown.
    Rows: TypeAlias = DataFrame | Sequence[Mapping[str, Any]] | Mapping[str, Sequence[Any]]

MISSING = "–"  # in place of a number that is not known
NUMBER = re.compile(rf"([-+]?\d[\d.,e+-]*( ± [\d.e+-]+)?|-?inf|{MISSING}|)")  # and what stands in place of one
LONGEST_ERROR = 200  # letters of an error message in table.md


@dataclass(frozen=True)
class Metric:
    """How a metric is shown: its name for people, digits after the point, and which is better ("" for neither).

    Differences up to ``matters`` are none to speak of; those of a ``ratio`` are of its logarithm.
    """

    name: str
    digits: int
    better: str
    matters: float = 0.0
    ratio: bool = False


METRICS = {  # those that tables and plots show, in this order, if some run has them
    "psnr": Metric("PSNR, dB", 2, "higher", 0.1),
    "ssim": Metric("SSIM", 4, "higher", 0.003),
    "l1": Metric("L1", 4, "lower", 0.0005),
    "edges": Metric("error of edges", 4, "lower", 0.0005),
    "perceptual": Metric("perceptual distance", 4, "lower", 0.005),
    "lpips_alexnet": Metric("LPIPS (AlexNet)", 4, "lower", 0.005),
    "lpips_squeeze": Metric("LPIPS (SqueezeNet)", 4, "lower", 0.005),
    "lpips_vgg16": Metric("LPIPS (VGG16)", 4, "lower", 0.005),
    **{f"style_{kind}": Metric(f"style {kind}", 4, "lower") for kind in ("poly", "linear", "gaussian", "meanstd")},
    "accuracy": Metric("accuracy", 4, "higher"),
    "auc": Metric("AUC", 4, "higher"),
    "l2": Metric("L2", 6, "lower", 0.05, ratio=True),
    "psnr_alpha": Metric("PSNR of alpha, dB", 2, "higher", 0.1),
    "psnr_color": Metric("PSNR of colour, dB", 2, "higher", 0.1),
    "bristles_thick": Metric("bristle energy, thick", 3, ""),
    "bristles_thin": Metric("bristle energy, thin", 3, ""),
    "light_thick": Metric("energy of light, thick", 3, ""),
    "fid_effl0": Metric("FID (effl0)", 2, "lower", 0.05, ratio=True),
    "kid_effl0": Metric("KID (effl0)", 2, "lower", 0.05, ratio=True),
    "fid_inception": Metric("FID (Inception)", 2, "lower", 0.05, ratio=True),
    "strokes_per_second": Metric("strokes per second", 0, "higher", 0.05, ratio=True),
    "strokes_per_second_backward": Metric("strokes per second backward", 0, "higher", 0.05, ratio=True),
    "parameters": Metric("parameters", 0, ""),
    "file_mb": Metric("file, MB", 2, ""),
    "seconds": Metric("optimisation, s", 1, "lower", 0.1, ratio=True),
    "cpu_seconds": Metric("CPU, s", 1, "lower", 0.1, ratio=True),
    "n_strokes": Metric("strokes painted", 0, ""),
}
DIGITS = {key: metric.digits for key, metric in METRICS.items()}


def write_run_tables(folder: Path, frame: DataFrame) -> None:
    """Write ``table.csv`` (every column in full precision), ``table.md`` and, for papers, ``table.tex``."""
    runs, means = runs_table(frame), means_table(frame)
    told = [] if means is None else ["Mean ± standard deviation over seeds.", "", markdown_table(means), ""]
    write_text(folder / "table.csv", csv_table(everything(frame)))
    write_text(folder / "table.md", "\n".join([*told, f"{run_count(frame)}.", "", markdown_table(runs, DIGITS), ""]))
    short = runs.drop(columns=["run", "status"]) if means is None else means
    write_text(folder / "table.tex", latex_table(short, DIGITS))


def everything(frame: DataFrame) -> DataFrame:
    """A row per run, with a column per setting and metric."""
    metrics = frame["metric"].dropna(axis=1, how="all")
    settings = _settings(frame, list(frame["setting"].dropna(axis=1, how="all")), ["run", "status", "error", *metrics])
    return frame["run"][["status", "error"]].join(settings).join(metrics).rename_axis("run").reset_index()


def runs_table(frame: DataFrame) -> DataFrame:
    """A row per run: the settings that vary, how it ended, and the metrics that are shown."""
    metrics = shown_metrics(frame)
    settings = _settings(frame, list(varying(frame)), ["run", "status", *metrics]).fillna("")
    errors = (": " + frame["run", "error"]).fillna("").map(lambda text: textwrap.shorten(text, LONGEST_ERROR))
    return settings.assign(status=frame["run", "status"] + errors).join(metrics).rename_axis("run").reset_index()


def means_table(frame: DataFrame) -> DataFrame | None:
    """A row per setting with means over seeds, ``21.00 ± 1.41`` where there are several; None if seeds do not vary."""
    keys = list(varying(frame))
    if "seed" not in keys:
        return None
    means = over_seeds(frame)
    texts = as_text(means["mean"].dropna(axis=1, how="all"), DIGITS)
    texts += (" ± " + as_text(means["std"][list(texts)], DIGITS)).where(means["std"].notna(), "")
    settings = _settings(means, [key for key in keys if key != "seed"], ["runs", *texts]).fillna("")
    return settings.assign(runs=means["run", "runs"]).join(texts)


def _settings(frame: DataFrame, keys: list[str], taken: Collection[str]) -> DataFrame:
    """These settings; one whose name is taken by another column is called ``override.<name>``."""
    return frame["setting"][keys].rename(columns={key: f"override.{key}" for key in keys if key in taken})


def varying(frame: DataFrame) -> dict[str, list[str]]:
    """The settings in which runs differ, and the values of each in order of first appearance; "" where not set."""
    settings = frame["setting"].fillna("")
    return {key: list(settings[key].unique()) for key in settings if settings[key].nunique() > 1}


def is_album(frame: DataFrame) -> bool:
    """Whether each of several runs has painted a picture of its own by the same settings: nothing is to be compared."""
    return bool(frame["run", "target"].is_unique) and list(varying(frame)) == ["image"]


def numbers(frame: DataFrame) -> DataFrame:
    """The finite numbers among the metrics that are shown; ``psnr`` and ``seconds`` at least."""
    import pandas as pd  # noqa: PLC0415

    metrics = frame["metric"][[key for key in METRICS if key in frame["metric"]]]
    found = metrics.apply(pd.to_numeric, errors="coerce").astype(float)
    return found.where(found.abs() < math.inf)


def over_seeds(frame: DataFrame) -> DataFrame:
    """Means of the runs that are compared and differ in the seed alone: a row per setting, by image and label.

    Columns are in four parts: "run" (``command`` of the first, and ``runs``, how many), "setting", "mean" and "std" (of
    a sample; missing for a single run) of each metric.
    """
    import pandas as pd  # noqa: PLC0415

    compared = frame[frame["run", "label"].notna()]
    keys = [compared["run", "image"].rename("image"), compared["run", "label"].rename("label")]
    found = numbers(compared).groupby(keys, sort=False)
    told = compared["run"][["command"]].groupby(keys, sort=False).first().assign(runs=found.size())
    settings = compared["setting"].groupby(keys, sort=False).first()
    return pd.concat({"run": told, "setting": settings, "mean": found.mean(), "std": found.std()}, axis=1)


def shown_metrics(frame: DataFrame) -> DataFrame:
    """The columns of those metrics that are shown and that some run has."""
    return frame["metric"][[key for key in METRICS if key in frame["metric"]]].dropna(axis=1, how="all")


def run_count(frame: DataFrame) -> str:
    """How many runs there are, and how many of them failed."""
    failed = (frame["run", "status"] == "failed").sum()
    return f"{len(frame)} run{'s' * (len(frame) != 1)}, {failed} failed"


def csv_table(rows: Rows, significant: int | None = None) -> str:
    """A table as CSV: what is missing is empty, and finite floats have so many digits, None for full precision."""
    frame = _frame(rows)
    if significant is not None:
        frame = frame.map(lambda x: f"{x:.{significant}g}" if isinstance(x, float) and math.isfinite(x) else x)
    return str(frame.to_csv(index=False, lineterminator="\n"))


def markdown_table(
    rows: Rows, digits: Mapping[str, int] | None = None, align: str | None = None, *, escape: bool = True
) -> str:
    """A table as Markdown, without a line break at its end.

    ``digits`` are those after the point of numbers by column; the other values are shown as they are. ``align`` is "l"
    or "r" for each column, as in LaTeX; None sets columns of numbers on the right. With ``escape`` every letter is
    shown as it is, also those that mean something to Markdown.
    """
    shown = as_text(_frame(rows), digits or {})
    quoted = escaped if escape else str
    rules = ["---:" if side == "r" else "---" for side in align or _alignment(shown)]
    lines = [map(quoted, shown), rules, *(map(quoted, line) for line in shown.to_numpy())]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def latex_table(rows: Rows, digits: Mapping[str, int] | None = None) -> str:
    """A table as LaTeX, with the rules of the package booktabs; arguments as of `markdown_table`."""
    shown = as_text(_frame(rows), digits or {})
    text = str(shown.to_latex(index=False, escape=True, column_format=_alignment(shown)))
    return text.replace("±", r"$\pm$").replace(MISSING, "--")


def as_text(frame: DataFrame, digits: Mapping[str, int]) -> DataFrame:
    """Every cell as it is shown: numbers with the digits of their column."""
    return frame.apply(lambda column: column.map(lambda value: _shown(value, digits.get(column.name))))


def _frame(rows: Rows) -> DataFrame:
    import pandas as pd  # noqa: PLC0415

    return pd.DataFrame(rows, dtype=object)


def _shown(value: Any, digits: int | None) -> str:
    if value is None or value != value:  # noqa: PLR0124 (not a number)
        return MISSING
    return f"{value:.{digits}f}" if digits is not None and isinstance(value, Real) else str(value)


def _alignment(shown: DataFrame) -> str:
    """Columns of numbers stand on the right: ``"lrr"``."""
    return "".join("r" if all(map(NUMBER.fullmatch, column)) and any(column) else "l" for _, column in shown.items())


def escaped(text: str) -> str:
    r"""Markdown that shows exactly this text: ``a|b_c`` becomes ``a\|b\_c``."""
    return re.sub(r"([\\`*_\[\]<>|~$&])", r"\\\1", " ".join(text.split()))
