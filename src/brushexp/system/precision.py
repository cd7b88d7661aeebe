"""Convert half-precision numbers to single precision."""

import torch
from torch import Tensor


def at_least_single(value: Tensor) -> Tensor:
    """Convert half precision (bfloat16, float16) to float32; other tensors are returned unchanged.

    A mean over a picture overflows in float16, and differences of squares (variances, determinants) have no correct
    digit in bfloat16. The gradient has the precision of ``value``.
    """
    return value.to(torch.promote_types(value.dtype, torch.float32))
