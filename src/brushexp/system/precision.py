"""Numbers of half precision."""

import torch
from torch import Tensor


def at_least_single(value: Tensor) -> Tensor:
    """The same in float32 if it is in half precision (bfloat16, float16); otherwise untouched.

    A mean over a picture overflows in float16, and the difference of two squares (a variance, a determinant) has no
    correct digit in bfloat16. The gradient goes back in the precision that the value came in.
    """
    return value.to(torch.promote_types(value.dtype, torch.float32))
