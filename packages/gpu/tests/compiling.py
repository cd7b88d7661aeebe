"""Compile every kernel to machine code, as painting would, but without running it; no GPU is needed.

    python packages/gpu/tests/compiling.py 90    for an H100 or H200; other GPUs are 75, 80, 89, 100, 120
    python packages/gpu/tests/compiling.py 90 textured    only kernels for textured strokes in RGB

One line is printed for each kernel: its name, its target, its number of registers, and the bytes spilled to memory.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import brushexp_gpu
import torch
import triton
from brushexp_media.colors.pigment import Pigment
from brushexp_testing.families import some_strokes
from triton.backends.compiler import GPUTarget
from triton.runtime.driver import driver
from triton.runtime.jit import JITFunction

from brushexp.plugins.blend.base import Compositor
from brushexp.plugins.blend.tiled import Tiled
from brushexp.plugins.renderer.analytic import Analytic
from brushexp.plugins.renderer.textured import Textured

DUMP = Path(triton.__file__).parent / "backends" / "nvidia" / "bin" / "cuobjdump"
DONE: set[int] = set()


class Driver(SimpleNamespace):
    """The part of Triton's driver that compilation needs."""

    def __init__(self, capability):
        target = GPUTarget("cuda", capability, 32)
        super().__init__(get_current_target=lambda: target, get_current_device=lambda: 0)
        self.get_current_stream = lambda device: 0


def compile_only(run, kernel, *arguments, grid, warmup, **options):
    """Stand in for `JITFunction.run`: compile, and fill lists as if each stroke touched only the first tile."""
    compiled = run(kernel, *arguments, grid=grid, warmup=True, **options)
    for value in arguments:
        if isinstance(value, torch.Tensor) and value.dtype == torch.int32:
            value.fill_(kernel.fn.__name__ == "box_kernel")
    if id(compiled) not in DONE:
        DONE.add(id(compiled))
        report(kernel.fn.__name__, compiled, options)


def report(name, compiled, options):
    with tempfile.NamedTemporaryFile(suffix=".cubin") as file:
        file.write(compiled.asm["cubin"])
        file.flush()
        found = subprocess.run([DUMP, "-res-usage", file.name], capture_output=True, text=True, check=True).stdout
    usage = " ".join(re.findall(r"(?:REG|STACK|SHARED|LOCAL):\d+", found))
    constants = " ".join(f"{key}={value}" for key, value in options.items())
    print(f"{name:14} {compiled.metadata.target.arch} {usage}  {constants}", flush=True)


def paint(renderer, blend):
    """Launch every kernel for one kind of layer: paint, differentiate, and compute accuracy and importance."""
    strokes, size, order = some_strokes(9, (17, 33)), (17, 33), torch.arange(9)
    leaves = strokes.map(lambda value: value.clone().requires_grad_())
    bare, target, weight = torch.ones(3), torch.rand(3, *size), torch.rand(size)
    blend(renderer(leaves), order, size, bare).image.sum().backward()
    with torch.no_grad():
        blend(renderer(strokes), order, size, bare, target)
        blend.importance(renderer(strokes), order, size, bare, target, weight)


def main(capability="90", only=""):
    driver.set_active(Driver(int(capability)))
    run = JITFunction.run
    JITFunction.run = lambda kernel, *arguments, **options: compile_only(run, kernel, *arguments, **options)
    brushexp_gpu._runs_on = lambda device: True  # pretend, because nothing runs
    tiled, textured = Tiled(kernel="triton"), Textured(checkpoint=None).requires_grad_(False)
    paint(textured, tiled)
    if not only:
        paint(Analytic(), tiled)
        for renderer in (Analytic(), textured):
            paint(renderer, Compositor(tiled, Pigment()))


if __name__ == "__main__":
    main(*sys.argv[1:])
