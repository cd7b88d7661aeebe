"""Blend only the visible strokes of each tile; this blend is the default."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Annotated

import torch
from torch import Tensor

from brushexp.bounds import between, one_of
from brushexp.compositing.eager import paint_tiles
from brushexp.compositing.layers import Canvas, Layers, Size, accuracy_of
from brushexp.compositing.rasterization import Painted, Rasterization, Rasterizer
from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend, match_dtype
from brushexp.plugins.blend.dense import over
from brushexp.registry import register
from brushexp.system.published import entry_points_of

log = logging.getLogger(__name__)
KERNELS = "brushexp.kernels"  # entry-point group: kernel -> function like `Rasterization`, None if it cannot draw
CURES = {
    "numba": "draws only some layers, in float32 on the CPU",
    "triton": "draws only plain and textured strokes, in float32 on CUDA devices with Triton",
}


@register("blend", "tiled")
@dataclass(kw_only=True, eq=False)
class Tiled(Blend):
    """Blends the strokes that touch each 8 x 8 tile, front to back, in one fused kernel; exact except for ``opaque``.

    Args:
        opaque: fraction of the light; once no pixel of a tile transmits more than this, deeper strokes are skipped. It
            is also the largest possible change of the picture. 0 skips no strokes.
        kernel: numba (compiled, float32, CPU), triton (compiled, float32, CUDA), torch (any device and dtype, slower),
            or auto (the device's compiled kernel if there is one).
    """

    cost = "1"
    exact = "except for `opaque`"
    runs_on = "CPU and, with Triton, CUDA in float32; anything else in PyTorch, slower"

    opaque: Annotated[float, between(0, 0.99)] = 5e-5
    kernel: Annotated[str, one_of("auto", "numba", "triton", "torch")] = "auto"

    def __call__(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor | None = None
    ) -> Canvas:
        background, target = match_dtype(layers, background, target)
        rasterizer, tensors = self._rasterizer(layers, front_to_back, size, background)
        if rasterizer is None:
            return paint_tiles(layers, front_to_back, size, background, target, over)
        image = Painted.apply(rasterizer, target, *tensors)
        if target is None:
            return Canvas(image)
        return Canvas(image, accuracy_of(*rasterizer.errors.unbind(1)))

    def importance(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor, weight: Tensor
    ) -> Tensor | None:
        rasterizer, _ = self._rasterizer(layers, front_to_back, size, background)
        return None if rasterizer is None else rasterizer.importance(target, weight)

    def _rasterizer(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor
    ) -> tuple[Rasterizer | None, tuple[Tensor, ...]]:
        """Return the rasteriser, or None if PyTorch has to draw, and the tensors that the rasteriser differentiates."""
        device, single = layers.color.device.type, layers.color.dtype == torch.float32
        kernel = {"cpu": "numba", "cuda": "triton"}.get(device, "torch") if self.kernel == "auto" else self.kernel
        draw = _drawer(kernel) if single and (kernel != "numba" or device == "cpu") else None
        inputs = layers.compiled() if draw else None
        if draw and inputs and (rasterizer := draw(inputs, layers, front_to_back, size, background, self.opaque)):
            return rasterizer, (inputs.strokes, *inputs.data[: inputs.learnt])
        if self.kernel in CURES:
            raise UserError(f"blend.kernel={kernel} {CURES[kernel]}; use blend.kernel=auto")
        if self.kernel == "auto" and device == "cpu":
            log_slow_kernel(layers.color.dtype)
        return None, ()


@cache
def _drawer(kernel: str) -> Callable[..., Rasterizer | None] | None:
    """Find the function that creates the rasteriser of a kernel, in the core or in a package."""
    if kernel == "numba":
        return Rasterization
    point = entry_points_of(KERNELS).get(kernel)
    return None if point is None else point.load()


@cache
def log_slow_kernel(dtype: torch.dtype) -> None:
    """Log once why no compiled kernel can draw the strokes."""
    reason = "their renderer has no kernel, or its weights are trainable; renderer.requires_grad_(False) freezes them"
    reason = reason if dtype == torch.float32 else f"they are {dtype}, but kernels need float32"
    log.warning("PyTorch draws the strokes, many times slower than compiled kernels: %s", reason)
