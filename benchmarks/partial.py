"""Compare steps that update part of the canvas with steps on the whole canvas, by time and memory.

    python benchmarks/partial.py            (about three minutes on two idle cores)

Every table comes from a single run: compare the ratios, not the seconds. Each row is measured in a separate process,
so that its peak memory does not include the memory of other rows.
"""

import argparse
import statistics
import subprocess
import sys
import time
from typing import Any

import brushexp  # noqa: F401  (before torch: it sets how threads wait)

# isort: split
import lightning as L
import torch
from brushexp_policies.patches import Patches
from step import scene

from brushexp.painting.components import standard_components
from brushexp.painting.stroke_optimizer import StrokeOptimizer
from brushexp.plugins.sampler.whole import Whole
from brushexp.strokes.catalogue import Catalogue
from brushexp.system.runtime import peak_memory

STEPS = 30


class StepTimes(L.Callback):
    """Callback that records the duration of each step in seconds."""

    def __init__(self) -> None:
        self.seconds: list[float] = []

    def on_train_batch_start(self, *_: object) -> None:
        self.begin = time.perf_counter()

    def on_train_batch_end(self, *_: object) -> None:
        self.seconds.append(time.perf_counter() - self.begin)


def row(side: int, sampler: str) -> None:
    """Print the time (ms) and peak memory of steps on ``side`` x ``side`` pixels with one stroke per 105 pixels."""
    target = torch.rand(3, side, side)
    parts = standard_components(steps=10**6, sampler=Whole() if sampler == "whole" else Patches())
    strokes = scene(side * side // 105, side)
    before = peak_memory()
    painter = StrokeOptimizer(Catalogue(strokes, parts.optimizer.units), parts, target, torch.ones(3), seed=0)
    times = StepTimes()
    options: dict[str, Any] = {"enable_progress_bar": False, "enable_checkpointing": False, "logger": False}
    L.Trainer(max_steps=STEPS, accelerator="cpu", enable_model_summary=False, callbacks=[times], **options).fit(painter)
    canvas = 2 * target.numel() * 4 / 2**20  # the target, and the latest picture
    print(
        f"| {side * side / 1e6:.1f} | {len(strokes):,} | {sampler} | {1e3 * statistics.median(times.seconds):.1f} "
        f"| {peak_memory() - before:.0f} | {canvas:.0f} |",
        flush=True,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args()
    print("| megapixels | strokes | sampler | ms per step | peak MB beyond the start | of which target and canvas |")
    print("|---|---|---|---|---|---|", flush=True)
    for side in (512, 1024, 2048, 4096):
        for sampler in ("whole", "patches"):
            code = f"from partial import row; row({side}, {sampler!r})"
            subprocess.run([sys.executable, "-c", code], check=True, cwd=sys.path[0])
