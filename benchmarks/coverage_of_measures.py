"""Test how often the confidence intervals of ``task=measure`` contain the true values, on paintings with known strokes.

    python benchmarks/coverage_of_measures.py measure fitted --views 2 --seeds 0 4
    python benchmarks/coverage_of_measures.py fit fitted
    python benchmarks/coverage_of_measures.py measure tested --seeds 100 102 --kinds textured dabs knife
    python benchmarks/coverage_of_measures.py report tested docs/records/measures.csv
    python benchmarks/coverage_of_measures.py show docs/records/measures.csv

Each combination of kind and seed is one painting. Its picture is clean if the seed is even, and a weathered photograph
if the seed is odd. ``measure`` writes a file for each painting with its true values and the samples from its views.
``fit`` fits the recovery errors that ship with the program. ``report`` writes the measured values, with and without a
correction for these errors, and ``show`` prints the coverage of the confidence intervals. True values count only
strokes that show at least 30 % of their area and at least 12 pixels, and use the full lengths of these strokes.
"""

import argparse
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from brushexp_recovery.benchmark.scenes import UNSEEN, Scene, paint_scene
from brushexp_recovery.measure.areas import WHOLE, areas_of
from brushexp_recovery.measure.draws import Sighting, draw_figures, sight
from brushexp_recovery.measure.intervals import intervals_of
from brushexp_recovery.measure.measures import MEASURES
from brushexp_recovery.measure.recovery_error import FILE, read_errors
from brushexp_recovery.measure.views import View, choose_views
from brushexp_recovery.model.recovery_model import CHECKPOINTS, SHIPPED_WEIGHTS, load_model
from brushexp_recovery.raster.npz import read_npz, write_npz
from brushexp_recovery.recover.pipeline import COPIES, recover_with
from brushexp_recovery.synthesis.families.family import find_families
from brushexp_recovery.train.errors_of_measures import fit_errors, write_errors

from brushexp.contracts.runs import load_plugins

SIDES = 256, 320  # pixels of a painting's side
COUNTS = 60, 120  # strokes of a painting
DRAWS = 40  # of the strokes of each view, as task=measure has by default
SEED = 11_307  # of all paintings, which the benchmark of recovery does not use
KINDS = "textured", *find_families()  # kinds of paint that the weights have learnt from
RESAMPLES = 4000  # of the bootstrap over paintings


def paint(kind, seed):
    """Paint known strokes; return their ground truth and the picture (H, W, 3), which is weathered for odd seeds."""
    random = np.random.default_rng([SEED, seed, *kind.encode()])
    side, count = int(random.choice(SIDES)), int(random.choice(COUNTS))
    painting = paint_scene(Scene(kind, count, seed), side, SEED)
    return painting.truth, (painting.hard if seed % 2 else painting.clean).astype(np.float32)


def figures_of_truth(truth):
    """Compute the true values of all measures of a painting, in the units of `intervals_of`."""
    strokes = Sighting(torch.from_numpy(truth.curve), truth.width, truth.counts.astype(float), truth.labels, View())
    figures = draw_figures([strokes], areas_of(None, truth.labels.shape), 1, 0)[WHOLE]
    return {name: float(values[0, 0]) * MEASURES[name].factor(None) for name, values in figures.items()}


def measure(folder, kinds, seeds, views):
    """Measure paintings, and write a file for each of them."""
    torch.set_num_threads(1)
    load_plugins(Path("plugins"), warns=False)
    folder.mkdir(parents=True, exist_ok=True)
    recover = partial(recover_with, load_model(), scale=None, copies=COPIES, show=lambda *_: None)
    for seed in seeds:
        for kind in kinds:
            path = folder / f"{kind}-{seed}.npz"
            if path.exists():
                continue
            truth, image = paint(kind, seed)
            sightings = [sight(image, view, lambda picture: recover(image=picture)) for view in choose_views(views, 0)]
            draws = draw_figures(sightings, areas_of(None, image.shape[:2]), DRAWS, 0)[WHOLE]
            true = figures_of_truth(truth)
            arrays = {f"true {name}": np.array(true[name]) for name in MEASURES}
            arrays |= {f"draws {name}": draws[name] for name in MEASURES}
            write_npz(path, confidence=sightings[0].confidence, **arrays)
            print(path.stem, *(f"{name} {true[name]:.3g}" for name in MEASURES), flush=True)


def read(folder):
    """Read measured paintings; map each painting's name to its true values, samples and stroke confidences."""
    paintings = {}
    for path in sorted(folder.glob("*.npz")):
        arrays = read_npz(path)
        true, draws = ({name: arrays[f"{of} {name}"] for name in MEASURES} for of in ("true", "draws"))
        paintings[path.stem] = true, draws, arrays["confidence"]
    return paintings


def fit(folder, path):
    """Estimate the recovery errors from measured paintings, and write them to a file."""
    paintings = read(folder)
    true, draws, confidence = zip(*paintings.values(), strict=True)
    figures = [intervals_of(one) for one in draws]
    errors = fit_errors(
        {name: np.array([float(one[name]) for one in true]) for name in MEASURES},
        {name: np.array([one[name].value for one in figures]) for name in MEASURES},
        np.array([one.mean() for one in confidence]),
        list(paintings),
        CHECKPOINTS.read_recipe(CHECKPOINTS.path_of(SHIPPED_WEIGHTS))["hash"],
    )
    write_errors(path, errors)


def report(folder, path):
    """Write the measured values with and without a correction for recovery errors, and show their coverage."""
    errors, rows = read_errors(), []
    for painting, (true, draws, confidence) in read(folder).items():
        kind, _, seed = painting.rpartition("-")
        found, corrected = intervals_of(draws), intervals_of(errors.correct(draws, confidence))
        for name in MEASURES:
            row = {"kind": kind, "seed": int(seed), "views": len(draws[name])}
            row |= {"measure": name, "true": float(true[name])}
            for of, one in (("found", found[name]), ("corrected", corrected[name])):
                row |= {of: one.value, f"{of}_low": one.low, f"{of}_high": one.high}
            rows.append(row)
    pd.DataFrame(rows).to_csv(path, index=False, float_format="%.5g")
    show(path)


def holds(rows, of):
    """Check whether intervals contain the true values; directions that differ by 180 degrees count as equal."""
    axial = rows["measure"].map(lambda name: MEASURES[name].axial)
    near = rows[of] + (rows["true"] - rows[of] + 90) % 180 - 90
    true = rows["true"].where(~axial, near)
    return (rows[f"{of}_low"] <= true) & (true <= rows[f"{of}_high"])


def widths(rows, of):
    """Compute the widths of intervals: absolute for fractions and directions, relative for all other measures."""
    width = rows[f"{of}_high"] - rows[f"{of}_low"]
    plain = rows["measure"].map(lambda name: MEASURES[name].axial or MEASURES[name].share)
    return width.where(plain, width / rows[of])


def describe(rows):
    """Format the coverage, with its confidence interval over paintings, and the intervals' median relative width."""
    cells, random = [], np.random.default_rng(0)
    relative = rows["measure"].map(lambda name: not MEASURES[name].axial and not MEASURES[name].share)
    for of in ("found", "corrected"):
        held = holds(rows, of).groupby([rows["kind"], rows["seed"]]).mean().to_numpy()
        means = held[random.integers(0, len(held), (RESAMPLES, len(held)))].mean(1)
        low, high = np.quantile(means, (0.025, 0.975))
        cells.append(f"{held.mean():.2f} ({low:.2f} to {high:.2f}) | {widths(rows[relative], of).median():.2f}")
    return f"{rows.groupby(['kind', 'seed']).ngroups} | {cells[0]} | {cells[1]} |"


def table_of_paintings(rows):
    """Tabulate the coverage by kind of painting, as lines of Markdown."""
    unseen = rows["kind"].isin(UNSEEN)
    parts = {"all": unseen | ~unseen, "kinds of the fit": ~unseen, "other kinds": unseen}
    lines = ["| paintings | number | `found` | width | corrected | width |", "|---|---:|---|---:|---|---:|"]
    return lines + [f"| {name} | {describe(rows[part])}" for name, part in parts.items() if part.any()]


def table_of_measures(rows):
    """Tabulate the coverage by measure, as lines of Markdown."""
    lines = ["| measure | `found` | width | corrected | width |", "|---|---:|---:|---:|---:|"]
    for name in MEASURES:
        of = rows[rows["measure"] == name]
        cells = [f"{holds(of, one).mean():.2f} | {widths(of, one).median():.2f}" for one in ("found", "corrected")]
        lines.append(f"| `{name}` | {cells[0]} | {cells[1]} |")
    return lines


def show(path):
    """Print the coverage recorded by `report`, by kind of painting and by measure."""
    rows = pd.read_csv(path)
    print("\n".join([*table_of_paintings(rows), "", *table_of_measures(rows)]))


def main():
    """Parse the command line and run the chosen command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    actions = parser.add_subparsers(dest="action", required=True)
    measured, fitted, reported, shown = (actions.add_parser(name) for name in ("measure", "fit", "report", "show"))
    for action in (measured, fitted, reported):
        action.add_argument("folder", type=Path)
    measured.add_argument("--kinds", nargs="+", default=KINDS)
    measured.add_argument("--seeds", nargs=2, type=int, default=(0, 4), help="first seed, and the one after the last")
    measured.add_argument("--views", type=int, default=6)
    fitted.add_argument("--path", type=Path, default=FILE)
    for action in (reported, shown):
        action.add_argument("path", type=Path)
    options = vars(parser.parse_args())
    if (action := options.pop("action")) == "measure":
        options["seeds"] = range(*options["seeds"])
    {"measure": measure, "fit": fit, "report": report, "show": show}[action](**options)


if __name__ == "__main__":
    main()
