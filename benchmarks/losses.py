"""Measure the cost of losses: milliseconds per gradient step at 512 x 512 pixels, and the ratio to a step with mse.

    python benchmarks/losses.py                    every loss that needs no file (about two minutes on two idle cores)
    python benchmarks/losses.py lpips perceptual   only these losses

Every table comes from a single run: compare the ratios, not the milliseconds. The target's features are computed in
advance.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import brushexp  # noqa: F401  (before torch: it sets how threads wait and memory is kept, as for the program)

# isort: split
import torch
from omegaconf import OmegaConf
from step import BACKGROUND, scene

from brushexp.errors import UserError
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.loss.base import Loss, PaintedView
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.registry import build, plugins
from brushexp.registry.loading import load_plugins

SIDE = 512
N = SIDE * SIDE // 100
WARM = 5  # uncounted steps: perceptual views the target at four offsets


def on_the_picture(loss: Loss) -> Callable[[], None]:
    """Make a function that computes a loss and its gradient with respect to the picture and the strokes."""
    image = torch.rand(3, SIDE, SIDE, requires_grad=True)
    target, strokes = torch.rand(3, SIDE, SIDE), scene(N, SIDE).map(lambda value: value.requires_grad_())

    def step() -> None:
        image.grad = None
        loss(PaintedView(image, target, strokes)).backward()

    return step


def of_a_painting(losses: list[Loss]) -> Callable[[], None]:
    """Make a function that renders strokes and computes the gradient of a weighted sum of losses."""
    leaves = scene(N, SIDE).map(lambda value: value.requires_grad_())
    target, order, renderer, blend = torch.rand(3, SIDE, SIDE), torch.arange(N), Analytic(), Tiled()

    def step() -> None:
        for _, value in leaves.items():
            value.grad = None
        image = blend(renderer(leaves), order, (SIDE, SIDE), BACKGROUND).image
        painting = PaintedView(image, target, leaves)
        torch.stack([loss.weight * loss(painting) for loss in losses]).sum().backward()

    return step


def against(function: Callable[[], None], other: Callable[[], None], runs: int) -> tuple[float, float]:
    """Time two steps in alternation; return the median time of the first in ms, and its median ratio to the second."""
    for _ in range(WARM):
        function()
        other()
    times = [[_milliseconds(f) for f in (function, other)] for _ in range(runs)]
    return statistics.median(a for a, _ in times), statistics.median(a / b for a, b in times)


def _milliseconds(function: Callable[[], None]) -> float:
    start = time.perf_counter()
    function()
    return 1e3 * (time.perf_counter() - start)


def main(chosen: list[str], runs: int) -> None:
    """Measure the chosen losses, and print the table."""
    load_plugins(Path(__file__).parents[1] / "plugins")
    nodes = {plugin.name: OmegaConf.structured(plugin.config) for plugin in plugins("loss")}
    mse: Loss = build(nodes["mse"])
    print(f"\n{SIDE} x {SIDE} px, {N:,} strokes, forward + backward, {torch.get_num_threads()} threads\n")
    print("| loss | alone, ms | alone, times mse | step with it, ms | step with it, times that of mse | with mse too |")
    print("|---|---|---|---|---|---|")
    for name, node in nodes.items():
        if chosen and name not in chosen:
            continue
        try:
            loss: Loss = build(node)
            alone, times = against(on_the_picture(loss), on_the_picture(mse), runs)
            step, ratio = against(of_a_painting([loss]), of_a_painting([mse]), runs)
            _, both = against(of_a_painting([mse, loss]), of_a_painting([mse]), runs)
        except UserError as error:
            print(f"| {name} | needs more: {error} | | | | |")
            continue
        print(f"| {name} | {alone:.1f} | {times:.1f} | {step:.1f} | {ratio:.2f} | {both:.2f} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("losses", nargs="*", help="names of losses; all by default")
    parser.add_argument("--runs", type=int, default=15, help="steps to take the median of")
    arguments = parser.parse_args()
    main(arguments.losses, arguments.runs)
