"""Measure the time and memory of gradient steps, and compare the compiled blend with eager PyTorch and top-k.

    python benchmarks/step.py            everything (about four minutes on two idle cores, 10 GB of memory)
    python benchmarks/step.py --quick    without the eager blends
    python benchmarks/step.py --lightning    only the cost of Lightning

Every table comes from a single run: compare the ratios, not the seconds.
"""

import argparse
import math
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import brushexp  # noqa: F401  (before torch: it sets how threads wait)

# isort: split
import torch
from brushexp_policies.topk import TopK

from brushexp.painting.components import Components, standard_components
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.loss.base import PaintedView, weighted_sum
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.strokes.catalogue import Catalogue, Strokes
from brushexp.system.runtime import peak_memory

BACKGROUND = torch.ones(3)


def scene(n: int, side: int) -> Strokes:
    """Make ``n`` slightly bent strokes, 15 to 35 px long and 4 to 12 px wide, on ``side`` x ``side`` pixels."""
    torch.manual_seed(0)
    length, angle = 15 + 20 * torch.rand(n), math.pi * torch.rand(n)
    along = torch.stack([angle.cos(), angle.sin()], -1) * length[:, None] / 64
    return Strokes(
        position=torch.rand(n, 2) * side,
        scale=torch.full((n,), 64.0),
        start=-along,
        control=torch.randn(n, 2) * 3 / 32,
        end=along,
        width=(4 + 8 * torch.rand(n)) / 64,
        color=torch.rand(n, 3),
        opacity=torch.full((n,), 0.95),
    )


def gradient_step(blend: Blend, strokes: Strokes, target: torch.Tensor) -> Callable[[], tuple[torch.Tensor, ...]]:
    """Make a function that takes one step: forward pass, mean squared error, backward pass."""
    leaves = strokes.map(lambda value: value.clone().requires_grad_(bool(value.any())))
    order, size = torch.arange(len(strokes)), (target.shape[1], target.shape[2])
    renderer = Analytic()

    def step() -> tuple[torch.Tensor, ...]:
        for _, value in leaves.items():
            value.grad = None
        image = blend(renderer(leaves), order, size, BACKGROUND).image
        (image - target).square().mean().backward()
        return image.detach(), *(value.grad for _, value in leaves.items() if value.grad is not None)

    return step


def seconds_of(function: Callable[[], object], runs: int) -> float:
    """Return the median wall time of a function in seconds, after an untimed run."""
    function()
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def against_eager() -> None:
    """Compare the compiled blend with eager PyTorch on the same tile lists and with the thesis's top-k blend."""
    strokes, target = scene(10_000, 1024), torch.rand(3, 1024, 1024)
    fast = gradient_step(Tiled(), strokes, target)
    reference, seconds = fast(), seconds_of(fast, 15)
    print("\n1024 x 1024 px, 10,000 strokes, forward + backward\n")
    print("| blend | ms per step | relative to tiled | picture, max difference | gradient, relative difference |")
    print("|---|---|---|---|---|")
    print(f"| tiled (Numba) | {1e3 * seconds:.1f} | 1 | | |")
    rivals = {"tiled, eager PyTorch": Tiled(opaque=0.0, kernel="torch")}
    rivals |= {f"topk, k={k}": TopK(k=k) for k in (4, 8, 16)}
    for name, blend in rivals.items():
        slow = gradient_step(blend, strokes, target)
        result = slow()
        other = seconds_of(slow, 1)
        again = seconds_of(fast, 5)  # right after the slow step, so that both are timed under the same load
        picture = (result[0] - reference[0]).abs().max()
        gradient = max(float((a - b).norm() / b.norm()) for a, b in zip(reference[1:], result[1:], strict=True))
        print(f"| {name} | {1e3 * other:.0f} | {other / again:.0f} | {picture:.1e} | {gradient:.1e} |", flush=True)


@torch.no_grad()
def against_double() -> None:
    """Print the maximum deviation of float32 pictures from eager PyTorch in float64."""
    strokes, order = scene(10_000, 1024), torch.arange(10_000)

    def picture(blend: Blend, dtype: torch.dtype) -> torch.Tensor:
        layers = Analytic()(strokes.map(lambda value: value.to(dtype)))
        return blend(layers, order, (1024, 1024), BACKGROUND.to(dtype)).image

    eager = Tiled(opaque=0.0, kernel="torch")
    exact = picture(eager, torch.float64)
    for name, blend in (("tiled (Numba)", Tiled()), ("eager PyTorch in float32", eager)):
        print(f"\n{name} differs from float64 by {(picture(blend, torch.float32) - exact).abs().max():.1e} at most")


def growth() -> None:
    """Print the time of a step for increasing numbers of pixels and strokes."""
    print("\nGrowth at 105 px per stroke\n")
    print("| megapixels | strokes | ms per step | per megapixel, relative to the first row |")
    print("|---|---|---|---|")
    first = 0.0
    for side in (1024, 2048, 4096):
        n = side * side // 105
        seconds = seconds_of(gradient_step(Tiled(), scene(n, side), torch.rand(3, side, side)), 7)
        each = seconds / (side * side)
        first = first or each
        print(f"| {side * side / 1e6:.1f} | {n:,} | {1e3 * seconds:.0f} | {each / first:.2f} |", flush=True)


def switches() -> None:
    """Print the time of a step for different options of the blend."""
    strokes, target = scene(10_000, 1024), torch.rand(3, 1024, 1024)
    print("\nSwitches of the tiled blend, 1024 x 1024 px, 10,000 strokes\n\n| setting | ms per step |\n|---|---|")
    for text, blend in (
        ("default (opaque 5e-5)", Tiled()),
        ("no stroke skipped (opaque 0)", Tiled(opaque=0.0)),
        ("opaque 1/512", Tiled(opaque=1 / 512)),
    ):
        print(f"| {text} | {1e3 * seconds_of(gradient_step(blend, strokes, target), 9):.1f} |", flush=True)


def memory() -> None:
    """Print the peak memory of ten steps at one megapixel, without the imports, measured in a separate process."""
    code = "from step import memory_of_ten_steps; memory_of_ten_steps()"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=sys.path[0])


def memory_of_ten_steps() -> None:
    """Print the increase in this process's peak memory during ten steps."""
    Tiled()
    before = peak_memory()
    step = gradient_step(Tiled(), scene(10_000, 1024), torch.rand(3, 1024, 1024))
    for _ in range(10):
        step()
    print(
        f"\nMemory of ten steps at 1024 x 1024 px, 10,000 strokes, beyond the imports: {peak_memory() - before:.0f} MB"
    )


def lightning_cost(blocks: int = 12, steps: int = 15) -> None:
    """Compare a step in Lightning, with the callbacks of a run, with a step in a bare loop over the same components.

    The bare loop does not check that its results are finite; the cost of this check is printed in a separate row.
    """
    import lightning as L  # noqa: PLC0415

    from brushexp.painting.stroke_optimizer import StrokeOptimizer  # noqa: PLC0415
    from brushexp.painting.timelapse import Timelapse  # noqa: PLC0415
    from brushexp.runs.trainer import NoProfiler  # noqa: PLC0415
    from brushexp.system.callbacks import ProgressBar, TimedCheckpoint  # noqa: PLC0415

    target, strokes = torch.rand(3, 512, 512), scene(2621, 512)
    parts = standard_components(steps=10**6)
    painter = StrokeOptimizer(Catalogue(strokes, parts.optimizer.units), parts, target, BACKGROUND, seed=0)
    bare = bare_step(Catalogue(strokes, parts.optimizer.units), parts, target)
    times: dict[str, list[float]] = {"bare": [], "lightning": [], "bare, only the check for finite numbers": []}

    class Alternate(L.Callback):
        """Callback that takes an equal number of bare steps after each block of Lightning steps."""

        begin = 0.0

        def on_train_batch_end(self, trainer: L.Trainer, *_: object) -> None:
            if trainer.global_step % steps == 0:
                if self.begin:
                    times["lightning"].append(time.process_time() - self.begin)
                begin = time.process_time()
                for _ in range(steps):
                    bare()
                times["bare"].append(time.process_time() - begin)
                begin = time.process_time()
                for _ in range(steps):
                    assert painter.catalogue.is_finite()
                    assert all(term.isfinite() for term in painter.terms.values())
                times["bare, only the check for finite numbers"].append(time.process_time() - begin)
                self.begin = time.process_time()

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        callbacks = [Alternate(), Timelapse(60, 360), ProgressBar(), TimedCheckpoint(path / "it", 60)]
        options: dict[str, Any] = {"enable_progress_bar": False, "enable_model_summary": False, "log_every_n_steps": 1}
        logger = L.pytorch.loggers.CSVLogger(path)
        options |= {"logger": logger, "callbacks": callbacks, "profiler": NoProfiler()}
        L.Trainer(max_steps=blocks * steps, accelerator="cpu", **options).fit(painter)
    each = {name: 1e3 * statistics.median(values) / steps for name, values in times.items()}
    print("\n512 x 512 px, 2,621 strokes: CPU time, medians of alternated blocks\n")
    print("| | ms per step | times bare |\n|---|---|---|")
    for name, milliseconds in each.items():
        print(f"| {name} | {milliseconds:.2f} | {milliseconds / each['bare']:.3f} |", flush=True)


def bare_step(catalogue: Catalogue, parts: Components, target: torch.Tensor) -> Callable[[], None]:
    """Make a function that takes one bare step: sample, render, blend, compute the loss, backpropagate and update."""
    optimizer = parts.optimizer.over(catalogue.parameters())
    renderer, size = parts.stages[0].renderer, (target.shape[1], target.shape[2])
    order, generator = torch.arange(len(catalogue)), torch.Generator()

    def step() -> None:
        with torch.no_grad():
            parts.sampler(catalogue(), size, 1, generator)
        strokes = catalogue()
        painting = PaintedView(parts.blend(renderer(strokes), order, size, BACKGROUND).image, target, strokes)
        total, _ = weighted_sum(parts.losses, painting)
        optimizer.zero_grad()
        total.backward()
        optimizer.step()
        catalogue.keep_in_range()
        renderer.clamp(catalogue())

    return step


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="skip the eager blends")
    parser.add_argument("--lightning", action="store_true", help="measure only the cost of Lightning")
    quick = parser.parse_args().quick
    lightning_cost()
    if parser.parse_args().lightning:
        sys.exit()
    switches()
    growth()
    memory()
    if not quick:
        against_eager()
        against_double()
