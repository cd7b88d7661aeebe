"""The Inception network of the published FID, which exists as TorchScript only; tried with torch 2.13.

torch deprecates TorchScript as a whole. Once it is gone, `task=evaluate` loses the key ``inception``.
"""

import warnings
from pathlib import Path
from typing import Any

import torch


def load_torch_script(path: Path, device: torch.device) -> Any:
    """Load the network of a TorchScript file in evaluation mode."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        return torch.jit.load(str(path), map_location=device).eval()
