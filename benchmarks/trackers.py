"""Measure the cost of trackers, on their own and in whole runs with and without each tracker.

    python benchmarks/trackers.py                     (about five minutes on two idle cores)
    python benchmarks/trackers.py --rounds 1 --steps 50

Each run is a separate process. Each round consists of consecutive runs, and the reported ratio is the median of the
ratios within rounds. A point on the curves is logged about every 0.25 s, so a millisecond per point is 0.4 % of a run.
Nothing is sent, because wandb is offline.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from pictures import ROOT, run

POINTS = 300
CHOICES = {
    "none": [],
    "csv": ["csv"],
    "tensorboard": ["tensorboard"],
    "wandb": ["wandb"],
    "all": ["csv", "tensorboard", "wandb"],
}


def alone(names: list[str], folder: Path) -> None:
    """Print how long trackers take to open, including imports (s), to log a point (ms), and to finish a run (s)."""
    import lightning  # noqa: F401, PLC0415  (the program has it anyway)

    from brushexp.config.publish import prepare  # noqa: PLC0415
    from brushexp.plugins.logger.base import Run  # noqa: PLC0415
    from brushexp.registry import build_named  # noqa: PLC0415
    from brushexp.runs.tracking import Trackers  # noqa: PLC0415

    prepare(ROOT)
    begin = time.perf_counter()
    trackers = Trackers({name: build_named("logger", name, {}) for name in names}, Run(folder, name="a"))
    with trackers:
        opened = time.perf_counter()
        for step in range(POINTS):
            trackers.log_metrics({"loss/mse": 1 / (1 + step), "psnr": 20.0 + step, "seconds": 0.2 * step}, step)
            trackers.save()
        point = (time.perf_counter() - opened) / POINTS
        trackers.report(
            json.loads((folder / "metrics.json").read_text()),
            pictures={name: folder / f"{name}.png" for name in ("target", "painting")},
            files={"catalogue": folder / "catalogue.h5"},
        )
        half = time.perf_counter()
    print(opened - begin, 1e3 * point, time.perf_counter() - half)


def main() -> None:
    """Measure the trackers, and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="runs of each choice")
    parser.add_argument("--steps", type=int, default=300, help="steps of each run")
    options = parser.parse_args()
    os.environ["WANDB_MODE"] = "offline"
    steps: dict[str, list[float]] = {name: [] for name in CHOICES}
    seconds: dict[str, list[list[float]]] = {name: [] for name in CHOICES}
    with tempfile.TemporaryDirectory() as scratch:
        run(["resolution=64", "steps=2"], Path(scratch) / "first")
        for number in range(options.rounds):
            for name, chosen in CHOICES.items():
                folder = Path(scratch) / f"{name}_{number}"
                metrics = run([f"steps={options.steps}", f"logger=[{','.join(chosen)}]"], folder)
                steps[name].append(1e3 * metrics["seconds"] / metrics["steps"])
                code = f"from pathlib import Path; from trackers import alone; alone({chosen}, Path({str(folder)!r}))"
                command = [sys.executable, "-W", "ignore", "-c", code]
                done = subprocess.run(command, check=True, cwd=sys.path[0], capture_output=True, text=True)
                seconds[name].append([float(word) for word in done.stdout.split()[-3:]])
    print("| logger | ms per step | times none | ms per point of the curves | seconds to begin | seconds to end |")
    print("|---|---|---|---|---|---|")
    for name in CHOICES:
        ratios = [mine / none for mine, none in zip(steps[name], steps["none"], strict=True)]
        begin, point, end = (statistics.median(part) for part in zip(*seconds[name], strict=True))
        spread = f"{min(ratios):.3f} to {max(ratios):.3f}"
        print(
            f"| {name} | {statistics.median(steps[name]):.2f} | {statistics.median(ratios):.3f} ({spread}) "
            f"| {point:.2f} | {begin:.2f} | {end:.2f} |"
        )


if __name__ == "__main__":
    main()
