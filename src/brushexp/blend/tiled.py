"""The default blend: per tile of pixels, only the strokes that touch it and can be seen."""

from enum import Enum
from typing import Any

import torch
from torch import Tensor

from brushexp.blend.base import Blend, Canvas, accuracy_of
from brushexp.blend.dense import over
from brushexp.errors import UserError
from brushexp.registry import register
from brushexp.renderer.base import Layers, Profile


class Kernel(Enum):
    """Who does the arithmetic."""

    auto = "auto"
    numba = "numba"
    torch = "torch"


@register("blend", "tiled")
class Tiled(Blend):
    """Per tile of 8 x 8 pixels the strokes that touch it, front to back, in one fused kernel; exact but for ``opaque``.

    Args:
        opaque: strokes are skipped where no pixel of the tile lets more than this fraction of light through; the
            picture changes by at most as much. 0 looks at every stroke.
        kernel: numba (profile renderers, float32, CPU), torch (anything, slower), or auto.
    """

    def __init__(self, *, opaque: float = 5e-5, kernel: Kernel = Kernel.auto) -> None:
        if not 0 <= opaque < 1:
            raise UserError(f"blend.opaque={opaque:g} is not a fraction below 1; try blend.opaque=5e-5")
        from brushexp.blend import _eager, _scene  # noqa: PLC0415  (Numba takes a second; --help should not)

        self.opaque = opaque
        self.kernel = kernel
        self._eager, self._scene = _eager, _scene

    def __call__(
        self,
        layers: Layers,
        front_to_back: Tensor,
        size: tuple[int, int],
        background: Tensor,
        target: Tensor | None = None,
    ) -> Canvas:
        curve = layers.curve
        if self.kernel is not Kernel.torch and isinstance(layers, Profile) and _compiled_for(curve):
            return self._compiled(layers, front_to_back, size, background, target)
        if self.kernel is Kernel.numba:
            raise UserError("blend.kernel=numba draws profile renderers in float32 on the CPU; use blend.kernel=auto")
        lists = self._eager.pad(self._eager.lists_of(layers, front_to_back, size), front_to_back, curve)
        return self._eager.paint_tiles(layers, lists, size, background, target, over)

    def _compiled(
        self, layers: Profile, front_to_back: Tensor, size: tuple[int, int], background: Tensor, target: Tensor | None
    ) -> Canvas:
        self._scene.use_threads(torch.get_num_threads())
        strokes = torch.cat(
            [layers.curve.flatten(1), layers.half_width[:, None], layers.color, layers.opacity[:, None]], dim=1
        )
        lists = self._eager.lists_of(layers, front_to_back, size)
        scene = self._scene.Scene(
            lists, size, background.numpy(), layers.soft, layers.taper, self.opaque, front_to_back.numpy()
        )
        goal = None if target is None else target.contiguous().numpy()
        image = _Paint.apply(strokes, scene, goal)
        if target is None:
            return Canvas(image)
        sums = torch.from_numpy(scene.errors)
        return Canvas(image, accuracy_of(sums[:, 0], sums[:, 1]))


class _Paint(torch.autograd.Function):
    """The kernels as one differentiable operation from strokes (N, 11) to the picture (3, H, W)."""

    @staticmethod
    def forward(ctx: Any, strokes: Tensor, scene: Any, target: Any) -> Tensor:
        ctx.save_for_backward(strokes)
        ctx.scene = scene
        return torch.from_numpy(scene.paint(strokes.detach().numpy(), target, keep=ctx.needs_input_grad[0]))

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor, None, None]:
        (strokes,) = ctx.saved_tensors
        return torch.from_numpy(ctx.scene.gradient(strokes.numpy(), grad.contiguous().numpy())), None, None


def _compiled_for(tensor: Tensor) -> bool:
    return tensor.dtype == torch.float32 and tensor.device.type == "cpu"
