"""Write files whole or not at all, and convert numbers to pixels and JSON."""

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

TEMPORARY = ".brushexp-*"  # pattern of files that are being written
PNG: dict[str, Any] = {"format": "PNG", "compress_type": zlib.Z_RLE}  # as small as by default, in a quarter of the time


@contextmanager
def replacing(path: Path, key: str = "output") -> Iterator[Path]:
    """Yield a temporary path beside ``path``, whose file replaces that of ``path`` in the end.

    At any error, Ctrl-C included, the temporary file is removed and the previous one is untouched. If the file cannot
    be written, a UserError proposes another place with ``key``.
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
        raise UserError(f"cannot write {path}: {reason}; mend that or choose another folder with {key}=...") from error


def write_bytes(path: Path, data: bytes, key: str = "output") -> None:
    """Write a file as `replacing` does."""
    with replacing(path, key) as temporary:
        temporary.write_bytes(data)


def write_text(path: Path, text: str | Iterable[str]) -> None:
    """Write a UTF-8 file of one text or piece by piece; odd bytes of file names are escaped."""
    pieces = [text] if isinstance(text, str) else text
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.writelines(piece.encode("utf-8", "backslashreplace") for piece in pieces)


def write_json(path: Path, data: Any) -> None:
    """Write strict JSON; a number that is not finite becomes null."""
    write_text(path, json.dumps(_plain(data), indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def write_picture(path: Path, image: Tensor | np.ndarray) -> None:
    """Write a PNG of a tensor (3, H, W) in [0, 1], or of bytes (H, W, 3)."""
    pixels = to_bytes(image) if isinstance(image, Tensor) else image
    encoded = io.BytesIO()  # in memory: Pillow does not say why writing to a file failed
    Image.fromarray(pixels).save(encoded, **PNG)
    write_bytes(path, encoded.getvalue())


def to_bytes(image: Tensor) -> np.ndarray:
    """Round a picture (3, H, W) to 8 bits (H, W, 3): clipped to [0, 1], halves upwards, NaN to 0."""
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
