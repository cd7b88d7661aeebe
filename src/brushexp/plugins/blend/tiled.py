"""Blend, tile by tile, the strokes that touch the tile and can be seen; this is the default."""

import logging
from dataclasses import dataclass
from functools import cache
from typing import Annotated

import torch
from torch import Tensor

from brushexp.bounds import between, one_of
from brushexp.compositing.eager import paint_tiles
from brushexp.compositing.layers import Canvas, KernelInput, Layers, Size, accuracy_of
from brushexp.compositing.rasterization import Painted, Rasterization
from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend, match_dtype
from brushexp.plugins.blend.dense import over
from brushexp.registry import register

log = logging.getLogger(__name__)


@register("blend", "tiled")
@dataclass(kw_only=True, eq=False)
class Tiled(Blend):
    """Per tile of 8 x 8 pixels the strokes that touch it, front to back, in one fused kernel; exact but for ``opaque``.

    Args:
        opaque: strokes are skipped where no pixel of the tile lets more than this fraction of light through; the
            picture changes by at most as much. 0 looks at every stroke.
        kernel: numba (compiled, float32, CPU), torch (anything, slower), or auto: numba where it can.
    """

    cost = "1"
    exact = "but for `opaque`"
    runs_on = "CPU in float32; anything else in PyTorch, slower"

    opaque: Annotated[float, between(0, 0.99)] = 5e-5
    kernel: Annotated[str, one_of("auto", "numba", "torch")] = "auto"

    def __call__(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor | None = None
    ) -> Canvas:
        background, target = match_dtype(layers, background, target)
        inputs = self._kernel_input(layers)
        if inputs is None:
            return paint_tiles(layers, front_to_back, size, background, target, over)
        rasterization = Rasterization(inputs, layers, front_to_back, size, background, self.opaque)
        goal = None if target is None else target.contiguous().numpy()
        image = Painted.apply(rasterization, goal, inputs.strokes, *inputs.data[: inputs.learnt])
        if target is None:
            return Canvas(image)
        return Canvas(image, accuracy_of(*torch.from_numpy(rasterization.errors).unbind(1)))

    def importance(
        self, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, target: Tensor, weight: Tensor
    ) -> Tensor | None:
        inputs = self._kernel_input(layers)
        if inputs is None:
            return None
        rasterization = Rasterization(inputs, layers, front_to_back, size, background, self.opaque)
        return torch.from_numpy(rasterization.importance(target.numpy(), weight.numpy()))

    def _kernel_input(self, layers: Layers) -> KernelInput | None:
        able = layers.color.dtype == torch.float32 and layers.color.device.type == "cpu"
        inputs = layers.compiled() if able and self.kernel != "torch" else None
        if inputs is None and self.kernel == "numba":
            raise UserError("blend.kernel=numba draws in float32 on the CPU, not all layers; use blend.kernel=auto")
        if inputs is None and self.kernel == "auto" and layers.color.device.type == "cpu":
            tell_slow(layers.color.dtype)
        return inputs


@cache
def tell_slow(dtype: torch.dtype) -> None:
    """Log, once, why strokes are not drawn by compiled kernels."""
    reason = "their renderer has no kernel, or weights to train, which renderer.requires_grad_(False) freezes"
    reason = reason if dtype == torch.float32 else f"they are {dtype}, and kernels take float32"
    log.warning("strokes are drawn by PyTorch, many times slower than by compiled kernels: %s", reason)
