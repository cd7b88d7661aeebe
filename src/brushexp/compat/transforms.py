"""Detect transforms of torch.func (vmap, grad); tested with PyTorch 2.13, which has no public way."""

import torch


def inside_transform() -> bool:
    """Tell whether the caller runs inside ``torch.func.vmap``, ``grad`` or another transform."""
    active = getattr(torch._C, "_are_functorch_transforms_active", None)
    return active is not None and bool(active())
