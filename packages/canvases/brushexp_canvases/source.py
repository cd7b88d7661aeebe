"""Read pictures of any size strip by strip, as 8-bit sRGB.

libvips reads TIFF, BigTIFF, PNG, JPEG, WebP and HEIC; GDAL reads JPEG 2000, which the wheels of libvips cannot read;
Zarr reads OME-Zarr.
"""

import math
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from brushexp.contracts import UserError

STRIP = 256  # number of rows in memory at a time
HIGHEST, LEVELS = 65_535, 257  # white in 16 bits, and 16-bit levels per 8-bit level
DEPTHS = (np.uint8, np.uint16)
JPEG2000 = (b"\x00\x00\x00\x0cjP  \r\n\x87\n", b"\xff\x4f\xff\x51")  # first bytes of a file, and of a codestream
SPACES = {"uint8": ("b-w", "srgb"), "uint16": ("grey16", "rgb16")}  # libvips's names by type: grey and colour


class Source(ABC):
    """Base class for pictures on disk that are read strip by strip."""

    size: tuple[int, int]  # height and width in pixels

    @abstractmethod
    def read(self, top: int, rows: int) -> np.ndarray:
        """Read the pixels (3, rows, W), uint8, of a strip; strips must be read in order from the top."""

    def strips(self) -> Iterator[tuple[int, np.ndarray]]:
        """Yield the index of the first row and the pixels (3, h, W), uint8, of each strip, from top to bottom."""
        for top in range(0, self.size[0], STRIP):
            yield top, np.ascontiguousarray(self.read(top, min(STRIP, self.size[0] - top)))


def open_source(path: Path, resolution: int | None = None) -> Source:
    """Open a picture file or an OME-Zarr image; only libvips supports ``resolution``, the longer side in pixels."""
    is_zarr = path.is_dir()
    if not is_zarr:
        with path.open("rb") as file:
            if not file.read(12).startswith(JPEG2000):
                return PictureFile(path, resolution)
    if resolution is not None:
        kinds = "OME-Zarr and JPEG 2000 are always painted at their own size"
        raise UserError(f"resolution={resolution} has no effect on image={path}: {kinds}; drop resolution")
    return ZarrImage(path) if is_zarr else Jpeg2000File(path)


@contextmanager
def _explaining(path: Path, error: type[Exception], program: str, needed: str) -> Iterator[None]:
    """Raise UserError with an explanation if ``program`` fails to read a file."""
    try:
        yield
    except error as reason:
        words = (str(reason).strip() or type(reason).__name__).splitlines()[-1]
        raise UserError(f"image={path} cannot be read by {program} ({words}); give an undamaged {needed}") from reason


class PictureFile(Source):
    """A file streamed by libvips, rotated according to EXIF, converted to sRGB, and composited over white."""

    def __init__(self, path: Path, resolution: int | None = None) -> None:
        vips = _vips()
        self._explaining = partial(_explaining, path, vips.Error, "libvips", "TIFF, PNG, JPEG, WebP or HEIC file")
        with self._explaining():
            whole = vips.Image.new_from_file(str(path), access="sequential", fail_on="error").autorot()
            image = in_srgb(whole)
            if resolution is not None:
                image = image.resize(resolution / max(whole.width, whole.height))
            self._reader = vips.Region.new(image)
        self.size = (image.height, image.width)

    def read(self, top: int, rows: int) -> np.ndarray:
        with self._explaining():
            pixels = np.frombuffer(self._reader.fetch(0, top, self.size[1], rows), np.uint8)
        return pixels.reshape(rows, -1, 3).transpose(2, 0, 1)


def in_srgb(image: Any) -> Any:
    """Convert a picture from its colour profile to 8-bit sRGB, and composite it over white if it has alpha."""
    if image.get_typeof("icc-profile-data"):
        image = image.icc_transform("srgb", depth=8, intent="relative")
    if image.hasalpha():
        white = HIGHEST if image.format == "ushort" else 255
        image = image.flatten(background=[white] * max(1, image.bands - 1))
    image = image.colourspace("srgb")
    return image.cast("uchar") if image.format != "uchar" else image


class Jpeg2000File(Source):
    """A grey or colour JPEG 2000 file of up to 16 bits, with or without alpha; its values are interpreted as sRGB."""

    def __init__(self, path: Path) -> None:
        try:
            import rasterio  # noqa: PLC0415  (the extra ``jp2``)
        except ImportError as error:
            cure = "install it with: pip install 'brushexp[canvas,jp2]'"
            raise UserError(f"image={path} is a JPEG 2000, which needs rasterio; {cure}") from error
        self._explaining = partial(_explaining, path, rasterio.errors.RasterioError, "GDAL", "JPEG 2000")
        with self._explaining(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # rasterio warns that the file has no map projection
            self._file = rasterio.open(path, driver="JP2OpenJPEG")
        kinds = set(self._file.dtypes)
        if len(kinds) > 1 or not kinds <= SPACES.keys() or self._file.count > 4:
            needed = "grey or red, green and blue, in 8 to 16 bits are needed"
            raise UserError(f"image={path} has {self._file.count} channels of {' and '.join(kinds)}; {needed}")
        self.size = (self._file.height, self._file.width)

    def read(self, top: int, rows: int) -> np.ndarray:
        with self._explaining():
            bands = self._file.read(window=((top, top + rows), (0, self.size[1])))  # (c, rows, W)
        bits = int(self._file.tags(1, ns="IMAGE_STRUCTURE").get("NBITS", 8 * bands.itemsize))
        if bits < 8 * bands.itemsize:
            # libvips expects 10 or 12 bits stretched to 16
            bands = (bands * (np.iinfo(bands.dtype).max / (2**bits - 1))).round().astype(bands.dtype)
        space, pixels = SPACES[bands.dtype.name][len(bands) >= 3], np.ascontiguousarray(bands.transpose(1, 2, 0))
        return in_srgb(_vips().Image.new_from_array(pixels, interpretation=space)).numpy().transpose(2, 0, 1)


class ZarrImage(Source):
    """The first level of an 8-bit or 16-bit OME-Zarr image whose last axes are (H, W), with one or three channels."""

    def __init__(self, path: Path) -> None:
        import zarr  # noqa: PLC0415  (the extra ``canvas``)

        try:
            group = zarr.open_group(str(path), mode="r")
            described: Any = group.attrs.get("ome", group.attrs)
            array: Any = group[described["multiscales"][0]["datasets"][0]["path"]]
        except (KeyError, IndexError, TypeError, OSError, ValueError) as error:
            raise UserError(f"image={path} is not an OME-Zarr image ({error}); give one, or a picture file") from error
        channels = math.prod(array.shape[:-2])
        if channels not in (1, 3) or array.dtype not in DEPTHS:
            needed = "red, green and blue, or grey, in 8 or 16 bits are needed"
            raise UserError(f"image={path} has shape {array.shape} and type {array.dtype}; {needed}")
        self._array, self.channels, self.size = array, channels, array.shape[-2:]

    def read(self, top: int, rows: int) -> np.ndarray:
        pixels = self._array[..., top : top + rows, :].reshape(self.channels, rows, -1)
        eight = pixels if pixels.dtype == np.uint8 else (pixels / LEVELS).round().astype(np.uint8)
        return np.broadcast_to(eight, (3, *eight.shape[1:]))


def _vips() -> Any:
    try:
        import pyvips  # noqa: PLC0415  (the extra ``canvas``)
    except ImportError as error:
        raise UserError("canvas= needs pyvips; install it with: pip install 'brushexp[canvas]'") from error
    return pyvips
