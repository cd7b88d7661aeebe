"""Tabulate the scores of several methods on many pictures."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from brushexp_recovery.confidence.calibration import ReliabilityBin, ece_of, join_reliability

Array = NDArray[Any]
Row: TypeAlias = dict[str, Any]  # one picture and method: place, figures, seconds
Reliability: TypeAlias = dict[str, list[ReliabilityBin]]  # bins of each group of paintings


RESAMPLES = 2000  # number of bootstrap resamples


class Column(NamedTuple):
    """A column of the error table."""

    heading: str
    digits: int


GROUPS = {
    "seen, clean": (True, "clean"),
    "seen, hard": (True, "hard"),
    "unseen, clean": (False, "clean"),
    "unseen, hard": (False, "hard"),
}  # whether the kind occurs in training, and the condition of the picture
ERRORS = {
    "recall": Column("recall", 2),
    "precision": Column("precision", 2),
    "direction_deg": Column("direction, °", 1),
    "length_rel": Column("length", 2),
    "width_rel": Column("width", 2),
    "color_de00": Column("colour, ΔE00", 1),
    "order_agreement": Column("order", 2),
    "order_tau": Column("order, τ", 2),
    "field_direction_deg": Column("field of direction, °", 1),
    "field_length_rel": Column("field of length", 2),
    "field_width_rel": Column("field of width", 2),
    "auc": Column("AUC", 2),
    "seconds": Column("seconds", 1),
}


def mean_text(rows: Iterable[Row], figure: str, digits: int) -> str | None:
    """Format the mean of a score over the rows in which it is defined, or return None if there are none."""
    values = [row[figure] for row in rows if figure in row and np.isfinite(row[figure])]
    return f"{np.mean(values):.{digits}f}" if values else None


def by_method(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Group rows by method, in order of appearance."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row["method"], []).append(row)
    return groups


def clean_rows(rows: Iterable[Row]) -> list[Row]:
    """Keep only the rows of clean paintings, not those of degraded photographs."""
    return [row for row in rows if row["look"] == "clean"]


def f1_table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Average F1 by method, separately for seen and unseen kinds and for clean paintings and degraded photographs."""
    table = []
    for name, own in by_method(rows).items():
        line: dict[str, Any] = {"method": name}
        for group, (seen, look) in GROUPS.items():
            line[group] = mean_text((row for row in own if row["seen"] == seen and row["look"] == look), "f1", 3)
        table.append(line)
    return table


def kind_table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Average F1 over clean paintings by kind and number of strokes, with a column for each method."""
    clean = clean_rows(rows)
    methods = by_method(clean)
    table = []
    for kind, count in dict.fromkeys((row["kind"], row["count"]) for row in clean):
        line: dict[str, Any] = {"kind": kind, "strokes": count}
        for name, own in methods.items():
            line[name] = mean_text((row for row in own if (row["kind"], row["count"]) == (kind, count)), "f1", 2)
        table.append(line)
    return table


def interval_table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Average F1 by method and kind, and over all kinds, each with a 95 % confidence interval over paintings.

    The bounds are percentiles of `RESAMPLES` means over resampled paintings of every kind (bootstrap; Efron, 1979). A
    kind with one painting has no interval; the mean over all kinds has an interval only if every kind has one.
    """
    table = []
    for name, own in by_method(rows).items():
        lines: dict[str, dict[str, Any]] = {}
        for look in dict.fromkeys(row["look"] for row in own):
            values: dict[str, list[float]] = {}
            for row in own:
                if row["look"] == look:
                    values.setdefault(row["kind"], []).append(row["f1"])
            random = np.random.default_rng(0)
            resampled = {kind: _resample_mean(np.array(f1), random) for kind, f1 in values.items()}
            means = {kind: float(np.mean(f1)) for kind, f1 in values.items()}
            for kind, f1 in values.items():
                line = lines.setdefault(kind, {"method": name, "kind": kind, "paintings": len(f1)})
                line[look] = _with_interval(means[kind], resampled[kind], len(f1) > 1)
            every = {"method": name, "kind": "mean of kinds", "paintings": sum(map(len, values.values()))}
            joint = np.mean(list(resampled.values()), 0)
            is_known = all(len(f1) > 1 for f1 in values.values())
            lines.setdefault("", every)[look] = _with_interval(float(np.mean(list(means.values()))), joint, is_known)
        table += [*(line for kind, line in lines.items() if kind), lines[""]]
    return table


def _resample_mean(values: Array, random: np.random.Generator) -> Array:
    """Return the means of `RESAMPLES` bootstrap resamples of values (n,)."""
    mean: Array = random.choice(values, (RESAMPLES, len(values))).mean(1)
    return mean


def _with_interval(mean: float, means: Array, is_known: bool) -> str:
    """Format a mean; if ``is_known``, add the interval that contains 95 % of the resampled means."""
    low, high = np.quantile(means, [0.025, 0.975])
    return f"{mean:z.2f} ({low:z.2f} to {high:z.2f})" if is_known else f"{mean:z.2f}"


def error_table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Average the errors of each method over clean paintings."""
    return [
        {"method": name} | {column.heading: mean_text(own, figure, column.digits) for figure, column in ERRORS.items()}
        for name, own in by_method(clean_rows(rows)).items()
    ]


def reliability_of(rows: Sequence[Row]) -> Reliability:
    """Pool the reliability of recovery over the paintings in each group."""
    groups: dict[str, list[Sequence[ReliabilityBin]]] = {}
    for row in rows:
        if row["method"] == "recovery" and row.get("reliability"):
            seen = "seen" if row["seen"] else "unseen"
            groups.setdefault(f"{seen}, {row['look']}", []).append(row["reliability"])
    return {name: join_reliability(group) for name, group in groups.items()}


def confidence_table(reliability: Mapping[str, list[ReliabilityBin]]) -> list[dict[str, Any]]:
    """Compare mean confidence with the fraction of correct strokes, by group and over all clean or hard pictures."""
    groups = dict(reliability)
    for look in ("clean", "hard"):
        alike = [bins for name, bins in reliability.items() if name.endswith(look)]
        if len(alike) > 1:
            groups[f"all, {look}"] = join_reliability(alike)
    table = []
    for name, bins in groups.items():
        strokes = [one.strokes for one in bins]
        confidence = np.average([one.confidence for one in bins], weights=strokes)
        right = np.average([one.right for one in bins], weights=strokes)
        line: dict[str, Any] = {"group": name, "strokes": sum(strokes)}
        line |= {"confidence": f"{confidence:.2f}", "right": f"{right:.2f}", "ECE": f"{ece_of(bins):.2f}"}
        table.append(line)
    return table
