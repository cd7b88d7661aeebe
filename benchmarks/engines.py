"""Compare brush simulators: their pictures of the same twelve strokes, their speed and their colour errors.

    python benchmarks/engines.py             print the tables
    python benchmarks/engines.py FIGURE.png  also draw the strokes

The strokes are copied from a picture made with Fluid Paint itself. They are 200 pixels long in a window of 256 pixels,
bent by 0, 50 and -80 pixels, with brush radii of 8, 15, 25 and 40 pixels.
"""

import sys
import time
from pathlib import Path

import brushexp  # noqa: F401  (before torch: it sets how threads wait)

# isort: split
import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from brushexp.config.publish import prepare
from brushexp.plugins.engine.base import Engine
from brushexp.registry import build_named, plugins
from brushexp.strokes.prior import parameters_of, sample_prior, width_parameter

RADII, BENDS = (8, 15, 25, 40), (0, 50, -80)  # in 256ths of the window
COLORS = ((1.0, 0.1, 0.1), (0.6, 0.8, 0.1), (0.55, 0.05, 0.4), (0.35, 0.5, 0.55))
LARGE = 256  # pixels of a large window in the figure
PAPER, HEAD = 0.953, 26
# Colours that dli/paint displays for the corners of its cube of pigments: red, blue and yellow, each 0 or 1.
CORNERS = {
    (0, 0, 0): (1, 1, 1), (1, 0, 0): (1, 0, 0), (0, 1, 0): (0.163, 0.373, 0.6), (0, 0, 1): (1, 1, 0),
    (1, 0, 1): (1, 0.5, 0), (0, 1, 1): (0, 0.66, 0.2), (1, 1, 0): (0.5, 0, 0.5), (1, 1, 1): (0.2, 0.094, 0),
}  # fmt: skip


def twelve() -> Tensor:
    """Return the parameters (12, 10) of the strokes, row by row."""
    rows = []
    for radius, color in zip(RADII, COLORS, strict=True):
        width = 2 * radius / 256
        scaled = width_parameter(width)
        for bend in BENDS:
            rows.append([-100 / 128, 0, 0, bend / 128, 100 / 128, 0, scaled, *(2 * c - 1 for c in color)])
    return torch.tensor(rows)


def over_paper(images: Tensor) -> Tensor:
    """Composite RGBA images (n, 4, S, S) over light grey paper; return RGB images (n, 3, S, S)."""
    return images[:, :3] * images[:, 3:] + PAPER * (1 - images[:, 3:])


def panel(name: str, window: int) -> np.ndarray:
    """Arrange the twelve strokes of one engine in four rows of three, as a picture (H, W, 3) uint8."""
    engine: Engine = build_named("engine", name, {"window": window})
    pictures = over_paper(engine(twelve(), seed=0).images)
    seen = slice(window * 3 // 16, window * 12 // 16)  # the rest of the window is empty
    rows = [torch.cat(list(pictures[3 * k : 3 * k + 3, :, seen]), dim=2) for k in range(4)]
    sheet = (torch.cat(rows, dim=1).permute(1, 2, 0) * 255).round().byte().numpy()
    zoom = LARGE // window
    return sheet.repeat(zoom, axis=0).repeat(zoom, axis=1)


def figure(names: list[str]) -> Image.Image:
    """Arrange the engines' strokes in columns: large windows at the top, magnified windows of 64 pixels below."""
    panels = [[panel(name, window) for name in names] for window in (LARGE, 64)]
    high, wide = panels[0][0].shape[:2]
    sheet = Image.new("RGB", (len(names) * (wide + 8), 2 * (high + HEAD)), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(18)
    for row, (window, line) in enumerate(zip((LARGE, 64), panels, strict=True)):
        for column, (name, picture) in enumerate(zip(names, line, strict=True)):
            x, y = column * (wide + 8), row * (high + HEAD)
            pen.text((x + 6, y + 2), f"engine={name}, window of {window} pixels", "#202020", font)
            sheet.paste(Image.fromarray(picture), (x, y + HEAD))
    return sheet


def strokes_per_second(name: str, options: dict[str, object], n: int = 512) -> float:
    """Measure how many strokes are simulated per second of wall time, after an untimed first batch."""
    engine: Engine = build_named("engine", name, options)
    parameters = parameters_of(sample_prior(2 * n))
    engine(parameters[:n], seed=0)
    start = time.perf_counter()
    engine(parameters[n:], seed=0, first=n)
    return n / (time.perf_counter() - start)


def color_error(name: str) -> tuple[float, float]:
    """Return the mean and 99th percentile of the colour error |shown - recorded|, 0 to 1, where alpha exceeds 0.5."""
    engine: Engine = build_named("engine", name, {})
    parameters = parameters_of(sample_prior(1000, seed=1))
    images = engine(parameters, seed=0).images
    off = (images[:, :3] - 0.5 * (parameters[:, 7:, None, None] + 1)).abs().mean(1)
    off = off[images[:, 3] > 0.5]
    return float(off.mean()), float(off.quantile(0.99)) if len(off) < 10**7 else float("nan")


def pigment_error(n: int = 2000, tried: int = 41) -> tuple[float, float]:
    """Estimate the mean and 99th percentile of the distance of random colours from the gamut of Fluid Paint."""
    grid = torch.linspace(0, 1, tried, dtype=torch.float64)
    points = torch.cartesian_prod(grid, grid, grid)
    shown = torch.zeros_like(points)
    for corner, color in CORNERS.items():
        weight = torch.stack([points[:, k] if corner[k] else 1 - points[:, k] for k in range(3)]).prod(0)
        shown += weight[:, None] * torch.tensor(color, dtype=torch.float64)
    wanted = torch.rand(n, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    nearest = torch.cat([torch.cdist(part, shown).argmin(1) for part in wanted.split(200)])
    off = (shown[nearest] - wanted).abs().mean(1)
    return float(off.mean()), float(off.quantile(0.99))


if __name__ == "__main__":
    prepare(Path(__file__).parents[1])
    names = [plugin.name for plugin in plugins("engine")]
    print("| engine | strokes/s | colour error, mean | 99th percentile |\n|---|---|---|---|")
    for name in names:
        mean, worst = color_error(name)
        print(f"| {name} | {strokes_per_second(name, {}):.0f} | {mean:.4f} | {worst:.4f} |", flush=True)
    mean, worst = pigment_error()
    print(f"| Fluid Paint's pigments, inverted (gamut alone) | | {mean:.4f} | {worst:.4f} |\n")
    print("| fluid with | strokes/s |\n|---|---|")
    for options in ({"supersample": 1}, {"projection": False}, {"bristles": 50}, {"window": 128}):
        label = ", ".join(f"engine.{key}={value}" for key, value in options.items())
        print(f"| {label} | {strokes_per_second('fluid', dict(options)):.0f} |", flush=True)
    if len(sys.argv) > 1:
        figure(names).save(sys.argv[1])
