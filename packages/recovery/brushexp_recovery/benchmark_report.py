"""Tables, plots and examples of the benchmark."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from brushexp_studies.plotting import COLORS, INK, MARKERS, new_figure, save_figure, tidy
from PIL import Image

from brushexp.reporting.tables import csv_table, latex_table, markdown_table
from brushexp.system.files import write_json, write_picture, write_text
from brushexp_recovery.calibration import ece_of, join_reliability
from brushexp_recovery.raster.labels import color_labels

Row: TypeAlias = dict[str, Any]  # of one picture and method: place, figures, seconds

GROUPS = {
    "seen, clean": (True, "clean"), "seen, hard": (True, "hard"),
    "unseen, clean": (False, "clean"), "unseen, hard": (False, "hard"),
}  # fmt: skip
ERRORS = {  # column: heading, digits
    "recall": ("recall", 2), "precision": ("precision", 2), "direction_deg": ("direction, °", 1),
    "length_rel": ("length", 2), "width_rel": ("width", 2), "color_de00": ("colour, ΔE00", 1),
    "order_agreement": ("order", 2), "order_tau": ("order, τ", 2), "field_direction_deg": ("field of direction, °", 1),
    "field_length_rel": ("field of length", 2), "field_width_rel": ("field of width", 2), "auc": ("AUC", 2),
    "seconds": ("seconds", 1),
}  # fmt: skip


def write_report(folder: Path, rows: Sequence[Row]) -> list[Path]:
    """Write ``summary.md``, ``summary.tex``, ``reliability.json``, plots; of no rows nothing."""
    if not rows:
        return []
    by_group, by_kind, errors = f1_table(rows), kind_table(rows), error_table(rows)
    parts = [
        "Mean F1 at an intersection over union of 0.5. Seen: kinds of which training has some, from other subjects and "
        "seeds; unseen: other brushes, other painters' strokes. Clean: the painting; hard: a photograph of it.",
        markdown_table(by_group), "Mean F1 by kind and number of strokes, clean.", markdown_table(by_kind),
        "Means over clean paintings; errors are medians over matched strokes, length and width as shares of the true "
        "ones; order is the share of found pairs that overlap whose upper one was told; fields are those of "
        "neighbourhoods, matched or not.", markdown_table(errors),
    ]  # fmt: skip
    if reliable := reliability_of(rows):
        parts += [
            "Confidence of recovery, over the strokes of all paintings of a group together: the expected calibration "
            "error (ECE) of few strokes is large even where the confidence is right.",
            markdown_table(confidence_table(reliable)),
        ]
    write_text(folder / "summary.md", "\n\n".join(parts) + "\n")
    write_text(folder / "summary.tex", latex_table(by_group) + "\n" + latex_table(errors))
    paths = [folder / name for name in ("summary.md", "summary.tex")]
    paths.append(plot_scores(folder / "benchmark.png", rows))
    if reliable:
        write_json(folder / "reliability.json", reliable)
        paths += [folder / "reliability.json", plot_reliability(folder / "reliability.png", reliable)]
    return [*paths, *draw_examples(folder, rows)]


def write_figures(folder: Path, rows: Sequence[Row]) -> None:
    """Write ``figures.csv``, a line per picture and method."""
    plain = [{key: value for key, value in row.items() if key != "reliability"} for row in rows]
    write_text(folder / "figures.csv", csv_table(plain, significant=4))


def mean_of(rows: Sequence[Row], column: str, digits: int) -> str | None:
    """Average a column over the rows where it is defined, as text."""
    values = [row[column] for row in rows if column in row and np.isfinite(row[column])]
    return f"{np.mean(values):.{digits}f}" if values else None


def methods_of(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Group rows by method, in their order."""
    names = dict.fromkeys(row["method"] for row in rows)
    return {name: [row for row in rows if row["method"] == name] for name in names}


def f1_table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Average F1 by method, over kinds that training has seen and others, clean and hard."""
    return [
        {"method": name}
        | {
            group: mean_of([row for row in own if (row["seen"], row["look"]) == of], "f1", 3)
            for group, of in GROUPS.items()
        }
        for name, own in methods_of(rows).items()
    ]


def kind_table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Average F1 of clean paintings by kind and number of strokes, a column per method."""
    clean = [row for row in rows if row["look"] == "clean"]
    places = dict.fromkeys((row["kind"], row["count"]) for row in clean)
    return [
        {"kind": kind, "strokes": count}
        | {
            name: mean_of([row for row in own if (row["kind"], row["count"]) == (kind, count)], "f1", 2)
            for name, own in methods_of(clean).items()
        }
        for kind, count in places
    ]


def error_table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Average the errors of each method over clean paintings."""
    clean = [row for row in rows if row["look"] == "clean"]
    return [
        {"method": name} | {head: mean_of(own, column, digits) for column, (head, digits) in ERRORS.items()}
        for name, own in methods_of(clean).items()
    ]


def reliability_of(rows: Sequence[Row]) -> dict[str, Any]:
    """Join the reliability of recovery over paintings, by how they look."""
    tables: dict[str, list[Any]] = {}
    for row in rows:
        if row["method"] == "recovery" and row.get("reliability"):
            seen = "seen" if row["seen"] else "unseen"
            tables.setdefault(f"{seen}, {row['look']}", []).append(row["reliability"])
    return {name: join_reliability(group) for name, group in tables.items()}


def confidence_table(reliable: dict[str, Any]) -> list[dict[str, Any]]:
    """Compare the mean confidence of each group of paintings, and of all that look alike, with the share right."""
    groups = dict(reliable)
    for look in ("clean", "hard"):
        alike = [rows for name, rows in reliable.items() if name.endswith(look)]
        groups |= {f"all, {look}": join_reliability(alike)} if len(alike) > 1 else {}
    table = []
    for name, rows in groups.items():
        mean, share, count = np.array(rows).T
        figures = {"confidence": np.average(mean, weights=count), "right": np.average(share, weights=count)}
        figures["ECE"] = ece_of(rows)
        table.append({"group": name, "strokes": int(count.sum())} | {key: f"{v:.2f}" for key, v in figures.items()})
    return table


def plot_scores(path: Path, rows: Sequence[Row]) -> Path:
    """Plot F1 of every picture by method, clean and hard beside each other."""
    figure = new_figure(4.6)
    looks = [look for look in ("clean", "hard") if any(row["look"] == look for row in rows)]
    for axes, look in zip(figure.subplots(1, len(looks), sharey=True, squeeze=False)[0], looks, strict=True):
        tidy(axes)
        own = [row for row in rows if row["look"] == look]
        scenes = list(dict.fromkeys(row["scene"] for row in own))
        for number, (name, group) in enumerate(methods_of(own).items()):
            style = {"color": COLORS[number % len(COLORS)], "marker": MARKERS[number % len(MARKERS)], "ls": "none"}
            axes.plot([scenes.index(row["scene"]) for row in group], [row["f1"] for row in group], label=name, **style)
        axes.set_xticks(range(len(scenes)), scenes, rotation=60, ha="right", fontsize=8)
        axes.set(title=look, ylim=(0, 1), ylabel="F1")
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize=8, frameon=False)
    return save_figure(figure, path)


def plot_reliability(path: Path, tables: dict[str, Any]) -> Path:
    """Plot which share of found strokes is right by their confidence."""
    figure = new_figure(5)
    axes = figure.subplots()
    tidy(axes)
    axes.plot([0, 1], [0, 1], ":", color=INK, label="as it should be")
    for number, (name, table) in enumerate(tables.items()):
        mean, share, count = zip(*table, strict=True)
        size = 8 + 220 * np.array(count) / max(sum(count), 1)
        axes.plot(mean, share, color=COLORS[number])
        axes.scatter(mean, share, size, color=COLORS[number], label=f"{name}, {sum(count):,} strokes")
    axes.set(xlabel="confidence", ylabel="share that is right", xlim=(0, 1), ylim=(0, 1), aspect="equal")
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize=9, frameon=False)
    return save_figure(figure, path)


def draw_examples(folder: Path, rows: Sequence[Row]) -> list[Path]:
    """Draw for each kind a clean painting, its true regions, and those of the first method, in chance colours."""
    method = rows[0]["method"]
    chosen = {row["kind"]: row["scene"] for row in reversed(rows) if row["look"] == "clean" and row["method"] == method}
    columns = []
    for scene in reversed(chosen.values()):
        with Image.open(folder / "paintings" / f"{scene}.png") as picture:
            images = [np.asarray(picture.convert("RGB"))]
        for name in (scene, f"{scene}-{method}"):
            with np.load(folder / "paintings" / f"{name}.npz") as file:
                images.append(color_labels(file["labels"]))
        columns.append(np.concatenate(images))
    write_picture(folder / "examples.png", np.concatenate(columns, 1))
    return [folder / "examples.png"]
