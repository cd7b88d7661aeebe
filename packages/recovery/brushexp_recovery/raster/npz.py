"""Write and read compressed npz files of arrays."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from brushexp.contracts import UserError
from brushexp.contracts.files import write_bytes

Array = NDArray[Any]


def write_npz(path: Path, **arrays: Array) -> None:
    """Write arrays to a compressed npz file atomically."""
    memory = io.BytesIO()
    np.savez_compressed(memory, **arrays)  # type: ignore[arg-type]
    write_bytes(path, memory.getvalue())


def read_npz(path: Path) -> dict[str, Array]:
    """Read the arrays of an npz file without unpickling objects; raise UserError if it is missing or unreadable."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except FileNotFoundError as error:
        raise UserError(f"there is no file {path}; give the path of an npz") from error
    except Exception as error:
        raise UserError(f"{path} is damaged, or not an npz of plain numbers; get it again") from error
