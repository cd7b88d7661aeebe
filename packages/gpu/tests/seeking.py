"""A kernel that only finds nearest points."""

import torch
import triton
import triton.language as tl
from brushexp_gpu.curves import AREA, load_curve
from brushexp_gpu.list_kernels import find_kernel
from brushexp_gpu.passes import _seek

TILES = 512 if triton.knobs.runtime.interpret else 1


@triton.jit
def seek_kernel(curve, part, corners, found, n, TILES: tl.constexpr):
    k = tl.program_id(0) * TILES + tl.arange(0, TILES)
    here = k < n
    ox, oy = tl.load(corners + 2 * k, here, 0.0), tl.load(corners + 2 * k + 1, here, 0.0)
    sx, sy, fx, fy, bx, by = load_curve(curve, 6 * k, ox, oy, here)
    t = _seek(part, k, sx, sy, fx, fy, bx, by, here)
    tl.store(found + k[:, None] * AREA + tl.arange(0, AREA)[None, :], t, here[:, None])


def nearest_points(curve, reach, corners):
    """Find the points on n curves that are nearest to the pixels of n tiles, one tile for each curve.

    ``corners`` (n, 2) holds the tiles' corners, and the result (n, 64) the parameters of the points on their curves.
    """
    n = len(curve)
    one = torch.ones(n, dtype=torch.int32, device=curve.device)
    order, space = torch.arange(n, device=curve.device), torch.arange(n + 1, device=curve.device)
    boxes = torch.stack([*(corners / 8).int().T, one, one]).contiguous()
    tile, part, stroke = torch.empty_like(one), torch.empty_like(one), torch.empty_like(order)
    pairs = curve.contiguous(), reach, order, boxes, space, tile, stroke, part, n, n, 10**6, 1000
    find_kernel[(-(-n // 128),)](*pairs, BLOCK=128)
    found = torch.empty((n, 64), device=curve.device)
    seek_kernel[(-(-n // TILES),)](curve.contiguous(), part, corners.contiguous(), found, n, TILES=TILES)
    return found
