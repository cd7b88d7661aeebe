"""Load pictures from files, samples and memory."""

import math
import os
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import torch
from PIL import ImageColor
from torch import Tensor
from torch.nn import functional

from brushexp.bounds import Rule
from brushexp.errors import UserError, similar_words
from brushexp.pictures.decode import picture_size, read_picture
from brushexp.pictures.folders import picture_suffixes
from brushexp.pictures.held import pixels_of
from brushexp.pictures.limits import MAX_PIXELS, too_large
from brushexp.pictures.shape import resample
from brushexp.system.spellings import find_spelling

LEAST_ALPHA = 0.5 / 255  # alpha of the faintest visible pixel
TRANSPARENT = "transparent"  # background of a painting that keeps the alpha of its picture
BRIGHTNESS = (0.299, 0.587, 0.114)  # weights of red, green and blue, Rec. 601
SAMPLE_SUFFIXES = (".png", ".jpg")  # the GIF and TIFF files next to the samples are test data


def load_picture(image: str, resolution: int | None, key: str = "image") -> Tensor:
    """Read a picture, upright and over white, and resample it: (3, H, W) float32, contiguous, sRGB in [0, 1].

    ``image`` is a file, one of ``samples()``, or the name of a picture in memory; ``resolution`` is the longer side in
    pixels, or None to keep the size of the file; ``key`` is the path's key, which messages name. A picture that does
    not exist, cannot be read, or has more than 100 megapixels before or after resampling raises a UserError.
    """
    return planes_of(_pixels_of(image, key, side=resolution), resolution)


def load_cutout(image: str, resolution: int | None, key: str = "image") -> tuple[Tensor, Tensor]:
    """Read a picture as `load_picture` does, but return colours (3, H, W) and alpha (H, W) in [0, 1] separately.

    Alpha is straight. Fully transparent pixels get the mean of the visible colours.
    """
    white, black = (
        planes_of(_pixels_of(image, key, backdrop=backdrop, side=resolution), resolution) for backdrop in (1.0, 0.0)
    )
    alpha = (1 - (white - black).mean(0)).clamp(0, 1)
    seen = alpha > LEAST_ALPHA
    color = (black / alpha.clamp_min(LEAST_ALPHA)).clamp(0, 1)
    rest = color[:, seen].mean(1) if seen.any() else torch.ones(3)
    return torch.where(seen, color, rest[:, None, None]), torch.where(seen, alpha, 0.0)


def planes_of(picture: np.ndarray, resolution: int | None) -> Tensor:
    """Convert a picture (H, W, 3), uint8 or floats in [0, 1], to a tensor, and resample it, as `load_picture` does."""
    if resolution is not None:
        picture = resample(picture, size_at(resolution, *picture.shape[:2]))
    planes = np.ascontiguousarray(np.moveaxis(picture, 2, 0), dtype=np.float32)
    if picture.dtype == np.uint8:
        planes /= 255
    return torch.from_numpy(planes)


def downsample(picture: Tensor, side: int) -> Tensor:
    """Downsample a picture (3, H, W) by area averaging, to at most ``side`` pixels on the longer side: (3, h, w)."""
    height, width = picture.shape[1:]
    zoom = min(side / max(height, width), 1)
    return functional.adaptive_avg_pool2d(picture, (max(round(zoom * height), 1), max(round(zoom * width), 1)))


def size_of_picture(image: str, key: str, resolution: int | None = None, also: str = "") -> tuple[int, int]:
    """Compute the size of the picture that `load_picture` would return, or raise the errors that it would raise."""
    height, width = sides_of_picture(image, key, also)
    if resolution is None and width * height > MAX_PIXELS and pixels_of(image) is None:
        raise UserError(f"{key}={image} {too_large(width, height)}")
    return size_at(resolution, height, width)


def sides_of_picture(image: str, key: str, also: str = "") -> tuple[int, int]:
    """Determine the height and width of a picture of any size, usually without decoding it."""
    if (held := pixels_of(image)) is not None:
        height, width = held.shape[:2]
        return height, width
    path = _path_of(image, key, also)
    return _size_of_file(path, key, path.stat().st_mtime_ns)


def _pixels_of(image: str, key: str, also: str = "", backdrop: float = 1.0, side: int | None = None) -> np.ndarray:
    held = pixels_of(image, backdrop)
    return read_picture(_path_of(image, key, also), key=key, backdrop=backdrop, side=side) if held is None else held


@cache
def _size_of_file(path: Path, key: str, changed: int) -> tuple[int, int]:
    return picture_size(path, key=key)  # for a PNG this may take as long as decoding


PICTURE = Rule(partial(size_of_picture, resolution=1))  # the resolution does not matter here


def load_mask(image: str, size: tuple[int, int], key: str, also: str = "") -> Tensor:
    """Read a picture as grey values (H, W), float32 in [0, 1], resampled to the ``size`` of another picture.

    Grey values are the luma (Rec. 601); transparent pixels are black. ``image`` and ``key`` have the same meaning as
    for `load_picture`, and ``also`` lists other values of the key, such as "auto, ", that messages mention. A different
    aspect ratio raises a UserError.
    """
    picture = _pixels_of(image, key, also, backdrop=0.0, side=max(size))
    check_ratio(image, picture.shape, size, key)
    scale = 255 if picture.dtype == np.uint8 else 1
    grey = np.asarray(resample(picture, size) @ np.array(BRIGHTNESS) / scale, dtype=np.float32)
    return torch.from_numpy(grey).clamp_(0, 1)


def check_ratio(image: str, sides: Sequence[int], size: tuple[int, int], key: str) -> None:
    """Raise a UserError if a picture of ``sides`` (H, W) has a different aspect ratio from ``size``."""
    height, width = sides[:2]
    zoom = max(size) / max(height, width)
    if any(abs(zoom * side - expected) > max(1, zoom) for side, expected in zip((height, width), size, strict=True)):
        cure = "give one with the same aspect ratio"
        raise UserError(f"{key}={image} has {width} x {height} pixels, the picture {size[1]} x {size[0]}; {cure}")


def background_color(spec: str, target: Tensor) -> Tensor:
    """Choose the colour (3,) of the bare canvas, float32 in [0, 1], for a target (3, H, W); see `named_color`."""
    color = named_color(spec, "background")
    if color is None:
        return target.mean((1, 2), dtype=torch.float64).to(torch.float32)
    return torch.tensor(list(color), dtype=torch.float32, device=target.device) / 255


def named_color(spec: str, key: str) -> bytes | None:
    """Convert a CSS colour, such as ``ivory`` or ``#rrggbb``, to bytes.

    Returns None for ``mean`` and ``transparent``, which both stand for the target's average colour here. Raises a
    UserError for anything else.
    """
    if spec in ("mean", TRANSPARENT):
        return None
    try:
        color = bytes(ImageColor.getrgb(spec))
    except ValueError:
        color = b""
    if len(color) != len("RGB"):  # not a colour, or a colour with alpha
        cure = f"use {key}=mean, transparent, '#rrggbb' or a name of CSS: white, black, grey, ivory, ..."
        raise UserError(f"{key}={spec} is not a colour; {cure}")
    return color


def samples() -> dict[str, Path]:
    """Map the names of pictures shipped with scikit-image and matplotlib to their files; none is downloaded."""
    import skimage.data  # noqa: PLC0415  (``--help`` does not need it)

    folder = Path(skimage.data.__file__).parent
    pictures = {path.stem: path for path in folder.iterdir() if path.suffix in SAMPLE_SUFFIXES}
    shipped_with_matplotlib = Path(str(getattr(find_spec("matplotlib"), "origin", ""))).parent / "mpl-data/sample_data"
    portrait = shipped_with_matplotlib / "grace_hopper.jpg"
    return pictures | ({portrait.stem: portrait} if portrait.is_file() else {})


def _path_of(image: str, key: str, also: str = "") -> Path:
    """Find the file named by ``image``, expanding ~, which shells do not expand in ``image=~/photo.jpg``."""
    path = find_spelling(os.path.expanduser(image))  # unlike pathlib's functions, those of os never raise
    if os.path.isfile(path):
        return Path(path)
    shipped = samples()
    if image in shipped:
        return shipped[image]
    if re.match(r"\w+://", image):
        raise UserError(f"{key}={image} is a web address; download the picture and give the path of the file")
    state = "a folder" if os.path.isdir(path) else "a device or a pipe" if os.path.exists(path) else "not there"
    state = "a link to a missing file" if os.path.islink(path) else state
    near = [name for name in nearest_files(image, shipped) if name != image]
    meant = f"did you mean {' or '.join(near)}? " if near else ""
    raise UserError(f"{key}={image} is {state}; {meant}give {also}the path of a picture, or a sample such as coffee")


def nearest_files(image: str, others: Iterable[str] = ()) -> list[str]:
    """List up to three pictures, in the same folder as a path or among ``others``, whose names resemble its name."""
    folder, name = os.path.split(image)
    with suppress(OSError):
        beside = [
            file
            for file in os.listdir(os.path.expanduser(folder) or ".")
            if Path(file).suffix.lower() in picture_suffixes()
        ]
        others = [*beside, *(() if folder else others)]
    names = {file.lower(): file for file in others}
    return [os.path.join(folder, names[near]) for near in similar_words(name, names)]


def shrink_to(most: int, size: tuple[int, int]) -> tuple[int, int]:
    """Scale a height and width in proportion, to at most ``most`` pixels in total.

    >>> shrink_to(100, (10, 40)), shrink_to(100, (5, 20))
    ((5, 20), (5, 20))
    """
    height, width = size
    zoom = math.sqrt(most / (height * width))
    return size if zoom >= 1 else (max(1, math.floor(height * zoom)), max(1, math.floor(width * zoom)))


def size_at(resolution: int | None, height: int, width: int) -> tuple[int, int]:
    """Scale a height and width in proportion so that the longer side is ``resolution``; None keeps the size."""
    if resolution is None:
        return height, width
    longer = max(height, width)
    size = (max(1, round(height * resolution / longer)), max(1, round(width * resolution / longer)))
    if math.prod(size) > MAX_PIXELS:
        most = math.floor(math.sqrt(MAX_PIXELS / (height * width)) * longer)
        raise UserError(
            f"resolution={resolution} makes {size[1]} x {size[0]} pixels, more than {MAX_PIXELS // 10**6} megapixels; "
            f"use resolution={most} or less"
        )
    return size
