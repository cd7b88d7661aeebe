"""Draw the benchmark's plots and examples."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from brushexp_studies.plotting import COLORS, INK, MARKERS, new_figure, save_figure, tidy
from PIL import Image

from brushexp.contracts.files import write_picture
from brushexp_recovery.benchmark.report_tables import Row, by_method, clean_rows
from brushexp_recovery.confidence.calibration import ReliabilityBin
from brushexp_recovery.raster.labels import color_labels


def plot_scores(path: Path, rows: Sequence[Row]) -> Path:
    """Plot each method's F1 score on every picture, with clean and degraded pictures side by side."""
    figure = new_figure(4.6)
    looks = [look for look in ("clean", "hard") if any(row["look"] == look for row in rows)]
    for axes, look in zip(figure.subplots(1, len(looks), sharey=True, squeeze=False)[0], looks, strict=True):
        tidy(axes)
        own = [row for row in rows if row["look"] == look]
        scenes = list(dict.fromkeys(row["scene"] for row in own))
        for number, (name, group) in enumerate(by_method(own).items()):
            style = {"color": COLORS[number % len(COLORS)], "marker": MARKERS[number % len(MARKERS)], "ls": "none"}
            axes.plot([scenes.index(row["scene"]) for row in group], [row["f1"] for row in group], label=name, **style)
        axes.set_xticks(range(len(scenes)), scenes, rotation=60, ha="right", fontsize=8)
        axes.set(title=look, ylim=(0, 1), ylabel="F1")
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize=8, frameon=False)
    return save_figure(figure, path)


def plot_reliability(path: Path, reliability: Mapping[str, list[ReliabilityBin]]) -> Path:
    """Plot the fraction of correct strokes against their confidence."""
    figure = new_figure(5)
    axes = figure.subplots()
    tidy(axes)
    axes.plot([0, 1], [0, 1], ":", color=INK, label="ideal")
    for number, (name, bins) in enumerate(reliability.items()):
        confidence, right = [one.confidence for one in bins], [one.right for one in bins]
        total = sum(one.strokes for one in bins)
        size = [8 + 220 * one.strokes / max(total, 1) for one in bins]
        axes.plot(confidence, right, color=COLORS[number])
        axes.scatter(confidence, right, size, color=COLORS[number], label=f"{name}, {total:,} strokes")
    axes.set(xlabel="confidence", ylabel="share of right strokes", xlim=(0, 1), ylim=(0, 1), aspect="equal")
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize=9, frameon=False)
    return save_figure(figure, path)


def draw_examples(path: Path, paintings: Path, rows: Sequence[Row]) -> Path:
    """Draw a clean painting of each kind, with its true regions and the first method's regions in random colours.

    The ``paintings`` folder contains the pictures, their ground truth and the predicted regions.
    """
    method = rows[0]["method"]
    first = {row["kind"]: row["scene"] for row in reversed(clean_rows(rows)) if row["method"] == method}
    columns = []
    for scene in reversed(first.values()):
        with Image.open(paintings / f"{scene}.png") as picture:
            images = [np.asarray(picture.convert("RGB"))]
        for name in (scene, f"{scene}-{method}"):
            with np.load(paintings / f"{name}.npz") as file:
                images.append(color_labels(file["labels"]))
        columns.append(np.concatenate(images))
    write_picture(path, np.concatenate(columns, 1))
    return path
