"""Compare predicted strokes with other initial strokes, before optimisation, after some steps, and at equal CPU time.

    python benchmarks/predictor.py                               thesis12 at 512 px (about half an hour on one core)
    python benchmarks/predictor.py --pictures kodak --side 0     a folder at full size
    python benchmarks/predictor.py --only strokes                one table: strokes, steps, seconds, edges or drafts
    python benchmarks/predictor.py --sheet sheet.jpg             two pictures and their predicted strokes

Differences are paired by picture, with 95 % confidence intervals from Student's t. Times are CPU seconds of one thread
and include the initialisation.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import brushexp

# isort: split
import torch
from brushexp_studies.paired import interval
from PIL import Image
from torch import Tensor

from brushexp.cli.many_pictures import all_pictures
from brushexp.pictures.load import load_picture
from brushexp.strokes.catalogue import Strokes
from brushexp.system.words import SHIPPED

INITS = ("predicted", "slic", "layers", "random")
DRAFTS: dict[str, tuple[dict[str, str | int | float], ...]] = {  # by look: former keys, present keys, and others
    "plain": (
        {"init": "slic", "optimizer": "adam", "effort": 0.1, "coarse": 0.5},
        {"init": "predicted"},
        {"init": "predicted", "steps": 12},
        {"init": "predicted", "optimizer": "adam", "steps": 25},
        {"init": "slic", "effort": 0.1, "coarse": 0.5},
    ),
    "oil": ({"init": "layers", "effort": 0.1, "coarse": 0.5}, {"init": "brushed"}),
}
EDGE = 8  # pixels
CORES = os.cpu_count() or 1
Row = Sequence[str | int | float]


@cache
def target_of(name: str, side: int) -> Tensor:
    """Load a picture and cache it."""
    return load_picture(name, side or None)


def begin(name: str, side: int, init: str, n: int, **options: object) -> tuple[Strokes, float]:
    """Create initial strokes; return them and the CPU seconds spent."""
    target, start = target_of(name, side), time.process_time()
    strokes = brushexp.create("init", init, **options)(target, n, torch.Generator().manual_seed(0))
    return strokes, time.process_time() - start


def paint(name: str, side: int, init: str, n: int, steps: int) -> tuple[float, float, float]:
    """Paint a picture; return its PSNR in dB, perceptual distance, and CPU seconds without initialisation."""
    keys: dict[str, str | int] = {"look": "even", "strokes": n, "init": init, "steps": steps, "threads": 1}
    if init == "predicted" and not steps:
        keys["painter"] = "predictor"  # which keeps the predicted order; an optimiser starts with its own
    painting = brushexp.paint(name, **keys, **({"resolution": side} if side else {}))
    metrics = painting.metrics
    return metrics["psnr"], metrics["perceptual"], metrics["cpu_seconds"] if steps else 0.0


def table(title: str, head: Row, rows: Sequence[Row]) -> None:
    """Print a table in Markdown."""
    print(f"\n{title}\n\n| {' | '.join(map(str, head))} |\n|{' --- |' * len(head)}")
    for row in rows:
        print(
            f"| {' | '.join(f'{value:.2f}' if isinstance(value, float) else str(value) for value in row)} |", flush=True
        )


def format_difference(ours: Sequence[float], theirs: Sequence[float]) -> str:
    """Format the mean difference between paired values with its confidence interval."""
    mean, low, high = interval(one - other for one, other in zip(ours, theirs, strict=True))
    digits = 2 if max(map(abs, theirs)) > 1 else 3
    return f"{mean:+.{digits}f} [{low:+.{digits}f}, {high:+.{digits}f}]"


def by_strokes(names: Sequence[str], side: int, counts: Sequence[int]) -> None:
    """Print the quality and the time of paintings without optimisation."""
    rows = []
    for n in counts:
        ours = [paint(name, side, "predicted", n, 0) for name in names]
        slic = [paint(name, side, "slic", n, 0) for name in names]
        seconds = statistics.median(begin(name, side, "predicted", n)[1] for name in names)
        wall = statistics.median(wall_of(name, side, n) for name in names)
        psnr, distance = statistics.mean(row[0] for row in ours), statistics.mean(row[1] for row in ours)
        gain = format_difference([row[0] for row in ours], [row[0] for row in slic])
        rows.append([n, psnr, f"{distance:.3f}", gain, seconds, wall])
    head = ["strokes", "dB", "perceptual", "dB over slic", "CPU s", f"s on {CORES} threads"]
    table("No step of the optimiser", head, rows)


def wall_of(name: str, side: int, n: int) -> float:
    """Measure the wall time of predicting strokes on all cores."""
    torch.set_num_threads(CORES)
    start = time.perf_counter()
    begin(name, side, "predicted", n)
    wall = time.perf_counter() - start
    torch.set_num_threads(1)
    return wall


def by_steps(names: Sequence[str], side: int, n: int, steps: Sequence[int]) -> None:
    """Print the quality of paintings after different numbers of steps."""
    rows = []
    for count in steps:
        found = {init: [paint(name, side, init, n, count)[0] for name in names] for init in INITS}
        rows.append(
            [
                count,
                *(statistics.mean(found[init]) for init in INITS),
                format_difference(found["predicted"], found["slic"]),
            ]
        )
    table(f"{n} strokes, by steps, dB", ["steps", *INITS, "predicted over slic"], rows)


def by_seconds(names: Sequence[str], side: int, n: int, budgets: Sequence[float]) -> None:
    """Print the quality of paintings at equal CPU times."""
    a_step = statistics.median(paint(name, side, "slic", n, 20)[2] / 20 for name in names[:4])
    starts = {init: statistics.median(begin(name, side, init, n)[1] for name in names[:4]) for init in INITS}
    rows = []
    for budget in budgets:
        steps = {init: int((budget - starts[init]) / a_step) for init in INITS}
        found = {
            init: [paint(name, side, init, n, steps[init])[0] for name in names] for init in INITS if steps[init] >= 0
        }
        cells = [f"{statistics.mean(found[init]):.2f} ({steps[init]})" if init in found else "" for init in INITS]
        both = "predicted" in found and "slic" in found
        rows.append([budget, *cells, format_difference(found["predicted"], found["slic"]) if both else ""])
    table(f"{n} strokes, by CPU seconds, dB (steps)", ["s", *INITS, "predicted over slic"], rows)


def by_place(names: Sequence[str], side: int, n: int) -> None:
    """Print the ratio of the error near the edge of paintings to the error elsewhere."""
    ratios = []
    for name in names:
        target = target_of(name, side)
        strokes, _ = begin(name, side, "predicted", n)
        size = (target.shape[1], target.shape[2])
        picture = brushexp.render(strokes, size, background=target.mean((1, 2)))
        error = (picture.clamp(0, 1) - target).square().mean(0)
        inner = error[EDGE:-EDGE, EDGE:-EDGE]
        at_edge = (error.sum() - inner.sum()) / (error.numel() - inner.numel())
        ratios.append(float(at_edge / inner.mean()))
    rows = [[n, statistics.median(ratios), statistics.geometric_mean(ratios)]]
    table(
        f"Squared error within {EDGE} px of the edge, over that elsewhere",
        ["strokes", "median", "geometric mean"],
        rows,
    )


def draft(name: str, side: int, look: str, keys: dict[str, str | int | float]) -> tuple[float, float, float]:
    """Paint a draft; return its PSNR in dB, perceptual distance, and CPU seconds of initialisation and steps."""
    size = {"resolution": side} if side else {}
    metrics = brushexp.paint(name, look=look, quality="draft", threads=1, **keys, **size).metrics
    own = {"init": "predicted", "checkpoint": "brushed"} if keys["init"] == "brushed" else {"init": str(keys["init"])}
    return (
        metrics["psnr"],
        metrics["perceptual"],
        metrics["cpu_seconds"] + begin(name, side, n=metrics["n_strokes"], **own)[1],
    )


def by_draft(names: Sequence[str], side: int) -> None:
    """Print the quality of drafts with the former, current and alternative settings."""
    rows = []
    for look, choices in DRAFTS.items():
        found = [list(zip(*(draft(name, side, look, keys) for name in names), strict=True)) for keys in choices]
        before = found[0]
        for keys, (psnr, distance, seconds) in zip(choices, found, strict=True):
            words = " ".join(f"{key}={value}" for key, value in keys.items())
            gains = (
                [format_difference(psnr, before[0]), format_difference(distance, before[1])]
                if psnr is not before[0]
                else ["", ""]
            )
            spent = statistics.mean(seconds)
            times = f"{spent / statistics.mean(before[2]):.2f}"
            perceptual = f"{statistics.mean(distance):.3f}"
            rows.append([look, words, statistics.mean(psnr), gains[0], perceptual, gains[1], spent, times])
    table("Drafts", ["look", "keys", "dB", "more", "perceptual", "more", "CPU s", "times"], rows)


def sheet(
    path: Path, names: Sequence[str] = ("coffee", "astronaut"), counts: Sequence[int] = (200, 1000, 2600)
) -> None:
    """Save a sheet that shows pictures next to their predicted paintings with increasing numbers of strokes."""
    rows = []
    for name in names:
        target = target_of(name, 400)[:, :266].contiguous()
        size = (target.shape[1], target.shape[2])
        row = [target]
        for n in counts:
            strokes = brushexp.create("init", "predicted")(target, n, torch.Generator().manual_seed(0))
            row.append(brushexp.render(strokes, size, background=target.mean((1, 2))).clamp(0, 1))
        rows.append(torch.cat(row, 2))
    picture = (torch.cat(rows, 1) * 255).round().byte().permute(1, 2, 0).numpy()
    Image.fromarray(picture).save(path, quality=90)


def main() -> None:
    """Print the requested tables, or save the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", nargs="+", default=["thesis12"], help="names, files, folders or sets")
    parser.add_argument("--side", type=int, default=512, help="longer side in pixels; 0 keeps the size")
    parser.add_argument("--strokes", type=int, nargs="+", default=[200, 1000, 2600, 10000])
    parser.add_argument("--steps", type=int, nargs="+", default=[0, 5, 10, 15, 30, 60])
    parser.add_argument("--only", default="strokes,steps,seconds,edges")
    parser.add_argument("--sheet", type=Path, help="file to write the pictures to, instead of tables")
    given = parser.parse_args()
    brushexp.list_plugins()
    torch.set_num_threads(1)
    if given.sheet:
        sheet(given.sheet)
        return
    names = all_pictures(given.pictures, [SHIPPED])
    middle = given.strokes[min(2, len(given.strokes) - 1)]
    tables: dict[str, Callable[[], None]] = {
        "strokes": lambda: by_strokes(names, given.side, given.strokes),
        "steps": lambda: by_steps(names, given.side, middle, given.steps),
        "seconds": lambda: by_seconds(names, given.side, middle, (0.1, 0.3, 1, 3, 10)),
        "edges": lambda: by_place(names, given.side, middle),
        "drafts": lambda: by_draft(names, given.side),
    }
    for name in given.only.split(","):
        tables[name]()


if __name__ == "__main__":
    main()
