"""Detect torch.func transforms (vmap, grad) with a private PyTorch function; tested with PyTorch 2.13."""

import torch


def inside_transform() -> bool:
    """Return whether the caller runs inside ``torch.func.vmap``, ``grad`` or another transform."""
    active = getattr(torch._C, "_are_functorch_transforms_active", None)
    return active is not None and bool(active())
