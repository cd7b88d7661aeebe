"""Pictures of any size are read strip by strip, in sRGB of 8 bits.

TIFF, BigTIFF, PNG, JPEG, WebP and HEIC by libvips, JPEG 2000, which the libvips of wheels does not know, by GDAL; and
OME-Zarr.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from brushexp.errors import UserError

STRIP = 256  # rows that are in memory at a time
HIGHEST, LEVELS = 65_535, 257  # white in 16 bits, and its levels for each of 8 bits
DEPTHS = (np.uint8, np.uint16)
JPEG2000 = (b"\x00\x00\x00\x0cjP  \r\n\x87\n", b"\xff\x4f\xff\x51")  # first bytes of a file, and of a codestream
SPACES = {"uint8": ("b-w", "srgb"), "uint16": ("grey16", "rgb16")}  # of libvips, by type: grey, and colour


class Source(Protocol):
    """A picture on disk."""

    size: tuple[int, int]  # height and width in pixels

    def strips(self) -> Iterator[tuple[int, np.ndarray]]:
        """Yield the first row and the pixels (3, h, W) uint8 of each strip, from the top."""


def open_source(path: Path, resolution: int | None = None) -> Source:
    """Open a picture file or an OME-Zarr image, with ``resolution`` pixels on its longer side (libvips only)."""
    if not path.exists():
        raise UserError(f"image={path} is not there; give a picture file or an OME-Zarr image")
    is_zarr = path.is_dir()
    if not is_zarr and not is_jpeg2000(path):
        return PictureFile(path, resolution)
    if resolution is not None:
        kinds = "OME-Zarr and JPEG 2000 are painted as they are"
        raise UserError(f"resolution={resolution} is not for image={path}: {kinds}; drop resolution")
    return ZarrImage(path) if is_zarr else Jpeg2000File(path)


def is_jpeg2000(path: Path) -> bool:
    """Tell by its first bytes whether a file is a JPEG 2000."""
    with path.open("rb") as file:
        return file.read(12).startswith(JPEG2000)


class PictureFile:
    """A file that libvips decodes as a stream: turned as its EXIF says, in sRGB by its profile, over white."""

    def __init__(self, path: Path, resolution: int | None = None) -> None:
        self._vips, self.path = _vips(), path
        with self._explaining():
            image = self._vips.Image.new_from_file(str(path), access="sequential", fail_on="truncated").autorot()
            self._image = in_srgb(image)
            if resolution is not None:
                self._image = self._image.resize(resolution / max(image.width, image.height))
        self.size = (self._image.height, self._image.width)

    def strips(self) -> Iterator[tuple[int, np.ndarray]]:
        (height, width), reader = self.size, self._vips.Region.new(self._image)
        for top in range(0, height, STRIP):
            rows = min(STRIP, height - top)
            with self._explaining():
                pixels = np.frombuffer(reader.fetch(0, top, width, rows), np.uint8)
            yield top, np.ascontiguousarray(pixels.reshape(rows, width, 3).transpose(2, 0, 1))

    @contextmanager
    def _explaining(self) -> Iterator[None]:
        try:
            yield
        except self._vips.Error as error:
            reason = str(error).strip().splitlines()[-1]
            cure = "give a whole TIFF, PNG, JPEG, WebP or HEIC file"
            raise UserError(f"image={self.path} cannot be read by libvips ({reason}); {cure}") from error


def in_srgb(image: Any) -> Any:
    """Convert to sRGB of 8 bits by the profile of a picture, and lay what is transparent over white."""
    if image.get_typeof("icc-profile-data"):
        image = image.icc_transform("srgb", depth=8, intent="relative")
    if image.hasalpha():
        white = HIGHEST if image.format == "ushort" else 255
        image = image.flatten(background=[white] * max(1, image.bands - 1))
    image = image.colourspace("srgb")
    return image.cast("uchar") if image.format != "uchar" else image


class Jpeg2000File:
    """A JPEG 2000 of grey or colour, with alpha or without, of up to 16 bits; its numbers are taken as sRGB."""

    def __init__(self, path: Path) -> None:
        try:
            import rasterio  # noqa: PLC0415  (the extra ``jp2``)
        except ImportError as error:
            cure = "install it with: pip install 'brushexp[canvas,jp2]'"
            raise UserError(f"image={path} is a JPEG 2000, which needs rasterio; {cure}") from error
        self._error, self.path = rasterio.errors.RasterioError, path
        with self._explaining(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that it is no map
            self._file = rasterio.open(path, driver="JP2OpenJPEG")
        kinds = set(self._file.dtypes)
        if len(kinds) > 1 or not kinds <= SPACES.keys() or self._file.count > 4:
            needed = "grey or red, green and blue, in 8 to 16 bits are needed"
            raise UserError(f"image={path} has {self._file.count} channels of {' and '.join(kinds)}; {needed}")
        self.size = (self._file.height, self._file.width)

    def strips(self) -> Iterator[tuple[int, np.ndarray]]:
        from rasterio.windows import Window  # noqa: PLC0415

        height, width = self.size
        for top in range(0, height, STRIP):
            with self._explaining():
                bands = self._file.read(window=Window(0, top, width, min(STRIP, height - top)))
            yield top, np.ascontiguousarray(in_srgb(self._image_of(bands)).numpy().transpose(2, 0, 1))

    def _image_of(self, bands: np.ndarray) -> Any:
        """Hand channels (c, h, w) to libvips, those of 10 or 12 bits stretched to 16."""
        bits = int(self._file.tags(1, ns="IMAGE_STRUCTURE").get("NBITS", 8 * bands.itemsize))
        if bits < 8 * bands.itemsize:
            bands = (bands * (np.iinfo(bands.dtype).max / (2**bits - 1))).round().astype(bands.dtype)
        space = SPACES[bands.dtype.name][len(bands) >= 3]
        return _vips().Image.new_from_array(np.ascontiguousarray(bands.transpose(1, 2, 0)), interpretation=space)

    @contextmanager
    def _explaining(self) -> Iterator[None]:
        try:
            yield
        except self._error as error:
            raise UserError(f"image={self.path} cannot be read by GDAL ({error}); give a whole JPEG 2000") from error


class ZarrImage:
    """The first level of an OME-Zarr image of 8 or 16 bits, whose last axes are (H, W); one more may be 3, not 1."""

    def __init__(self, path: Path) -> None:
        import zarr  # noqa: PLC0415  (the extra ``canvas``)

        try:
            group = zarr.open_group(str(path), mode="r")
            described: Any = group.attrs.get("ome", group.attrs)
            array: Any = group[described["multiscales"][0]["datasets"][0]["path"]]
        except (KeyError, IndexError, TypeError, OSError, ValueError) as error:
            raise UserError(f"image={path} is no OME-Zarr image ({error}); give one, or a picture file") from error
        channels = math.prod(array.shape[:-2])
        if channels not in (1, 3) or array.dtype not in DEPTHS:
            needed = "red, green and blue, or grey, in 8 or 16 bits are needed"
            raise UserError(f"image={path} has shape {array.shape} and type {array.dtype}; {needed}")
        self._array, self.channels, self.size = array, channels, array.shape[-2:]

    def strips(self) -> Iterator[tuple[int, np.ndarray]]:
        height, width = self.size
        for top in range(0, height, STRIP):
            rows = self._array[..., top : top + STRIP, :].reshape(self.channels, -1, width)
            eight = rows if rows.dtype == np.uint8 else (rows / LEVELS).round().astype(np.uint8)
            yield top, np.ascontiguousarray(np.broadcast_to(eight, (3, *eight.shape[1:])))


def _vips() -> Any:
    try:
        import pyvips  # noqa: PLC0415  (the extra ``canvas``)
    except ImportError as error:
        raise UserError("canvas= needs pyvips; install it with: pip install 'brushexp[canvas]'") from error
    return pyvips
