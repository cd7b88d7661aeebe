"""The default blend: per tile of pixels, only the strokes that touch it and can be seen."""

from collections.abc import Callable
from enum import Enum
from typing import Any

import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.plugins.blend.base import Blend, Canvas, accuracy_of, alike
from brushexp.plugins.blend.dense import over
from brushexp.plugins.renderer.base import SPREAD, Layers, Patches, Profile, TexturedProfile
from brushexp.registry import register
from brushexp.system.process import share_threads


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
        # Numba takes a second; --help should not.
        from brushexp.compositing import eager, profile_scene, textured_scene, window_scene  # noqa: PLC0415

        self.opaque = opaque
        self.kernel = kernel
        self._eager, self._scene = eager, profile_scene
        self._textured_scene, self._patch_scene = textured_scene, window_scene.scene_of
        self._passes: dict[type[Layers], Callable[..., tuple[Any, *tuple[Tensor, ...]] | None]] = {
            Profile: self._profile,
            TexturedProfile: self._textured,
            Patches: self._patches,
        }

    def __call__(
        self,
        layers: Layers,
        front_to_back: Tensor,
        size: tuple[int, int],
        background: Tensor,
        target: Tensor | None = None,
    ) -> Canvas:
        curve = layers.curve
        background, target = alike(layers, background, target)
        compiled = None
        if self.kernel is not Kernel.torch and type(layers) in self._passes and _compiled_for(curve):
            share_threads()
            compiled = self._passes[type(layers)](layers, front_to_back, size, background.numpy())
        if compiled is not None:
            return self._compiled(target, *compiled)
        if self.kernel is Kernel.numba:
            raise UserError(
                "blend.kernel=numba draws in float32 on the CPU, no layers of other kinds; use blend.kernel=auto"
            )
        padded = self._eager.pad(self._eager.lists_of(layers, front_to_back, size), front_to_back, curve)
        return self._eager.paint_tiles(layers, padded, size, background, target, over)

    def importance(
        self,
        layers: Layers,
        front_to_back: Tensor,
        size: tuple[int, int],
        background: Tensor,
        target: Tensor,
        weight: Tensor,
    ) -> Tensor | None:
        if self.kernel is Kernel.torch or not isinstance(layers, Profile) or not _compiled_for(layers.curve):
            return None
        scene, strokes = self._profile(layers, front_to_back, size, background.numpy())
        return torch.from_numpy(scene.worth(strokes.detach().numpy(), target.numpy(), weight.contiguous().numpy()))

    def _compiled(self, target: Tensor | None, scene: Any, *tensors: Tensor) -> Canvas:
        image = _Paint.apply(scene, None if target is None else target.contiguous().numpy(), *tensors)
        if target is None:
            return Canvas(image)
        sums = torch.from_numpy(scene.errors)
        return Canvas(image, accuracy_of(sums[:, 0], sums[:, 1]))

    def _profile(
        self, layers: Profile, front_to_back: Tensor, size: tuple[int, int], background: Any
    ) -> tuple[Any, Tensor]:
        strokes = [layers.curve.flatten(1), layers.half_width[:, None], layers.color, layers.opacity[:, None]]
        lists, order = self._eager.lists_of(layers, front_to_back, size), front_to_back.numpy()
        scene = self._scene.Scene(lists, size, background, layers.soft, layers.taper, self.opaque, order)
        return scene, torch.cat(strokes, dim=1)

    def _textured(
        self, layers: TexturedProfile, front_to_back: Tensor, size: tuple[int, int], background: Any
    ) -> tuple[Any, Tensor] | None:
        if layers.cells is None:  # the textures are being trained
            return None
        texels = 0.5 * layers.rows / SPREAD / layers.half_width  # per pixel
        strokes = [layers.curve.flatten(1), layers.half_width.detach()[:, None], layers.color]
        strokes += [layers.opacity[:, None], texels[:, None]]
        lists, order = self._eager.lists_of(layers, front_to_back, size), front_to_back.numpy()
        scene = self._textured_scene.TexturedScene(
            lists, size, background, self.opaque, order, layers.look.numpy(), layers.cells.numpy()
        )
        return scene, torch.cat(strokes, dim=1)

    def _patches(
        self, layers: Patches, front_to_back: Tensor, size: tuple[int, int], background: Any
    ) -> tuple[Any, Tensor, Tensor]:
        places = torch.cat([layers.position, layers.scale[:, None], layers.opacity[:, None]], dim=1)
        scene = self._patch_scene(layers, size, background, self.opaque, front_to_back.numpy())
        return scene, places, layers.images.contiguous()


class _Paint(torch.autograd.Function):
    """The kernels as one differentiable operation from tensors of N strokes to the picture (3, H, W)."""

    @staticmethod
    def forward(ctx: Any, scene: Any, target: Any, *tensors: Tensor) -> Tensor:
        ctx.save_for_backward(*tensors)
        ctx.scene = scene
        arrays = [tensor.detach().numpy() for tensor in tensors]
        return torch.from_numpy(scene.paint(*arrays, target, keep=any(ctx.needs_input_grad)))

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, ...]:
        arrays = [tensor.numpy() for tensor in ctx.saved_tensors]
        gradient = ctx.scene.gradient(*arrays, grad.contiguous().numpy())
        parts = gradient if isinstance(gradient, tuple) else (gradient,)
        return None, None, *(torch.from_numpy(part) for part in parts)


def _compiled_for(tensor: Tensor) -> bool:
    return tensor.dtype == torch.float32 and tensor.device.type == "cpu"
