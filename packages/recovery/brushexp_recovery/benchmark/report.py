"""Write the benchmark report as files with tables, plots and examples."""

from collections.abc import Sequence
from pathlib import Path

from brushexp.contracts.files import write_json, write_text
from brushexp.contracts.results import csv_table, latex_table, markdown_table
from brushexp_recovery.benchmark.plots import draw_examples, plot_reliability, plot_scores
from brushexp_recovery.benchmark.report_tables import (
    Row,
    confidence_table,
    error_table,
    f1_table,
    interval_table,
    kind_table,
    reliability_of,
)

PAINTINGS = "paintings"  # name of the folder with pictures, their truth and recovered regions
ABOUT_F1 = (
    "Mean F1 at an intersection over union of 0.5. Seen kinds occur in training with other subjects and seeds; "
    "unseen kinds are other brushes and other painters' strokes. Clean is the painting, hard a photograph of it."
)
ABOUT_KINDS = "Mean F1 by kind and number of strokes, clean."
ABOUT_INTERVALS = "Mean F1 of the paintings of each kind, and 95 % intervals over paintings (bootstrap)."
ABOUT_ERRORS = (
    "Means over clean paintings. Errors are medians over matched strokes, relative for length and width; order is the "
    "share of matched, overlapping pairs in the right order; fields are errors of neighbourhoods, matched or not."
)
ABOUT_CONFIDENCE = (
    "Confidence of recovery over all strokes of a group of paintings, because the expected calibration "
    "error (ECE) of few strokes is large even if the confidence is right."
)


def write_figures(folder: Path, rows: Sequence[Row]) -> None:
    """Write ``figures.csv`` with a row for each picture and method."""
    plain = [{key: value for key, value in row.items() if key != "reliability"} for row in rows]
    write_text(folder / "figures.csv", csv_table(plain, significant=4))


def write_report(folder: Path, rows: Sequence[Row]) -> list[Path]:
    """Write ``summary.md``, ``summary.tex``, ``reliability.json`` and plots, or nothing if there are no rows."""
    if not rows:
        return []
    by_group, errors, reliability = f1_table(rows), error_table(rows), reliability_of(rows)
    parts = [ABOUT_F1, markdown_table(by_group)]
    parts += [ABOUT_KINDS, markdown_table(kind_table(rows))]
    parts += [ABOUT_INTERVALS, markdown_table(interval_table(rows))]
    parts += [ABOUT_ERRORS, markdown_table(errors)]
    if reliability:
        parts += [ABOUT_CONFIDENCE, markdown_table(confidence_table(reliability))]
    write_text(folder / "summary.md", "\n\n".join(parts) + "\n")
    write_text(folder / "summary.tex", latex_table(by_group) + "\n" + latex_table(errors))
    paths = [folder / name for name in ("summary.md", "summary.tex")]
    paths.append(plot_scores(folder / "benchmark.png", rows))
    if reliability:
        write_json(folder / "reliability.json", reliability)
        paths += [folder / "reliability.json", plot_reliability(folder / "reliability.png", reliability)]
    paths.append(draw_examples(folder / "examples.png", folder / PAINTINGS, rows))
    return paths
