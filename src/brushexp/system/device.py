"""Choose the device to compute on."""

import torch

from brushexp.errors import UserError


def device_of(name: str, key: str = "device") -> torch.device:
    """Return the device called ``name``; ``auto`` means the first CUDA device, or the CPU if there is none."""
    count = 0 if name == "cpu" else torch.cuda.device_count()
    if name == "auto":
        return torch.device("cuda" if count else "cpu")
    if name not in ("cpu", *(["cuda"] if count else []), *(f"cuda:{k}" for k in range(count))):
        raise UserError(f"{key}={name}, but PyTorch finds {count} CUDA devices; use device=cpu")
    return torch.device(name)
