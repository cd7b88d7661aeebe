"""Measure the time that blending only the top k layers saves (thesis 2020, 6.3); the rest of a step is not timed.

    python benchmarks/blending.py            (a minute on one idle core, 3 GB of memory)

The layers are 384 strokes on 196 x 196 pixels, with colours that vary from pixel to pixel. They are blended, and
gradients are backpropagated, in three ways: all layers; the top k nonempty layers, where k is the largest number of
nonempty layers at any pixel (eq. 6.8); and the same k layers with the thesis's product over pairs of layers (eq. 6.16
to 6.21). All three produce the same picture. The results for five scenes are recorded for ``task=verdicts``.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import brushexp  # noqa: F401  (before torch: it sets how threads wait)

# isort: split
import pandas as pd
import torch
from brushexp_thesis.study_records import Study
from torch import Tensor

from brushexp.plugins.blend.base import pixel_centres
from brushexp.plugins.blend.dense import over
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.strokes.catalogue import Strokes

N, SIDE, RUNS, SCENES = 384, 196, 5, 5
RECORD = Path(__file__).parents[1] / "docs" / "ablations" / "blending.csv"
QUESTION = "Not counting rendering, how much time does blending only the uppermost layers save?"


def layers_of(seed: int) -> tuple[Tensor, Tensor]:
    """Scatter short strokes around lattice points; return alpha (1, N, P) and slightly varied colours (1, N, P, 3)."""
    generator = torch.Generator().manual_seed(seed)
    pitch = SIDE / N**0.5
    place = (torch.cartesian_prod(*2 * [torch.arange(20.0)])[:N] + 0.5) * SIDE / 20
    angle = torch.rand(N, generator=generator) * torch.pi
    along = torch.stack([angle.cos(), angle.sin()], -1) * pitch / 64
    strokes = Strokes(
        position=place + 0.3 * pitch * torch.randn(N, 2, generator=generator),
        scale=torch.full((N,), 64.0), start=-along, control=torch.zeros(N, 2), end=along,
        width=torch.full((N,), 0.5 * pitch / 64), color=torch.rand(N, 3, generator=generator),
        opacity=torch.full((N,), 0.95),
    )  # fmt: skip
    points = pixel_centres(torch.arange(SIDE * SIDE), SIDE, torch.float32)[None]
    alpha, color = Analytic()(strokes).sample(torch.arange(N)[None], points)
    shade = 0.9 + 0.1 * torch.rand(1, N, SIDE * SIDE, 1, generator=generator)
    return alpha.detach(), color.detach() * shade


def uppermost(alpha: Tensor, color: Tensor, k: int) -> tuple[Tensor, Tensor]:
    """Gather the alpha (1, k, P) and the colours (1, k, P, 3) of the top k nonempty layers at each pixel."""
    filled = alpha > 0
    rank = torch.where(filled, filled.cumsum(1) - 1, k).clamp_max(k)
    place = torch.zeros(1, k + 1, alpha.shape[2], dtype=torch.long)
    place.scatter_(1, rank, torch.arange(alpha.shape[1])[:, None].expand_as(rank))
    chosen = place[:, :k]
    present = torch.arange(k)[:, None] < filled.sum(1, keepdim=True)
    return alpha.gather(1, chosen) * present, color.gather(1, chosen[..., None].expand(*chosen.shape, 3))


def over_in_pairs(alpha: Tensor, color: Tensor) -> Tensor:
    """Blend k layers as the thesis does, using a product over all pairs of layers (1, k, k, P)."""
    k = alpha.shape[1]
    lies_above = torch.ones(k, k, dtype=torch.bool).tril(-1)[None, :, :, None]
    above = torch.where(lies_above, 1 - alpha[:, None], 1.0).prod(2)
    return ((above * alpha)[..., None] * color).sum(1)


def cpu_seconds_of(blend: Callable[[Tensor, Tensor], Tensor], alpha: Tensor, color: Tensor) -> tuple[float, Tensor]:
    """Time a forward and backward pass, after an untimed run; return the median CPU time and the blended picture."""
    times = []
    for _ in range(RUNS + 1):
        leaves = [one.clone().requires_grad_() for one in (alpha, color)]
        start = time.process_time()
        picture = blend(*leaves)
        picture.square().mean().backward()
        times.append(time.process_time() - start)
    return statistics.median(times[1:]), picture.detach()


def main() -> None:
    """Measure the times, print them and record them."""
    torch.set_num_threads(1)
    rows, begin = {}, time.process_time()
    for seed in range(SCENES):
        alpha, color = layers_of(seed)
        k = int((alpha > 0).sum(1).max())
        ways: dict[str, Callable[[Tensor, Tensor], Tensor]] = {
            "layers=all": lambda a, c: over(a, c)[0],
            "layers=uppermost": lambda a, c, k=k: over(*uppermost(a, c, k))[0],  # type: ignore[misc]
            "layers=uppermost_in_pairs": lambda a, c, k=k: over_in_pairs(*uppermost(a, c, k)),  # type: ignore[misc]
        }
        pictures = []
        for name, blend in ways.items():
            rows[name, str(seed)], picture = cpu_seconds_of(blend, alpha, color)
            pictures.append(picture)
        for picture in pictures[1:]:
            torch.testing.assert_close(picture, pictures[0])
        ratios = [rows["layers=all", str(seed)] / rows[name, str(seed)] for name in list(ways)[1:]]
        print(f"scene {seed}: k = {k}, top k {ratios[0]:.2f} and in pairs {ratios[1]:.2f} times as fast", flush=True)
    index = pd.MultiIndex.from_tuples(sorted(rows, key=lambda key: list(ways).index(key[0])), names=["option", "seed"])
    table = pd.DataFrame({"cpu_seconds": [rows[key] for key in index]}, index)
    cost = f"{(time.process_time() - begin) / 3600:.2f} CPU hours, of blending and its gradient alone"
    Study("blending", ("python", "benchmarks/blending.py"), table, *3 * [len(rows)], cost, QUESTION).record(RECORD)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args()
    main()
