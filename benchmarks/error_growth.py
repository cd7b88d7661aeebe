"""Measure errors of float32 kernels against float64 for many layers or pixels, and opaque, distant or thin strokes.

    python benchmarks/error_growth.py                       tables (20 s of processor time, 1.4 GB)
    python benchmarks/error_growth.py --plots docs/images   also draw the plots numerics_*.png

The reference is eager PyTorch in float64 on exactly the same (float32) strokes. The error in a picture is the largest
difference at any pixel and channel. The error in the gradient of a randomly weighted sum of the pixels is
|g - G| / |G| over all strokes, for the field with the largest error. Errors are the same on every machine except for
differences in the last bits, which depend on the vector unit.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import brushexp  # noqa: F401  (before torch: it sets how threads wait)

# isort: split
import numpy as np
import torch
from brushexp_studies.plotting import COLORS, MARKERS, new_figure, save_figure, tidy
from matplotlib.figure import Figure
from PIL import Image
from torch import Tensor

from brushexp.compositing.passes import sum_by_stroke
from brushexp.pictures.similarity import dissimilarity, statistics
from brushexp.plugins.blend.base import Blend
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.base import Renderer
from brushexp.plugins.renderer.textured import Textured
from brushexp.strokes.catalogue import Strokes
from brushexp.system.runtime import peak_memory

BACKGROUND = torch.tensor([0.2, 0.5, 0.9])
EXACT, SHIPPED = Tiled(opaque=0.0), Tiled()
REFERENCE = Tiled(opaque=0.0, kernel="torch")
RENDERERS: dict[str, Renderer] = {
    "analytic": Analytic(),
    "textured": Textured(checkpoint=None).requires_grad_(False).eval(),
}
LEAST = 1e-10  # smallest error that the plots show


@dataclass(frozen=True)
class Errors:
    """Errors in a picture and in its gradient."""

    picture: float
    gradient: float


Table = dict[float, dict[str, Errors]]  # variable -> kernel -> errors


def strokes_of(n: int, *, side: float = 8.0, length: float = 12.0, width: float = 7.0, seed: int = 0) -> Strokes:
    """Make ``n`` slightly bent, opaque strokes in random directions near the centre of ``side`` x ``side`` pixels."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator)

    angle = 2 * torch.pi * uniform(n)
    half = torch.stack([angle.cos(), angle.sin()], -1) * (0.8 + 0.4 * uniform(n))[:, None]
    return Strokes(
        position=side * (1 + uniform(n, 2)) / 3,
        scale=torch.full((n,), length),
        start=-half,
        control=0.15 * half.norm(dim=1, keepdim=True) * torch.randn(n, 2, generator=generator),
        end=half,
        width=width / length * (0.8 + 0.4 * uniform(n)),
        color=uniform(n, 3),
        opacity=torch.ones(n),
    )


def paint_with_gradients(
    blend: Blend, renderer: Renderer, strokes: Strokes, size: tuple[int, int], weight: Tensor
) -> tuple[Tensor, dict[str, Tensor]]:
    """Return the picture's rightmost columns, and the gradient of their weighted sum with respect to each field."""
    leaves = strokes.map(lambda value: value.clone().requires_grad_())
    image = blend(renderer(leaves), torch.arange(len(strokes)), size, BACKGROUND.to(strokes.width)).image
    image = image[:, :, -weight.shape[2] :]
    (image * weight.to(image)).sum().backward()
    return image.detach().double(), {name: leaf.grad.double() for name, leaf in leaves.items() if leaf.grad is not None}


def errors_of(blend: Blend, renderer: Renderer, strokes: Strokes, side: int, *, far: int = 0) -> Errors:
    """Measure the errors for float32 strokes on ``side`` x ``side`` pixels, moved ``far`` pixels to the right.

    The canvas has ``far`` additional columns on the left. The moved strokes are rounded to float32; the reference
    paints the rounded strokes, moved back to the origin.
    """
    weight = torch.randn(3, side, side, generator=torch.Generator().manual_seed(1))
    moved = strokes.moved(shift=(far, 0))
    image, gradient = paint_with_gradients(blend, renderer, moved, (side, far + side), weight)
    here = moved.map(Tensor.double).moved(shift=(-far, 0))
    exact, slope = paint_with_gradients(REFERENCE, renderer, here, (side, side), weight)
    apart = [
        float((gradient[name] - slope[name]).norm() / slope[name].norm())
        for name in slope
        if slope[name].norm() > 1e-12 * len(strokes)
    ]
    return Errors(float((image - exact).abs().max()), max(apart, default=0.0))


def layers() -> Table:
    """Measure errors for increasing numbers of strokes over the same 64 pixels."""
    found: Table = {}
    for n in (1, 3, 10, 30, 100, 300, 1000, 3000, 10_000):
        found[n] = {}
        for name, opacity in (("opaque", 1.0), ("alpha 0.5", 0.5), ("alpha 0.001", 0.001)):
            strokes = strokes_of(n)
            strokes = replace(strokes, opacity=torch.full((n,), opacity))
            found[n][name] = errors_of(EXACT, RENDERERS["analytic"], strokes, 8)
            found[n][f"{name}, textured"] = errors_of(EXACT, RENDERERS["textured"], strokes, 8)
            if opacity == 0.5:
                found[n][f"{name}, cut at 5e-5"] = errors_of(SHIPPED, RENDERERS["analytic"], strokes, 8)
    return found


def opacities() -> Table:
    """Measure errors for 30 strokes over the same pixels as alpha approaches 1."""
    found: Table = {}
    for k in range(1, 9):
        strokes = strokes_of(30)
        strokes = replace(strokes, opacity=torch.full((30,), 1.0 - 10.0**-k))
        found[10.0**-k] = {name: errors_of(EXACT, RENDERERS[name], strokes, 8) for name in RENDERERS}
        found[10.0**-k]["analytic, cut at 5e-5"] = errors_of(SHIPPED, RENDERERS["analytic"], strokes, 8)
    return found


def distances() -> Table:
    """Measure errors for strokes at increasing distances from the origin."""
    found: Table = {}
    for far in (0, 8, 80, 800, 8000, 80_000, 1_000_000):
        strokes = strokes_of(20, side=24.0)
        found[max(far, 1)] = {name: errors_of(EXACT, RENDERERS[name], strokes, 24, far=far) for name in RENDERERS}
    return found


def sizes() -> tuple[Table, Table]:
    """Measure errors for small strokes, both absolute and relative to the change that the strokes cause."""
    plain, relative = Table(), Table()
    renderers = RENDERERS | {"analytic, taper 0.5": Analytic(taper=0.5)}
    for exponent in range(2, -9, -1):
        pixels = 10.0 ** (exponent / 2)
        shapes = {"thin": (10.0, pixels), "short": (pixels, 1.0), "thin and short": (pixels, pixels)}
        plain[pixels], relative[pixels] = {}, {}
        for name, renderer in renderers.items():
            for what, (length, width) in shapes.items():
                if name != "analytic" and what != "thin and short":
                    continue
                strokes = strokes_of(60, side=24.0, length=length, width=width)
                strokes = replace(strokes, position=24 * torch.rand(60, 2, generator=torch.Generator().manual_seed(2)))
                found = errors_of(EXACT, renderer, strokes, 24)
                plain[pixels][f"{name}: {what}"] = found
                weight = torch.zeros(3, 24, 24)
                image = paint_with_gradients(REFERENCE, renderer, strokes.map(Tensor.double), (24, 24), weight)[0]
                change = float((image - BACKGROUND.double().view(3, 1, 1)).abs().max())
                relative[pixels][f"{name}: {what}"] = replace(found, picture=found.picture / max(change, 1e-30))
    return plain, relative


def values(count: int, part: Tensor) -> Iterator[Tensor]:
    """Repeat ``part`` to yield ``count`` float32 numbers in chunks."""
    while count > 0:
        yield part[:count]
        count -= len(part)


def sums() -> dict[int, dict[str, float]]:
    """Measure relative errors in float32 means over pixels: losses, a stroke's gradient, and a running sum."""
    generator = torch.Generator().manual_seed(0)
    image, target = torch.rand(2, 3, 600, 600, generator=generator)
    parts = {
        "mse": (image - target).square().flatten(),
        "l1": (image - target).abs().flatten(),
        "ssim": dissimilarity(image, target, *statistics(target)).flatten(),
    }
    found: dict[int, dict[str, float]] = {}
    for exponent in range(2, 9):
        pixels, row = 10**exponent, {}
        for name, part in parts.items():
            exact = sum(float(piece.double().sum()) for piece in values(pixels, part)) / pixels
            whole = torch.cat(list(values(pixels, part)))
            row[name] = abs(float(whole.sum() / pixels if name == "ssim" else whole.mean()) - exact) / exact
            if name == "mse":
                row["(running sum in float32)"] = abs(float(sum_in_sequence(whole.numpy())) / pixels - exact) / exact
                row["gradient of a stroke on all pixels"] = of_a_stroke(whole)
            del whole
        found[pixels] = row
    return found


def sum_in_sequence(numbers: "np.ndarray[tuple[int], np.dtype[np.float32]]") -> np.float32:
    """Sum numbers in sequence, in float32."""
    total = np.float32(0)
    for begin in range(0, len(numbers), 10**7):
        piece = numbers[begin : begin + 10**7].copy()
        piece[0] += total
        total = np.add.accumulate(piece)[-1]
    return total


def of_a_stroke(numbers: Tensor) -> float:
    """Measure the relative error in a float32 sum accumulated within tiles of 64 pixels, and then over the tiles."""
    tiles = numbers[: len(numbers) // 64 * 64].reshape(-1, 64)
    pairs = np.zeros((len(tiles), 1), np.float32)
    for k in range(64):
        pairs[:, 0] += tiles[:, k].numpy()
    out = np.empty((1, 1), np.float32)
    one = np.ones(len(pairs), bool), np.array([0, len(pairs)]), np.zeros(1, np.int64)
    sum_by_stroke(pairs, *one, out)
    exact = sum(float(piece.double().sum()) for piece in tiles.split(10**5))
    return abs(float(out[0, 0]) - exact) / exact


def save_small(figure: Figure, path: Path) -> None:
    """Save a figure as a PNG reduced to 64 colours, which takes a third of the space."""
    save_figure(figure, path)
    with Image.open(path) as image:
        few = image.convert("RGB").quantize(64)
    few.save(path, optimize=True)


def show(title: str, varies: str, table: Table) -> None:
    """Print a Markdown table with the errors in the picture and the gradient in each cell."""
    names = list(next(iter(table.values())))
    print(f"\n{title}\n\n| {varies} | {' | '.join(names)} |\n|{'---|' * (len(names) + 1)}")
    for x, row in table.items():
        cells = [f"{row[name].picture:.0e} / {row[name].gradient:.0e}" for name in names]
        print(f"| {x:g} | {' | '.join(cells)} |", flush=True)


def plot(path: Path, varies: str, table: Table, *, falling: bool = False, picture: str = "picture") -> None:
    """Plot the errors in the picture and the gradient side by side, on logarithmic axes."""
    figure = new_figure(4.2)
    for axes, what in zip(figure.subplots(1, 2), ("picture", "gradient"), strict=True):
        for number, name in enumerate(next(iter(table.values()))):
            found = [max(getattr(row[name], what), LEAST) for row in table.values()]
            if max(found) > LEAST:
                look = {"color": COLORS[number % len(COLORS)], "marker": MARKERS[number % len(MARKERS)]}
                axes.plot(list(table), found, label=name, markersize=4, linewidth=1.2, **look)
        label = picture if what == "picture" else "gradient, relative"
        axes.set(xscale="log", yscale="log", xlabel=varies, ylabel=f"error of the {label}")
        if falling:
            axes.invert_xaxis()
        tidy(axes)
        if what == "picture":
            axes.legend(fontsize=8, frameon=False)
    save_small(figure, path)


def plot_sums(path: Path, table: dict[int, dict[str, float]]) -> None:
    """Plot the relative errors in sums against the number of pixels."""
    figure = new_figure(4.2)
    axes = figure.subplots()
    for number, name in enumerate(next(iter(table.values()))):
        look = {"color": COLORS[number], "marker": MARKERS[number]}
        axes.plot(list(table), [max(row[name], LEAST) for row in table.values()], label=name, markersize=4, **look)
    axes.set(xscale="log", yscale="log", xlabel="pixels", ylabel="relative error")
    tidy(axes)
    axes.legend(fontsize=8, frameon=False)
    save_small(figure, path)


def main(plots: Path | None) -> None:
    """Run all studies one after another."""
    studies: tuple[tuple[str, str, str, Callable[[], Table], bool], ...] = (
        ("layers", "Layers over each other: picture / gradient", "strokes over the same pixels", layers, False),
        ("alpha", "Alpha near 1, 30 strokes: picture / gradient", "1 - alpha", opacities, True),
        ("distance", "Far from the origin, 20 strokes: picture / gradient", "pixels from the origin", distances, False),
    )
    for name, title, varies, study, falling in studies:
        table = study()
        show(title, varies, table)
        if plots:
            plot(plots / f"numerics_{name}.png", varies, table, falling=falling)
    plain, relative = sizes()
    show("Strokes below a pixel, 60 strokes: picture / gradient", "pixels", plain)
    show("The same, the picture's error as a part of its largest change", "pixels", relative)
    if plots:
        picture = "picture, of its largest change"
        plot(plots / "numerics_size.png", "length or width, pixels", relative, falling=True, picture=picture)
    table = sums()
    names = list(table[100])
    print(f"\nMeans over pixels, relative error\n\n| pixels | {' | '.join(names)} |\n|{'---|' * (len(names) + 1)}")
    for pixels, row in table.items():
        print(f"| {pixels:.0e} | {' | '.join(f'{row[name]:.0e}' for name in names)} |", flush=True)
    if plots:
        plot_sums(plots / "numerics_pixels.png", table)
    print(f"\nMost memory of the process: {peak_memory():.0f} MB")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plots", type=Path, help="folder for the plots, e.g. docs/images")
    main(parser.parse_args().plots)
