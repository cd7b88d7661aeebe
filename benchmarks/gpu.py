"""Run everything that needs a GPU in one command: tests, step times, a painting, and a profile.

    python benchmarks/gpu.py kodim03.png    (a few minutes; needs the extras gpu and test)

The results and the name of the card are written to the last section of docs/gpu.md. The picture is optional; the
default is a scikit-image photograph, resampled to 768 x 512 pixels.
"""

import argparse
import re
import statistics
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import brushexp  # before torch: it sets how threads wait

# isort: split
import torch
from brushexp_media.colors.pigment import Pigment
from skimage import data, transform
from step import BACKGROUND, scene
from torch.autograd import DeviceType
from torch.profiler import ProfilerActivity, profile

from brushexp.plugins.blend.base import Compositor
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.textured import Textured

ROOT = Path(__file__).parents[1]
PAGE, HEADING = ROOT / "docs" / "gpu.md", "## Measured\n"
TESTS = ["tests/test_gpu.py", "packages/gpu/tests"]
SIDE, STROKES, PSNR = 1024, 10_000, 40
CARE = "run this where there is one, with a CUDA build of PyTorch and pip install -c constraints.txt -e '.[gpu,test]'"
Step = Callable[[], tuple[torch.Tensor, ...]]


def missing_requirement() -> str | None:
    """Describe what this machine lacks for the benchmark; return None if nothing is missing."""
    if not torch.cuda.is_available():
        return f"PyTorch {torch.__version__} finds no CUDA device"
    return None if find_spec("triton") else "Triton is not installed"


def step_of(kind: str, kernel: str, device: str = "cuda", side: int = SIDE, count: int = STROKES) -> Step:
    """Make a function that takes one step for one kind of stroke: forward pass, mean squared error, backward pass."""
    blend: Any = Tiled(kernel=kernel)
    blend = Compositor(blend, Pigment()) if kind == "pigment" else blend
    renderer = Textured().requires_grad_(False).eval() if kind == "textured" else Analytic()
    strokes = scene(count, side)
    if kind == "shaped":  # each stroke with its own edge, growth and change of colour, as in look=plain
        shapes = {"softness": 0.05 * torch.rand(count), "drift": 0.2 * torch.rand(count, 3) - 0.1}
        strokes = replace(strokes, widening=torch.rand(count) - 0.5, **shapes)
    leaves = strokes.map(lambda value: value.to(device).requires_grad_(bool(value.any())))
    target, order, bare = torch.rand(3, side, side, device=device), torch.arange(count, device=device), BACKGROUND
    renderer, bare = renderer.to(device), bare.to(device)

    def step() -> tuple[torch.Tensor, ...]:
        for _, value in leaves.items():
            value.grad = None
        image = blend(renderer(leaves), order, (side, side), bare).image
        (image - target).square().mean().backward()
        return image.detach(), *(value.grad for _, value in leaves.items() if value.grad is not None)

    return step


def seconds_of(step: Step, runs: int) -> tuple[float, float]:
    """Return the wall time of the first run, including compilation, and the median wall time of the later runs."""
    times = []
    for _ in range(runs + 1):
        start = time.perf_counter()
        step()
        torch.cuda.synchronize()
        times.append(time.perf_counter() - start)
    return times[0], statistics.median(times[1:])


def steps() -> Iterator[str]:
    """Compare Triton's steps with PyTorch's for all kinds of strokes."""
    yield "| strokes | Triton ms | PyTorch ms | speed-up | first step s | memory MB | picture, difference | gradient |"
    yield "|---|---|---|---|---|---|---|---|"
    for kind in ("plain", "shaped", "textured", "pigment"):
        fast, slow = step_of(kind, "triton"), step_of(kind, "torch")
        torch.cuda.reset_peak_memory_stats()
        first, seconds = seconds_of(fast, 50)
        memory = torch.cuda.max_memory_allocated() / 2**20
        _, other = seconds_of(slow, 3)
        ours, theirs = fast(), slow()
        again = all(torch.equal(a, b) for a, b in zip(ours, fast(), strict=True))
        picture = float((ours[0] - theirs[0]).abs().max())
        gradient = max(float((a - b).norm() / b.norm()) for a, b in zip(ours[1:], theirs[1:], strict=True))
        name = kind if again else f"{kind} (NOT reproducible)"
        numbers = f"{1e3 * seconds:.2f} | {1e3 * other:.0f} | {other / seconds:.0f} | {first:.1f} | {memory:.0f}"
        yield f"| {name} | {numbers} | {picture:.1e} | {gradient:.1e} |"


def side_by_side() -> Iterator[str]:
    """Compare step times for different numbers of tiles per Triton program."""
    from brushexp_gpu import rasterization  # noqa: PLC0415  (imports Triton)

    chosen, times = rasterization.TILES, []
    for tiles in (1, 2, 4, 8):
        rasterization.TILES = tiles
        _, seconds = seconds_of(step_of("plain", "triton"), 50)
        times.append(f"{1e3 * seconds:.2f} ms with {tiles}")
    rasterization.TILES = chosen
    yield f"Plain steps by the number of tiles per program ({chosen} is the default): {', '.join(times)}."


def time_painting(picture: Path | None) -> Iterator[str]:
    """Paint a picture of 768 x 512 pixels, the size of Kodak's pictures, until it reaches the target PSNR."""
    source: Any = picture or transform.resize(data.rocket(), (512, 768))
    for again in ("first", "again"):
        done = brushexp.paint(source, look="even", strokes=STROKES, psnr=PSNR, steps=1500, device="cuda")
        found = done.metrics
        seconds, taken = float(found["seconds"]), int(found["steps"])
        name = picture.name if picture else "rocket"
        yield f"- {name}, 768 x 512, {STROKES} strokes, {again}: {found['psnr']:.2f} dB after {seconds:.2f} s and"
        yield f"  {taken} steps, {1e3 * seconds / max(taken, 1):.2f} ms a step."


def where_time_goes() -> Iterator[str]:
    """Profile the device during ten plain steps."""
    step = step_of("plain", "triton")
    step()
    with profile(activities=[ProfilerActivity.CPU, ProfilerActivity.CUDA]) as seen:
        for _ in range(10):
            step()
        torch.cuda.synchronize()
    times: Counter[str] = Counter()
    starts: Counter[str] = Counter()
    for event in seen.key_averages():
        if event.device_type == DeviceType.CUDA:
            name = re.sub(r"^void |<.*", "", event.key).rpartition("::")[2]
            times[name] += event.self_device_time_total / 10
            starts[name] += event.count / 10
    yield f"Ten plain steps keep the device busy for {times.total() / 1e3:.2f} ms each.\n"
    yield "| on the device | times a step | us a step | share |"
    yield "|---|---|---|---|"
    for name, microseconds in times.most_common(12):
        yield f"| `{name}` | {starts[name]:.1f} | {microseconds:.1f} | {microseconds / times.total():.0%} |"


def tests() -> Iterator[str]:
    """Run the tests that are marked with ``gpu``."""
    versions = "-Wdefault"  # other builds of PyTorch bring libraries that warn; these are no faults of ours
    command = [sys.executable, "-m", "pytest", "-n", "auto", versions, "-m", "gpu", *TESTS]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    print(done.stdout[-4000:], file=sys.stderr)
    yield f"`pytest -m gpu {' '.join(TESTS)}`: {done.stdout.strip().splitlines()[-1].strip('= ')}"


def report(picture: Path | None) -> str:
    """Return all results as the text for the section in docs/gpu.md."""
    import triton  # noqa: PLC0415  (it may not be there)

    card, capability = torch.cuda.get_device_name(), "".join(map(str, torch.cuda.get_device_capability()))
    head = f"{card} (sm_{capability}), torch {torch.__version__}, triton {triton.__version__}; `benchmarks/gpu.py`."
    size = f"A step at {SIDE} x {SIDE} px with {STROKES} strokes, forward and backward; the goal is 2 ms."
    parts = [
        head,
        *tests(),
        size,
        "\n".join(steps()),
        *side_by_side(),
        "\n".join(time_painting(picture)),
        "\n".join(where_time_goes()),
    ]
    return "\n\n".join(parts)


def main() -> None:
    """Write the section in docs/gpu.md, or exit with a message if this machine lacks what the benchmark needs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture", type=Path, nargs="?", help="a picture of 768 x 512 pixels")
    picture = parser.parse_args().picture
    if lacks := missing_requirement():
        sys.exit(f"benchmarks/gpu.py: {lacks}; {CARE}")
    before, _, _ = PAGE.read_text().partition(HEADING)
    PAGE.write_text(f"{before}{HEADING}\n{report(picture)}\n")
    print(f"written to {PAGE}")


if __name__ == "__main__":
    main()
