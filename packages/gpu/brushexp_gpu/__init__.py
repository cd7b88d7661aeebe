"""Triton kernels for the `tiled` blend on GPUs; every CUDA build of PyTorch includes Triton."""

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
    """Make a rasterizer for plain or textured strokes; return None for other strokes or if Triton cannot run."""
    known = inputs.kernel in (profile.KERNEL, profile.DRIFTING, textured_profile.KERNEL)
    if not known or not _runs_on(inputs.strokes.device.type):
        return None
    from brushexp_gpu.rasterization import TritonRasterization  # noqa: PLC0415  (not needed without a GPU)

    return TritonRasterization(inputs, layers, front_to_back, size, background, opaque)


@cache
def _runs_on(device: str) -> bool:
    """Check whether kernels run on a device, compiled (needs a C compiler) or interpreted (TRITON_INTERPRET=1)."""
    if find_spec("triton") is None:
        return False
    import triton  # noqa: PLC0415

    knobs = getattr(triton, "knobs", None)  # missing in PyTorch before 2.8, which is untested
    compiles = any((os.environ.get("CC"), shutil.which("gcc"), shutil.which("clang")))
    return knobs is not None and (knobs.runtime.interpret or (device == "cuda" and compiles))
