"""Pictures that a program holds in memory: each has a name, which stands in a config where the path of a file does."""

from itertools import count
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
import torch
from PIL import Image

from brushexp.errors import UserError
from brushexp.pictures.decode import MAX_PIXELS, unpacked
from brushexp.system.files import replacing, write_picture

KINDS = "a path, a PIL image, an array (H, W, 3) or (H, W), or a tensor (3, H, W); uint8, or floats from 0 to 1"


class HeldPicture:
    """A picture, (H, W, 3) uint8 or float32 in [0, 1], which is found by its name as long as this object lives.

    A UserError if ``picture`` is no PIL image, array (H, W, 3) or (H, W), or tensor (3, H, W), of uint8 or of floats in
    [0, 1]; ``key`` is what it is for. What is transparent in a PIL image lies over white.

    >>> red = HeldPicture(np.full((2, 3, 3), [1.0, 0.0, 0.0]))
    >>> pixels_of(red.name).shape
    (2, 3, 3)
    """

    def __init__(self, picture: Any, key: str = "image") -> None:
        self.pixels = _pixels(picture, key)
        self.name = f"picture {next(_numbers)} in memory"
        _held[self.name] = self

    def write(self, folder: Path, stem: str) -> Path:
        """Write it as a file in which every pixel is what it is here: PNG, or TIFF of floats."""
        if self.pixels.dtype == np.uint8:
            write_picture(path := folder / f"{stem}.png", self.pixels)
            return path
        from tifffile import imwrite  # noqa: PLC0415  (rarely needed)

        with replacing(path := folder / f"{stem}.tif") as temporary:
            imwrite(temporary, self.pixels, photometric="rgb")
        return path


_held: WeakValueDictionary[str, HeldPicture] = WeakValueDictionary()
_numbers = count(1)


def pixels_of(name: str) -> np.ndarray | None:
    """The picture (H, W, 3) of this name; None if none is held."""
    picture = _held.get(name)
    return None if picture is None else picture.pixels


def is_picture(value: Any) -> bool:
    """Whether a value is of a kind that can be held."""
    return isinstance(value, Image.Image | np.ndarray | torch.Tensor)


def _pixels(picture: Any, key: str) -> np.ndarray:
    if isinstance(picture, Image.Image):
        return _pixels_of_pillow(picture, key)
    if isinstance(picture, torch.Tensor):
        if picture.layout != torch.strided or picture.is_meta:
            raise UserError(f"{key} is a tensor that is sparse or without numbers; give {KINDS}")
        if picture.ndim != 3 or len(picture) != 3:
            raise UserError(f"{key} is a tensor of shape {tuple(picture.shape)}; give {KINDS}")
        picture = picture.detach().movedim(0, 2).cpu().float().numpy() if picture.is_floating_point() else (
            picture.movedim(0, 2).cpu().numpy()
        )  # fmt: skip
    if not isinstance(picture, np.ndarray):
        raise UserError(f"{key} is a {type(picture).__name__}; give {KINDS}")
    picture = np.asarray(picture)  # no subclass, whose methods may be others
    picture = np.stack([picture] * 3, 2) if picture.ndim == 2 else picture
    if picture.ndim != 3 or picture.shape[2] != 3 or not picture.size:
        raise UserError(f"{key} is an array of shape {picture.shape}; give {KINDS}")
    if picture.shape[0] * picture.shape[1] > MAX_PIXELS:
        raise UserError(f"{key} has {picture.shape[1]} x {picture.shape[0]} pixels; give {MAX_PIXELS} or fewer")
    if picture.dtype == np.uint8:
        return picture.copy()
    if picture.dtype.kind not in "biuf":
        raise UserError(f"{key} is an array of {picture.dtype}; give {KINDS}")
    if picture.dtype.kind != "f" or not (picture.min() >= 0 and picture.max() <= 1):  # false of NaN
        reach = f"{picture.dtype} from {picture.min():g} to {picture.max():g}"
        raise UserError(f"{key} is an array of {reach}; give {KINDS}")
    return picture.astype(np.float32)


def _pixels_of_pillow(picture: Image.Image, key: str) -> np.ndarray:
    if not all(picture.size):
        raise UserError(f"{key} is a picture without pixels; give {KINDS}")
    try:
        return np.ascontiguousarray(unpacked(picture))
    except UserError as error:
        raise UserError(f"{key} {error}") from error
    except (ValueError, OSError, AssertionError) as error:  # of Pillow, also where a file is closed
        raise UserError(f"{key} is closed or damaged ({error}); give {KINDS}") from error
