"""What partial updates cost and save: time and memory of a step against looking at the whole canvas.

    python benchmarks/partial.py            (about three minutes on two idle cores)

Every table is one run: read the ratios, not the seconds. Each row is a process of its own, for its peak of memory.
"""

import argparse
import statistics
import subprocess
import sys
import time

import brushexp  # noqa: F401  (before torch: it sets how threads wait)

# isort: split
import torch
from step import scene

from brushexp.painting.components import Components, Stage
from brushexp.painting.painter import Painter
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.density.fixed import Fixed
from brushexp.plugins.loss.pixel import MeanSquaredError
from brushexp.plugins.optimizer.torch_optim import TorchOptim
from brushexp.plugins.order.area import Area
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.sampler.patches import Patches
from brushexp.plugins.sampler.whole import Whole
from brushexp.strokes.catalogue import Catalogue
from brushexp.system.process import peak_memory

STEPS = 30


def row(side: int, sampler: str) -> None:
    """Print milliseconds and peak memory of steps on ``side`` x ``side`` pixels, one stroke per 105 of them."""
    target = torch.rand(3, side, side)
    parts = Components(
        stages=[Stage("analytic", Analytic(), 10**6)],
        blend=Tiled(),
        order=Area(),
        losses={"mse": MeanSquaredError()},
        density=Fixed(),
        sampler=Whole() if sampler == "whole" else Patches(),
        optimizer=TorchOptim(),
    )
    strokes = scene(side * side // 105, side)
    before = peak_memory()
    painter = Painter(Catalogue(strokes, parts.optimizer.units), parts, target, torch.ones(3), seed=0)
    optimizer, times = painter.configure_optimizers(), []
    painter.rehearse()
    for _ in range(STEPS):
        start = time.perf_counter()
        painter._take_step(optimizer)
        times.append(time.perf_counter() - start)
    canvas = 2 * target.numel() * 4 / 2**20  # the target, and the picture as it was last seen
    print(
        f"| {side * side / 1e6:.1f} | {len(strokes):,} | {sampler} | {1e3 * statistics.median(times):.1f} "
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
