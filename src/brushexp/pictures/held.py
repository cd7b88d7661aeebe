"""Assign names to in-memory pictures, so that the names can be used in place of paths."""

from __future__ import annotations

import io
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
import torch
from PIL import Image

from brushexp.errors import UserError
from brushexp.pictures.decode import decode_image, read_picture
from brushexp.pictures.limits import MAX_PIXELS
from brushexp.system.files import replacing, write_picture

KINDS = (
    "a path, a PIL image, the bytes of a file, an open file, an array (H, W, 3), (H, W, 4) or (H, W), or a tensor "
    "(3, H, W); uint8, bool, or floats from 0 to 1"
)
CHANNELS = (1, 3, 4)  # grey, RGB, RGB and straight alpha


@dataclass(frozen=True, eq=False)
class HeldPicture:
    """A picture (H, W, 3), uint8 or float32 in [0, 1], that can be looked up by name while this object exists."""

    over: dict[float, np.ndarray]  # the picture over white (1) and over black (0); a single array if it is opaque
    name: str

    def __reduce__(self) -> tuple[Any, ...]:
        return _hold_picture, (self.over,)  # the name also works in another process

    def write(self, folder: Path, stem: str) -> Path:
        """Write the pixels to a PNG file, or to a TIFF file if they are floats, and keep the transparency."""
        white, black = self.over[1.0], self.over[0.0]
        pixels = white if white is black else _with_alpha(white, black)
        if pixels.dtype == np.uint8:
            write_picture(path := folder / f"{stem}.png", pixels)
            return path
        from tifffile import imwrite  # noqa: PLC0415  (rarely needed)

        extra = None if white is black else ["unassalpha"]
        with replacing(path := folder / f"{stem}.tif") as temporary:
            imwrite(temporary, pixels, photometric="rgb", extrasamples=extra)
        return path


_pictures: WeakValueDictionary[str, HeldPicture] = WeakValueDictionary()


def hold(picture: Any, key: str = "image") -> HeldPicture:
    """Store a picture under a name derived from its pixels; any other value raises a UserError that names ``key``."""
    white = _pixels(picture, key, 1.0)
    black = _pixels(picture, key, 0.0) if may_be_transparent(picture) else white
    return _hold_picture({1.0: white, 0.0: white if np.array_equal(white, black) else black})


def may_be_transparent(picture: Any) -> bool:
    """Check whether a picture may have transparent pixels; True for files, which are not read here."""
    if isinstance(picture, Image.Image):
        return picture.has_transparency_data
    return not isinstance(picture, np.ndarray | torch.Tensor) or 4 in picture.shape


def _hold_picture(over: dict[float, np.ndarray]) -> HeldPicture:
    digest = sha256(f"{over[1.0].shape} {over[1.0].dtype}".encode() + over[1.0].tobytes() + over[0.0].tobytes())
    name = f"picture {digest.hexdigest()[:12]} in memory"
    held = _pictures.get(name) or HeldPicture(over, name)
    _pictures[name] = held
    return held


def pixels_of(name: str, backdrop: float = 1.0) -> np.ndarray | None:
    """Look up a picture (H, W, 3) by name, over a ``backdrop`` of white (1) or black (0); None for an unknown name."""
    held = _pictures.get(name)
    return None if held is None else held.over[backdrop]


def _with_alpha(white: np.ndarray, black: np.ndarray) -> np.ndarray:
    """Recover colours and alpha (H, W, 4) from a picture composited over white and over black."""
    most = 255 if white.dtype == np.uint8 else 1
    alpha = 1 - (white.astype(np.float64) - black).mean(2, keepdims=True) / most
    color = np.divide(black / most, alpha, out=np.zeros(black.shape), where=alpha > 0)
    pixels = np.concatenate([color, alpha], axis=2).clip(0, 1) * most
    return (pixels.round() if most == 255 else pixels).astype(white.dtype)


def is_picture(value: Any) -> bool:
    """Check whether a value is of a type that can represent a picture."""
    kinds = Image.Image | torch.Tensor | bytes | bytearray | memoryview
    is_array = hasattr(value, "__array__") and not isinstance(value, np.generic)  # also those of JAX, h5py, xarray, ...
    return isinstance(value, kinds) or hasattr(value, "read") or is_array


def _pixels(picture: Any, key: str, backdrop: float) -> np.ndarray:
    if hasattr(picture, "read") or isinstance(picture, bytes | bytearray | memoryview):
        return _pixels_of_file(picture, key, backdrop)
    if np.ma.is_masked(picture):
        raise UserError(f"{key} is a masked array; fill the masked pixels: {key}.filled(255)")
    if not isinstance(picture, Image.Image):
        samples = _channels_last(picture, key) if isinstance(picture, torch.Tensor) else np.asarray(picture)
        picture = _to_samples(samples, key)
        if picture.dtype != np.uint8:
            return _over(picture.astype(np.float32), backdrop)
        picture = Image.fromarray(picture)
    if not all(picture.size):
        raise UserError(f"{key} has no pixels; give {KINDS}")
    if picture.mode == "I" and picture.format is None and (most := picture.getextrema()[1]) <= 255:
        raise UserError(f"{key} is a 32-bit PIL image with values up to {most}, nearly black; give {key}.convert('L')")
    try:
        return np.ascontiguousarray(decode_image(picture, backdrop))
    except UserError as error:
        raise UserError(f"{key} {error}") from error
    except (ValueError, OSError, AssertionError) as error:  # errors of Pillow, for example for a closed file
        raise UserError(f"{key} is closed or damaged; give {KINDS}") from error


def _pixels_of_file(file: Any, key: str, backdrop: float) -> np.ndarray:
    """Decode a picture from bytes, or from the beginning of an open file, as if it were a file on disk."""
    if isinstance(file, io.TextIOBase):
        raise UserError(f'{key} is a file opened as text; open it with "rb"')
    try:
        if hasattr(file, "seek"):
            file.seek(0)
        data = file.read() if hasattr(file, "read") else file
    except (ValueError, OSError) as error:
        raise UserError(f"{key} is a closed or unreadable file; give {KINDS}") from error
    with TemporaryDirectory() as folder:
        path = Path(folder, "picture")
        path.write_bytes(data)
        try:
            return read_picture(path, key=key, backdrop=backdrop)
        except UserError as error:
            raise UserError(str(error).replace(f"{key}={path}", f"{key}, {len(data)} bytes,")) from error


def _channels_last(picture: torch.Tensor, key: str) -> np.ndarray:
    """Convert a tensor (C, H, W), (1, C, H, W) or (H, W) to an array (H, W, C)."""
    if picture.layout != torch.strided or picture.is_meta or picture.is_quantized or picture.is_complex():
        raise UserError(f"{key} is a sparse, quantized, complex or meta tensor; give {KINDS}")
    planes = picture.detach().cpu()
    planes = planes[0] if planes.ndim == 4 and len(planes) == 1 else planes
    planes = planes[None] if planes.ndim == 2 else planes
    if planes.ndim != 3 or len(planes) not in CHANNELS:
        cure = "; .permute(2, 0, 1) puts the channels first" if planes.ndim == 3 and planes.shape[2] in CHANNELS else ""
        raise UserError(f"{key} is a tensor of shape {tuple(picture.shape)}; give {KINDS}{cure}")
    return (planes.float() if planes.is_floating_point() else planes).movedim(0, 2).numpy()


def _to_samples(picture: np.ndarray, key: str) -> np.ndarray:
    """Convert an array (H, W), (H, W, C) or (1, H, W, C) to samples (H, W, 3 or 4), uint8 or floats in [0, 1]."""
    shape, samples = picture.shape, picture
    samples = samples[0] if samples.ndim == 4 and len(samples) == 1 else samples
    samples = samples[..., None] if samples.ndim == 2 else samples
    if samples.ndim != 3 or samples.shape[2] not in CHANNELS or not samples.size:
        cure = "; .transpose(1, 2, 0) puts the channels last" if samples.ndim == 3 and len(samples) in CHANNELS else ""
        raise UserError(f"{key} is an array of shape {shape}; give {KINDS}{cure}")
    if samples.shape[0] * samples.shape[1] > MAX_PIXELS:
        raise UserError(f"{key} has {samples.shape[1]} x {samples.shape[0]} pixels; give {MAX_PIXELS} or fewer")
    samples = np.repeat(samples, 3, axis=2) if samples.shape[2] == 1 else samples
    if samples.dtype == np.bool_:
        return samples.astype(np.uint8) * np.uint8(255)
    if samples.dtype == np.uint8:
        return np.ascontiguousarray(samples)
    if samples.dtype.kind not in "iuf":
        raise UserError(f"{key} is an array of {samples.dtype}; give {KINDS}")
    if samples.dtype.kind != "f" or not (samples.min() >= 0 and samples.max() <= 1):  # false for NaN
        least, most = samples.min(), samples.max()
        raise UserError(
            f"{key} is an array of {samples.dtype} from {least:g} to {most:g}; give {_suggest_cure(least, most, key)}"
        )
    return samples


def _suggest_cure(least: float, most: float, key: str) -> str:
    """Suggest an expression that scales an array to an accepted range, based on its values."""
    if not np.isfinite([least, most]).all():
        return f"np.nan_to_num({key}), whose numbers are finite, uint8, or floats from 0 to 1"
    if least < 0:
        return f"({key} + 1) / 2, if it goes from -1 to 1: uint8, bool, or floats from 0 to 1"
    if most <= 1:
        return f"{key}.astype(bool), if it is a mask, or {key} / 255"
    return f"{key} / {255 if most <= 255 else 65535}, floats from 0 to 1, or uint8"


def _over(picture: np.ndarray, backdrop: float) -> np.ndarray:
    color, alpha = picture[..., :3], picture[..., 3:]
    return color.copy() if alpha.shape[2] == 0 else color * alpha + backdrop * (1 - alpha)
