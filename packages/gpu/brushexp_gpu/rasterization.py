"""Paint a picture with Triton kernels, as `brushexp.compositing.rasterization` does with Numba kernels."""

import torch
import triton
from torch import Tensor

from brushexp.contracts.kernels import AREA
from brushexp.contracts.layers import DRIFTING, KernelInput, Layers, Size
from brushexp.contracts.layers import KERNEL as TEXTURED
from brushexp_gpu.launch import launch
from brushexp_gpu.lists import CHUNK, tile_lists
from brushexp_gpu.passes import backward_pass, behind_pass, forward_pass, sum_rows

TILES = 64 if triton.knobs.runtime.interpret else 1  # number of tiles per program, one warp each
ROWS = 64  # number of pairs of a stroke summed at once


class TritonRasterization:
    """A picture's kernel settings and tile lists; used like `brushexp.compositing.rasterization.Rasterization`."""

    errors: Tensor

    def __init__(
        self, inputs: KernelInput, layers: Layers, front_to_back: Tensor, size: Size, background: Tensor, opaque: float
    ) -> None:
        self.lists = tile_lists(layers.curve.detach(), layers.reach.detach(), front_to_back, size)
        self.size, self.opaque, self.order, self.background = size, opaque, front_to_back, background.contiguous()
        self._strokes, self._textured = inputs.strokes.detach().contiguous(), inputs.kernel is TEXTURED
        nothing = background.new_empty(0)
        taper = 0.0 if self._textured else float(inputs.data[0])
        looks = inputs.data if self._textured else (nothing, nothing, nothing)
        self._numbers = self._strokes, *(part.contiguous() for part in looks), taper
        channels, self._drifts = len(background), inputs.kernel is DRIFTING
        self._kind = {"C": channels, "CP": triton.next_power_of_2(channels), "TILES": TILES, "num_warps": min(TILES, 8)}

    def paint(self, target: Tensor | None, *, keep: bool) -> Tensor:
        """Paint a picture (C, H, W); with ``keep``, store the state that `gradient` and `importance` need."""
        lists, like, tiles = self.lists, self._strokes, len(self.lists.first) - 1
        channels, room = len(self.background), len(lists.stroke)
        image, used = like.new_empty((channels, *self.size)), torch.empty_like(lists.first[1:], dtype=torch.int32)
        near, above = like.new_empty((2, room if keep else 0, AREA))
        states, behinds = (like.new_empty((lists.chunk_room if keep else 0, c, AREA)) for c in (channels + 1, channels))
        errors = like.new_zeros((0 if target is None else room, 2))
        goal = image if target is None else target.contiguous()
        launch(
            forward_pass, self._programs(tiles), *self._numbers, lists.stroke, lists.slot, lists.part, lists.first,
            lists.chunks, self.background, self.opaque, goal, image, used, near, above, states, errors, *self._sizes(),
            **self._kind, CHUNK=CHUNK, TEXTURED=self._textured, DRIFTS=self._drifts,
            JUDGE=target is not None, KEEP=keep,
        )  # fmt: skip
        if keep:
            chunk_tile = used.new_empty(lists.chunk_room)
            ends = states, behinds, lists.chunks, chunk_tile, used, self.background, tiles
            launch(behind_pass, self._programs(tiles), *ends, **self._kind)
            self._trace = chunk_tile, near, above, behinds
        if target is not None:
            self.errors = self._sums(errors)
        return image

    def gradient(self, grad_image: Tensor) -> tuple[Tensor, ...]:
        """Compute the gradient of the strokes' numbers from the picture's gradient (C, H, W)."""
        return (self._sums(self._run_back(grad_image, self._strokes.shape[1])),)

    def importance(self, target: Tensor, weight: Tensor) -> Tensor:
        """Compute the increase (N,) in squared error that removing each stroke would cause, with weights (H, W)."""
        error = self.paint(None, keep=True) - target
        return self._sums(self._run_back(torch.cat([error, weight[None]]), 1, weighs=True))[:, 0]

    def _run_back(self, picture: Tensor, columns: int, *, weighs: bool = False) -> Tensor:
        lists = self.lists
        pairs = picture.new_zeros((len(lists.stroke), columns))
        launch(
            backward_pass, self._programs(lists.chunk_room), *self._numbers, lists.stroke, lists.slot, lists.first,
            lists.chunks, *self._trace, picture.contiguous(), pairs, *self._sizes(),
            **self._kind, CHUNK=CHUNK, TEXTURED=self._textured, DRIFTS=self._drifts, WEIGHS=weighs,
        )  # fmt: skip
        return pairs

    def _sums(self, pairs: Tensor) -> Tensor:
        """Sum each stroke's rows in ``pairs`` (pairs, C), and return the sums (N, C)."""
        columns = pairs.shape[1]
        sums = pairs.new_zeros((len(self._strokes), columns))
        width = triton.next_power_of_2(columns)
        launch(sum_rows, len(self.order), pairs, self.lists.space, self.order, sums, columns, WIDTH=width, ROWS=ROWS)
        return sums

    def _sizes(self) -> tuple[int, ...]:
        """Return the kernel arguments listed in `passes.SIZES`, for which kernels are not specialised."""
        return len(self.lists.first) - 1, self.lists.shape[1], *self.size, self._strokes.shape[1]

    def _programs(self, parts: int) -> int:
        return -(-parts // TILES)
