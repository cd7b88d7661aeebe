"""The device that a run computes on."""

import torch

from brushexp.errors import UserError


def device_of(name: str) -> torch.device:
    """The device called ``name``; auto is the first CUDA device, or the CPU where there is none."""
    available = torch.cuda.is_available()
    if name == "auto":
        return torch.device("cuda" if available else "cpu")
    try:
        device = torch.device(name)
    except RuntimeError as error:
        raise UserError(f"device={name} is not a device; use device=auto, cpu, cuda or cuda:1") from error
    if device.type not in ("cpu", "cuda"):
        raise UserError(f"device={name} is not supported; use device=auto, cpu, cuda or cuda:1")
    if device.type == "cuda" and (not available or (device.index or 0) >= torch.cuda.device_count()):
        raise UserError(f"device={name}, but PyTorch finds {torch.cuda.device_count()} CUDA devices; use device=cpu")
    return device
