"""Paint a picture with compiled kernels, differentiably with respect to every tensor that the layers pass to them."""

from typing import Any, NoReturn, Protocol

import numpy as np
import torch
from torch import Tensor

from brushexp.compositing.layers import KernelInput, Layers, Size
from brushexp.compositing.passes import sum_by_stroke
from brushexp.compositing.tile_lists import AREA, RUN, WORKERS, Array, F, tile_lists
from brushexp.errors import UserError
from brushexp.system.runtime import share


class Rasterizer(Protocol):
    """Interface for one pass of kernels over the layers given at construction; `paint` stores what `gradient` needs.

    ``errors`` (N, 2) are the sums of alpha |color - target|^2 and of alpha; `paint` sets them if it gets a target.
    """

    errors: Tensor

    def paint(self, target: Tensor | None, *, keep: bool) -> Tensor:
        """Paint a picture (C, H, W); with ``keep``, store the data that `gradient` needs."""

    def gradient(self, grad_image: Tensor) -> tuple[Tensor, ...]:
        """Compute the gradients of the strokes' numbers and of learned data from the picture's gradient (C, H, W)."""

    def importance(self, target: Tensor, weight: Tensor) -> Tensor:
        """Compute how much the squared error, weighted by ``weight`` (H, W), grows if each stroke is removed: (N,)."""


class Rasterization(Rasterizer):
    """One pass of the Numba kernels over layers and their tile lists; the arguments are those of `Blend`.

    A tile is finished when no pixel transmits more than the fraction ``opaque`` of the light.
    """

    def __init__(
        self, inputs: KernelInput, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, opaque: float
    ) -> None:
        curve, reach = inputs.boxes or (layers.curve, layers.reach)
        lists = tile_lists(curve, reach, front_to_back, size, boxes_only=inputs.boxes is not None)
        self.kernel, self.lists, self.size, self.opaque = inputs.kernel, lists, size, opaque
        self.channels, self.order = len(background), front_to_back.numpy()
        self._forward, self._backward = inputs.kernel.passes(self.channels)
        data = tuple(part.detach().numpy() if isinstance(part, Tensor) else part for part in inputs.data)
        self._strokes = np.ascontiguousarray(inputs.strokes.detach().numpy()), data
        parts = lists.first, lists.stroke, lists.slot, lists.shape[1]
        self._tiles = layers.reach.detach().numpy(), self.order, *parts, background.numpy()
        self._workers = min(WORKERS, -(-(len(lists.first) - 1) // RUN))
        self._trace: tuple[Array, Array, Array]  # used length of each list, pairs that cover their tile, nearest points

    def paint(self, target: Tensor | None, *, keep: bool) -> Tensor:
        pairs = len(self.lists.stroke)
        near = np.empty((pairs if keep and self.kernel.curved else 0, AREA), np.uint16)
        self._trace = np.zeros(len(self.lists.first) - 1, np.int64), np.zeros(pairs, np.bool_), near
        image = np.empty((self.channels, *self.size), F)
        errors = np.empty((0 if target is None else pairs, 2), F)
        goal = np.zeros((self.channels, 0, 0), F) if target is None else target.contiguous().numpy()
        rest = F(self.opaque), goal, image, *self._trace, errors
        share(self._forward, self._workers, *self._strokes, *self._tiles, *rest)
        if target is not None:
            self.errors = torch.from_numpy(self._sums(errors))
        return torch.from_numpy(image)

    def gradient(self, grad_image: Tensor) -> tuple[Tensor, ...]:
        picture = grad_image.contiguous().numpy()
        pairs = self._run_back(picture, self.kernel.columns or self._strokes[0].shape[1])
        if self.kernel.gather is None:
            return (torch.from_numpy(self._sums(pairs)),)
        rows = self._trace[1], self.lists.row, self.order
        return tuple(map(torch.from_numpy, self.kernel.gather(pairs, *rows, picture, *self._strokes)))

    def importance(self, target: Tensor, weight: Tensor) -> Tensor:
        error = self.paint(None, keep=True) - target
        sums = self._sums(self._run_back(torch.cat([error, weight[None]]).numpy(), 1, weighs=True))
        return torch.from_numpy(sums[:, 0])

    def _run_back(self, picture: Array, columns: int, *, weighs: bool = False) -> Array:
        pairs = np.empty((len(self.lists.stroke), columns), F)
        share(self._backward, self._workers, *self._strokes, *self._tiles, *self._trace, picture, weighs, pairs)
        return pairs

    def _sums(self, pairs: Array) -> Array:
        """Sum the rows of ``pairs`` (pairs, C) that belong to each stroke: (N, C)."""
        sums = np.zeros((len(self._strokes[0]), pairs.shape[1]), F)
        share(sum_by_stroke, len(sums), pairs, self._trace[1], self.lists.row, self.order, sums)
        return sums


class Painted(torch.autograd.Function):
    """The kernels as a single differentiable operation that maps the tensors of N strokes to the picture (C, H, W)."""

    @staticmethod
    def forward(ctx: Any, rasterizer: Rasterizer, target: Tensor | None, *tensors: Tensor) -> Tensor:
        ctx.rasterizer = rasterizer
        ctx.save_for_backward(*tensors)  # so that PyTorch notices in-place changes
        return rasterizer.paint(target, keep=any(ctx.needs_input_grad))

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, ...]:
        saved = ctx.saved_tensors
        gradients = ctx.rasterizer.gradient(grad.detach())
        if torch.is_grad_enabled():  # for second derivatives
            gradients = DifferentiatedOnce.apply(len(gradients), *gradients, grad, *saved)
        return None, None, *gradients


class DifferentiatedOnce(torch.autograd.Function):
    """First derivatives that raise a UserError if they are differentiated again with respect to any tensor."""

    @staticmethod
    def forward(ctx: Any, count: int, *tensors: Tensor) -> tuple[Tensor, ...]:
        return tuple(tensor.clone() for tensor in tensors[:count])

    @staticmethod
    def backward(ctx: Any, *_: Tensor) -> NoReturn:
        raise UserError("the compiled blend 'tiled' has first derivatives only; blend='dense' (slow) has second too")
