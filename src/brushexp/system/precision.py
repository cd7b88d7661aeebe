"""Convert numbers to at least single precision."""

import torch
from torch import Tensor


def at_least_single(value: Tensor) -> Tensor:
    """Convert half precision (bfloat16, float16) and integers to float32; return other tensors unchanged.

    The mean of a picture overflows in float16, and differences of squares (variances, determinants) have no correct
    digits in bfloat16. The gradient has the precision of ``value``.
    """
    return value.to(torch.promote_types(value.dtype, torch.float32))
