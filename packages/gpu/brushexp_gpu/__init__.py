"""The kernels of the blend `tiled` for GPUs, in Triton, which every build of PyTorch for CUDA brings."""

import os
import shutil
from functools import cache
from importlib.util import find_spec

from torch import Tensor

from brushexp.contracts.kernels import Rasterizer, profile, textured_profile
from brushexp.contracts.layers import KernelInput, Layers, Size


def rasterize(
    inputs: KernelInput, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, opaque: float
) -> Rasterizer | None:
    """Make the rasterizer of plain and of textured strokes; None for others, and where no kernel of Triton runs."""
    known = inputs.kernel in (profile.KERNEL, profile.DRIFTING, textured_profile.KERNEL)
    if not known or not _runs_on(inputs.strokes.device.type):
        return None
    from brushexp_gpu.rasterization import TritonRasterization  # noqa: PLC0415  (without a GPU nobody waits for it)

    return TritonRasterization(inputs, layers, front_to_back, size, background, opaque)


@cache
def _runs_on(device: str) -> bool:
    """Whether kernels run there: Triton starts them by code in C, or interprets them if TRITON_INTERPRET is 1."""
    if find_spec("triton") is None:
        return False
    import triton  # noqa: PLC0415

    knobs = getattr(triton, "knobs", None)  # none in PyTorch before 2.8, with which nothing was tried
    compiles = any((os.environ.get("CC"), shutil.which("gcc"), shutil.which("clang")))
    return knobs is not None and (knobs.runtime.interpret or (device == "cuda" and compiles))
