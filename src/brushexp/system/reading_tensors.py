"""Read tensor files as untrusted data, just as `brushexp.system.reading` reads text."""

import warnings
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, ZipFile, is_zipfile

import torch
from torch import Tensor

from brushexp.errors import UserError
from brushexp.system.reading import check_file, explaining

LARGEST_WEIGHTS = 2**33  # bytes of the largest file of tensors


def read_safetensors(path: Path, cure: str) -> dict[str, Tensor]:
    """Read a .safetensors file as a dictionary of named tensors; reject non-finite values."""
    from safetensors.torch import load  # noqa: PLC0415  (--help needs none of it)

    check_file(path, cure, LARGEST_WEIGHTS)
    with explaining(path, cure):
        return check_finite(load(path.read_bytes()))


def read_pickled(path: Path, cure: str) -> Any:
    """Read a ``torch.save`` file of tensors, numbers, text, lists and dictionaries; reject anything else."""
    check_file(path, cure, LARGEST_WEIGHTS)
    with explaining(path, cure):
        zipped = is_zipfile(path)  # files of PyTorch before 1.6 are not zip files and cannot be mapped
        if zipped:
            with ZipFile(path) as file:
                packed = any(entry.compress_type != ZIP_STORED for entry in file.infolist())
                if packed or file.testzip() is not None:  # PyTorch itself does not verify checksums
                    raise UserError(f"parts of it are compressed, or have changed since they were written; {cure}")
        with warnings.catch_warnings(action="ignore"):
            data = torch.load(path, map_location="cpu", weights_only=True, mmap=zipped)
        _check_tensors(data)
        return data


def check_finite(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Return the tensors if all their values are finite; otherwise raise a UserError."""
    for name, value in tensors.items():
        if not bool((value.float() if value.is_floating_point() else value).isfinite().all()):
            raise UserError(f"{name} has non-finite numbers; train it again, or give another file")
    return tensors


def _check_tensors(data: Any) -> None:
    """Reject tensors that claim more numbers than they store, such as sparse, meta and expanded tensors."""
    stack, visited = [data], set()
    while stack:
        value = stack.pop()
        if isinstance(value, dict | list | tuple | set) and id(value) not in visited:
            visited.add(id(value))
            stack.extend(value.values() if isinstance(value, dict) else value)
        elif isinstance(value, Tensor):
            held = value.untyped_storage().nbytes() if value.layout is torch.strided and not value.is_meta else -1
            if value.numel() * value.element_size() > held:
                raise UserError(f"a tensor claims {tuple(value.shape)} numbers that do not exist")
