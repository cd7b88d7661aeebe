"""Compare settings by PSNR and CPU time on several pictures, with records, a table and a figure.

    python benchmarks/speed_accuracy.py paint records.csv              # paint all settings, and add to the records
    python benchmarks/speed_accuracy.py show records.csv figure.png regrets.csv    # print a table; write both files

The settings are those of `experiment=speed_accuracy`; the pictures, a development set, are drawn by a script or come
from scikit-image. One process paints one picture after another with all settings, in a different random order for each
picture, so that other load on the machine affects all settings equally. The time of a painting is measured from the
check of its settings to its last step. It includes the initial strokes, but excludes metrics and compilation, because
an untimed painting with each setting comes first. Paintings that are already in the records are skipped.

The regret of a setting on a picture is the difference, in dB, between its PSNR and the best PSNR among all settings
that took no more CPU seconds and no more strokes on that picture. Confidence intervals come from 2,000 bootstrap
samples of the pictures.
"""

import argparse
import csv
import gc
import os
import random
import shlex
import time
from pathlib import Path
from typing import Any

import lightning as L
import numpy as np
import pandas as pd
from brushexp_studies import plotting
from brushexp_studies.pareto import front
from matplotlib.axes import Axes
from PIL import Image
from worth import scene

from brushexp.api.painting import painting_of, plan_of
from brushexp.cli.program import expand_arguments
from brushexp.reporting.tables import markdown_table
from brushexp.system.reading import read_text, yaml_of

EXPERIMENT = Path(__file__).parents[1] / "packages/studies/brushexp_studies/conf/experiment/speed_accuracy.yaml"
PICTURES = ("astronaut", "street", "coffee", "chelsea", "rocket")
SIDE = 192  # pixels on the longer side
WARM_SIDE = 48  # the same, of the first paintings, which compile kernels and read weights
WARM_STEPS = 40  # enough for a change of density
METRICS = ["psnr", "perceptual", "bits"]
FIELDS = ["picture", "settings", "strokes", "steps", "cpu_seconds", "seconds", "load"]
FIELDS += ["psnr", "perceptual", "bits_per_pixel", "psnr_decoded"]
HEIGHT = 8.0  # inches
ROOM = 1.6  # ratio by which the axis of seconds is longer than its points at both ends
SAMPLES = 2_000  # bootstrap samples
MORE_STROKES = 1.01  # ratio up to which numbers of strokes count as equal: policies end a few strokes apart
PRESETS = ("quality=draft", "quality=normal", "quality=fine", "quality=best")
KINDS = {  # label of each group of settings, and the words by which the figure recognises it
    "renderers": ("renderer=",),
    "predictor": ("init=",),
    "strokes=auto": ("density=worth",),
    "other looks": ("look=",),
}
OTHERS = "steps, strokes, density"
COLUMNS = {  # columns of the printed table: their titles and decimals
    "cpu_seconds": ("CPU s", 2),
    "psnr": ("PSNR, dB", 2),
    "perceptual": ("perceptual", 3),
}
FRONTS = {1: "#b0b0b0", 2: "#808080", 4: "#404040"}  # colour of the front for each multiple of the strokes of normal
MARKS = {  # marker of each kind, and its size in points
    "presets": ("*", 13),
    OTHERS: ("o", 6),
    "predictor": ("v", 6),
    "strokes=auto": ("D", 6),
    "other looks": ("s", 6),
}
SIDES = {"left above": ((-6, 5), "right"), "right above": ((5, 7), "left"), "right below": ((6, -11), "left")}
CROWDED = ("density=fixed coarse=0.5 steps=60",)  # settings whose labels would lie on others
BESIDE_PREDICTED = ("density=fixed", "optimizer=briefly_shaped")  # words that every such setting has
SHORT = {  # labels in the figure
    "quality=draft": "draft",
    "quality=normal": "normal",
    "quality=fine": "fine",
    "quality=best": "best",
    "look=oil": "oil",
    "density=worth": "strokes=auto",
}
ANALYTIC = "analytic"


class Stopwatch(L.Callback):
    """Callback that measures wall and CPU seconds from its creation to the end of training."""

    def __init__(self) -> None:
        self.begin = self.now()
        self.seconds = self.cpu_seconds = 0.0

    @staticmethod
    def now() -> tuple[float, float]:
        """Read the wall clock and the CPU clock."""
        return time.perf_counter(), time.process_time()

    def teardown(self, trainer: L.Trainer, pl_module: L.LightningModule, stage: str) -> None:
        self.seconds, self.cpu_seconds = (now - then for now, then in zip(self.now(), self.begin, strict=True))


def settings_of_experiment() -> list[str]:
    """List the settings of `experiment=speed_accuracy`, each as typed on the command line."""
    return list(yaml_of(read_text(EXPERIMENT, ""))["hydra"]["sweeper"]["settings"])


def paint(picture: Image.Image, settings: str, metrics: list[str]) -> dict[str, Any]:
    """Paint a picture, with look=plain unless the settings choose another look; return its metrics and times."""
    words = dict(word.split("=", 1) for word in expand_arguments(["look=plain", *shlex.split(settings)]))
    keys: dict[str, Any] = {key: value for key, value in words.items() if key != "image"}
    plan = plan_of(picture, None, {}, {"metric": metrics, "threads": 1, **keys})
    watch = Stopwatch()
    found = painting_of(plan, [watch]).metrics
    return {**found, "seconds": watch.seconds, "cpu_seconds": watch.cpu_seconds}


def measure(records: Path) -> None:
    """Paint each picture with each setting, and append each record to a file as soon as it is measured."""
    settings = settings_of_experiment()
    done = set[tuple[str, str]]()
    if records.exists():
        done.update(pd.read_csv(records)[["picture", "settings"]].itertuples(index=False, name=None))
    orders = {name: random.Random(name).sample(settings, len(settings)) for name in PICTURES}
    jobs = [(name, words) for name, order in orders.items() for words in order if (name, words) not in done]
    for words in sorted({words for _, words in jobs}):
        paint(scene(PICTURES[0], WARM_SIDE), f"{words} steps={WARM_STEPS}", METRICS[:1])
    with records.open("a", newline="") as file:
        writer = csv.DictWriter(file, FIELDS, lineterminator="\n")
        if not done:
            writer.writeheader()
        for name, words in jobs:
            gc.collect()
            writer.writerow(record_of(name, words))
            file.flush()


def record_of(name: str, words: str) -> dict[str, Any]:
    """Paint a picture with a setting; return its record, omitting bits for neural strokes, which are slow to code."""
    metrics = METRICS[:2] if "renderer=neural" in words else METRICS
    found = paint(scene(name, SIDE), words, metrics)
    digits = {"cpu_seconds": 3, "seconds": 3, "psnr": 3, "perceptual": 4, "bits": 4, "psnr_decoded": 3}
    rounded = {key: round(found[key], places) for key, places in digits.items() if key in found}
    return {
        "picture": name,
        "settings": words,
        "strokes": found["n_strokes"],
        "steps": found["steps"],
        "load": round(os.getloadavg()[0], 2),
        "bits_per_pixel": rounded.pop("bits", ""),
        **rounded,
    }


def judge(records: pd.DataFrame) -> pd.DataFrame:
    """Tabulate mean metrics, regrets with confidence intervals, and the best alternative to each setting.

    Rows are settings, sorted by CPU seconds. ``regret``, ``low`` and ``high`` are in dB. ``instead`` names the setting
    with the highest mean PSNR among all settings whose mean CPU seconds and strokes are no higher; it is empty if that
    is the row's own setting. ``gain`` is the mean gain in PSNR from this alternative, in dB.
    """
    wide = {name: records.pivot_table(name, "picture", "settings") for name in ("cpu_seconds", "strokes", "psnr")}
    regrets = regrets_of(*(table.to_numpy() for table in wide.values()))
    means = records.groupby("settings").mean(numeric_only=True).reindex(wide["psnr"].columns)
    allowed = within(means["cpu_seconds"].to_numpy(), means["strokes"].to_numpy())
    psnr = means["psnr"].to_numpy()
    best = np.where(allowed, psnr[None, :], -np.inf).argmax(1)
    chosen = np.random.default_rng(0).integers(0, len(regrets), (SAMPLES, len(regrets)))
    band = np.percentile(regrets[chosen].mean(1), (2.5, 97.5), axis=0)
    table = means.assign(regret=regrets.mean(0), low=band[0], high=band[1], gain=psnr[best] - psnr)
    table["instead"] = np.where(table["gain"] > 0, table.index[best], "")
    return table.sort_values("cpu_seconds")


def within(seconds: np.ndarray, strokes: np.ndarray) -> np.ndarray:
    """Return a mask (N, N) whose row i marks the settings with no more CPU seconds and strokes than setting i."""
    return (seconds[None, :] <= seconds[:, None]) & (strokes[None, :] <= MORE_STROKES * strokes[:, None])


def regrets_of(seconds: np.ndarray, strokes: np.ndarray, psnr: np.ndarray) -> np.ndarray:
    """Compute the regret in dB of each setting on each picture; all arrays have shape (pictures, settings)."""
    rows = zip(seconds, strokes, psnr, strict=True)
    return np.stack([np.where(within(s, n), q[None, :], -np.inf).max(1) - q for s, n, q in rows])


def kind_of(settings: str) -> str:
    """Return the group to which the figure assigns a setting."""
    if settings in PRESETS:
        return "presets"
    return next((kind for kind, words in KINDS.items() if settings.startswith(words)), OTHERS)


def show(records: Path, picture: Path | None = None, regrets: Path | None = None) -> None:
    """Print the table; if paths are given, also plot the figure to ``picture`` and write all rows to ``regrets``."""
    measured = pd.read_csv(records)
    table = judge(measured)
    is_shown = (table["regret"] == 0) | np.array([kind_of(name) not in (OTHERS, "predictor") for name in table.index])
    rows = table.loc[is_shown, list(COLUMNS)].rename(columns={name: title for name, (title, _) in COLUMNS.items()})
    rows.insert(0, "settings", [f"**`{name}`**" if name in PRESETS else f"`{name}`" for name in rows.index])
    rows["regret, dB"] = [f"{row.regret:.2f} [{row.low:.2f}, {row.high:.2f}]" for row in table[is_shown].itertuples()]
    print(markdown_table(rows, dict(COLUMNS.values()), escape=False))
    minutes, load = measured["cpu_seconds"].sum() / 60, measured["load"].mean()
    print(
        f"{measured['picture'].nunique()} pictures, {len(table)} settings, {minutes:.1f} CPU minutes, load {load:.1f}"
    )
    if picture is not None:
        draw(table, picture)
    if regrets is not None:
        regrets.write_text(table.drop(columns="load").round(3).to_csv(lineterminator="\n"))


def draw(table: pd.DataFrame, path: Path) -> None:
    """Plot PSNR against CPU seconds in two panels, one for all settings and one that compares renderers."""
    figure = plotting.new_figure(HEIGHT)
    everything, renderers = figure.subplots(1, 2, width_ratios=(2, 1), sharey=True)
    paint_points(everything, table[[kind_of(name) != "renderers" for name in table.index]])
    paint_renderers(renderers, table)
    for axes in (everything, renderers):
        plotting.tidy(axes)
        axes.set_xscale("log")
        plotting.fit_scale(axes, "x", table["cpu_seconds"])
        axes.set_xlabel("CPU seconds, one thread")
    everything.set_ylabel("PSNR, dB, mean over pictures")
    plotting.save_figure(figure, path)


def paint_points(axes: Axes, table: pd.DataFrame) -> None:
    """Plot settings by kind, and Pareto fronts of settings with up to 1, 2 and 4 times the strokes of quality=normal.

    Labels of settings on a front are above their points and to the left; most other labels are below and to the right.
    """
    normal, leading = table.loc["quality=normal", "strokes"], set[str]()
    for times, color in FRONTS.items():
        points = table[table["strokes"] <= MORE_STROKES * times * normal]
        leads = points[front(np.stack([points["cpu_seconds"], -points["psnr"]], 1))]
        leading.update(leads.index)
        seconds, psnr = [*leads["cpu_seconds"], table["cpu_seconds"].max()], [*leads["psnr"], leads["psnr"].max()]
        label = f"front, at most {times * normal:,.0f} strokes"
        axes.step(seconds, psnr, where="post", color=color, linewidth=1.2, label=label, zorder=1)
    kinds = [kind_of(name) for name in table.index]
    for (kind, (marker, size)), color in zip(MARKS.items(), plotting.COLORS, strict=False):
        points = table[[one == kind for one in kinds]]
        axes.plot(points["cpu_seconds"], points["psnr"], marker, color=color, label=kind, markersize=size)
    for name, x, y in zip(table.index, table["cpu_seconds"], table["psnr"], strict=True):
        side = "left above" if name in leading and name not in CROWDED else "right below"
        font: Any = {"fontsize": 8}
        if kind_of(name) in ("presets", "other looks"):
            side, font = "right above", {"fontsize": 11, "weight": "bold"}
        beside: Any = dict(zip(("xytext", "ha"), SIDES[side], strict=True))
        axes.annotate(label_of(name), (x, y), textcoords="offset points", color=plotting.INK, **beside, **font)
    axes.set_xlim(table["cpu_seconds"].min() / ROOM, table["cpu_seconds"].max() * ROOM)
    axes.legend(loc="lower right", fontsize=9, frameon=False)


def label_of(settings: str) -> str:
    """Shorten a setting to a label for the figure."""
    words = [word for word in settings.split() if word not in BESIDE_PREDICTED]
    label = SHORT.get(settings, " ".join(words) if settings.startswith("init=") else settings)
    return label.replace("init=", "").replace("density=", "")


def paint_renderers(axes: Axes, table: pd.DataFrame) -> None:
    """Plot each renderer's Pareto front of settings with at most as many strokes as quality=normal."""
    normal = table.loc["quality=normal", "strokes"]
    table = table[table["strokes"] <= MORE_STROKES * normal]
    table = table[[kind_of(name) != "other looks" for name in table.index]]
    renderers = [renderer_of(name) for name in table.index]
    for renderer, color in zip(dict.fromkeys(sorted(renderers)), plotting.COLORS, strict=False):
        points = table[[one == renderer for one in renderers]]
        points = points[front(np.stack([points["cpu_seconds"], -points["psnr"]], 1))]
        axes.step(points["cpu_seconds"], points["psnr"], "o-", where="post", color=color, markersize=5)
        last = points.iloc[-1]
        axes.annotate(
            renderer, (last["cpu_seconds"], last["psnr"]), xytext=(-6, 6), textcoords="offset points",
            ha="right", fontsize=10, color=color,
        )  # fmt: skip
    axes.set_title(f"renderers, at most {normal:,.0f} strokes", fontsize=10, color=plotting.INK)


def renderer_of(settings: str) -> str:
    """Return the name of the renderer that a setting chooses."""
    words = dict(word.split("=", 1) for word in settings.split())
    return words.get("renderer", ANALYTIC)


def main() -> None:
    """Parse the command line, and paint the pictures or show the records."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    for name, of in (("paint", "add paintings to the records"), ("show", "print the table and draw the figure")):
        command = commands.add_parser(name, help=of)
        command.add_argument("records", type=Path)
    command.add_argument("figure", type=Path, nargs="?", help="PNG to draw")
    command.add_argument("regrets", type=Path, nargs="?", help="CSV of the means and regrets of all settings to write")
    options = parser.parse_args()
    if options.command == "paint":
        measure(options.records)
    else:
        show(options.records, options.figure, options.regrets)


if __name__ == "__main__":
    main()
