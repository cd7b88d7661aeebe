"""Write files atomically, and convert numbers to pixels and JSON."""

import io
import json
import math
import os
import secrets
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from brushexp.errors import UserError

TEMPORARY = ".brushexp-*"  # pattern of files being written
PNG: dict[str, Any] = {"format": "PNG", "compress_type": zlib.Z_RLE}  # as small as by default, but four times as fast


@contextmanager
def replacing(path: Path, key: str = "output") -> Iterator[Path]:
    """Yield a temporary path next to ``path``; when the block succeeds, the temporary file replaces ``path``.

    On any error, including Ctrl-C, the temporary file is removed and the previous file stays unchanged. If the file
    cannot be written, a UserError suggests setting ``key`` to another folder.
    """
    temporary = path.with_name(f"{TEMPORARY[:-1]}{secrets.token_hex(8)}{path.suffix}")
    try:
        yield temporary
        with temporary.open("r+b") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException as error:
        with suppress(OSError):
            temporary.unlink()
        if not isinstance(error, OSError):
            raise
        reason = error.strerror or error
        raise UserError(f"cannot write {path}: {reason}; fix that or choose another folder with {key}=...") from error


def write_bytes(path: Path, data: bytes, key: str = "output") -> None:
    """Write bytes to a file atomically; see `replacing`."""
    with replacing(path, key) as temporary:
        temporary.write_bytes(data)


def write_text(path: Path, text: str | Iterable[str]) -> None:
    """Write a string, or its pieces, to a UTF-8 file, escaping undecodable bytes from file names."""
    pieces = [text] if isinstance(text, str) else text
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.writelines(piece.encode("utf-8", "backslashreplace") for piece in pieces)


def write_json(path: Path, data: Any) -> None:
    """Write data as strict JSON; non-finite numbers become null."""
    write_text(path, json.dumps(_plain(data), indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def write_picture(path: Path, image: Tensor | np.ndarray) -> None:
    """Write a PNG from a tensor (3, H, W) in [0, 1] or an array of bytes (H, W, 3)."""
    pixels = to_bytes(image) if isinstance(image, Tensor) else image
    encoded = io.BytesIO()  # in memory, because Pillow does not explain failures to write a file
    Image.fromarray(pixels).save(encoded, **PNG)
    write_bytes(path, encoded.getvalue())


def to_bytes(image: Tensor) -> np.ndarray:
    """Clip a picture (3, H, W) to [0, 1] and round it to bytes (H, W, 3); halves round up, and NaN becomes 0."""
    levels = image.detach().to(torch.float32, copy=True).nan_to_num_(0.0).clamp_(0, 1).mul_(255).add_(0.5)
    return levels.to(torch.uint8).permute(1, 2, 0).contiguous().cpu().numpy()


def _plain(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {str(key): _plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(value) for value in data]
    if isinstance(data, np.generic):
        return _plain(data.item())
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return str(data) if isinstance(data, Path) else data
