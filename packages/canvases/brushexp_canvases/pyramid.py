"""Make pyramids from large pictures: levels of halved size, and static Deep Zoom and IIIF files for viewers."""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from PIL import Image

from brushexp.contracts import UserError
from brushexp.contracts.files import TEMPORARY, note_files, write_json, write_text
from brushexp.contracts.pictures import Region

TILE = 512  # side of a file in pixels
QUALITY = 90  # JPEG quality
BASE = "http://localhost:8000"  # default base address of IIIF documents
LARGEST_WHOLE = 4096  # longer side in pixels of the largest level offered as one IIIF file
DEEP_ZOOM = "http://schemas.microsoft.com/deepzoom/2008"
HALVED_CHUNK = 1024  # side in pixels of the parts halved at a time

Read = Callable[[Region], np.ndarray]


@dataclass(frozen=True)
class Level:
    """A picture at one resolution: its size (H, W), and a function that reads a region (3, h, w), uint8."""

    size: tuple[int, int]
    read: Read

    @property
    def whole(self) -> Region:
        """Region that covers the whole level."""
        return Region(0, 0, *self.size)


def halve(whole: Any, make: Callable[[int, tuple[int, int, int]], Any]) -> list[Level]:
    """Halve a picture repeatedly until both sides are at most `TILE`; return all levels, beginning with the picture.

    ``whole`` is an array (3, H, W) uint8; ``make`` allocates the array of a level from its number, starting at 1, and
    its shape.
    """
    levels = [level_of(whole)]
    while max(levels[-1].size) > TILE:
        height, width = (-(-side // 2) for side in levels[-1].size)
        array = make(len(levels), (3, height, width))
        for part in Region(0, 0, height, width).tiles(HALVED_CHUNK):
            place = Region(2 * part.top, 2 * part.left, 2 * part.height, 2 * part.width)
            array[slices_of(part)] = halve_pixels(levels[-1].read(place))
        levels.append(level_of(array))
    return levels


def slices_of(region: Region) -> tuple[slice, slice, slice]:
    """Return the slices that select a region in an array (3, H, W)."""
    rows = slice(region.top, region.top + region.height)
    return slice(None), rows, slice(region.left, region.left + region.width)


def add_levels(group: Any, name: str) -> list[Level]:
    """Add levels ``1``, ``2``, ... to level ``0`` (3, H, W) of a Zarr group, and mark it as an OME-Zarr image.

    Each pixel of a level is the mean of four pixels of the previous level.
    """

    def make(number: int, shape: tuple[int, int, int]) -> Any:
        chunks = group["0"].chunks
        return group.create_array(str(number), shape=shape, chunks=chunks, dtype="uint8", overwrite=True)

    levels = halve(group["0"], make)
    group.attrs["ome"] = describe(name, len(levels))
    return levels


def describe(name: str, count: int) -> dict[str, Any]:
    """Return the OME-Zarr 0.5 metadata of an RGB image with ``count`` levels."""
    datasets = [
        {"path": str(number), "coordinateTransformations": [{"type": "scale", "scale": [1, 2**number, 2**number]}]}
        for number in range(count)
    ]
    axes = [{"name": "c", "type": "channel"}, {"name": "y", "type": "space"}, {"name": "x", "type": "space"}]
    colors = [("red", "FF0000"), ("green", "00FF00"), ("blue", "0000FF")]
    window = {"start": 0, "end": 255, "min": 0, "max": 255}
    channels = [{"label": label, "color": color, "active": True, "window": window} for label, color in colors]
    image = {"name": name, "axes": axes, "datasets": datasets, "type": "mean"}
    return {"version": "0.5", "multiscales": [image], "omero": {"channels": channels}}


def level_of(array: Any) -> Level:
    """Make a level from a NumPy or Zarr array (3, H, W)."""
    return Level((array.shape[1], array.shape[2]), lambda region: np.asarray(array[slices_of(region)]))


def halve_pixels(pixels: np.ndarray) -> np.ndarray:
    """Average pixels (3, h, w), uint8, over 2 x 2 squares; a last row or column without a partner is repeated."""
    odd = [(0, 0), (0, pixels.shape[1] % 2), (0, pixels.shape[2] % 2)]
    even = np.pad(pixels, odd, mode="edge").astype(np.uint16)
    total = even[:, ::2, ::2] + even[:, 1::2, ::2] + even[:, ::2, 1::2] + even[:, 1::2, 1::2]
    return ((total + 2) // 4).astype(np.uint8)


def write_dzi(folder: Path, name: str, levels: list[Level]) -> list[Path]:
    """Write ``name.dzi`` and the tiles ``name_files/level/column_row.jpg`` of a Deep Zoom image; return both paths."""
    height, width = levels[0].size
    everything = list(levels)
    while max(everything[-1].size) > 1:  # Deep Zoom continues down to a single pixel
        everything.append(level_of(halve_pixels(everything[-1].read(everything[-1].whole))))
    with atomic_folder(tiles := folder / f"{name}_files") as into:
        for number, level in enumerate(reversed(everything)):
            for region in level.whole.tiles(TILE):
                tile = f"{region.left // TILE}_{region.top // TILE}.jpg"
                _write_jpeg(into / str(number) / tile, level.read(region))
    size = f'<Size Width="{width}" Height="{height}"/>'
    opening = f'<Image xmlns="{DEEP_ZOOM}" Format="jpg" Overlap="0" TileSize="{TILE}">'
    write_text(path := folder / f"{name}.dzi", f'<?xml version="1.0" encoding="UTF-8"?>\n{opening}{size}</Image>\n')
    return [path, tiles]


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder that replaces ``path`` on success and is removed on failure."""
    with TemporaryDirectory(prefix=TEMPORARY[:-1], dir=path.parent) as temporary:
        (into := Path(temporary, path.name)).mkdir()
        yield into
        if path.is_dir():
            path.rename(Path(temporary, "before"))
        os.replace(into, path)
        note_files(path.parent, [file for file in path.rglob("*") if file.is_file()])


def grey_of(shares: np.ndarray) -> np.ndarray:
    """Make a grey picture (3, h, w), uint8, from values (h, w); 0 is black, and 1 or more is white."""
    return np.broadcast_to((255 * shares.clip(0, 1) + 0.5).astype(np.uint8), (3, *shares.shape))


def write_iiif(folder: Path, names: dict[str, list[Level]], title: str, base: str = BASE) -> list[Path]:
    """Write pictures as static files of the IIIF Image API 3.0, level 0, and a manifest of the Presentation API 3.0.

    ``names`` maps the name of each picture to its levels; all pictures have the same size, and the first is the
    painting. The documents refer to each other by addresses that begin with ``base``, where the folder will be served.
    Because there is no image server, viewers can only request tiles and whole pictures of up to `LARGEST_WHOLE` pixels.
    """
    if not base.startswith(("http://", "https://")):
        raise UserError(f"base={base} is not an address; give the files' future address, https://example.org/rhone")
    base = base.rstrip("/")
    folder.mkdir(exist_ok=True)
    for name, levels in names.items():
        with atomic_folder(folder / name) as into:
            (into / "info.json").write_text(json.dumps(_write_image(into, f"{base}/{name}", levels), indent=2))
    first = next(iter(names))
    size = names[first][0].size
    write_json(path := folder / "manifest.json", manifest_of(base, list(names), size, title))
    note_files(folder.parent, [file for file in folder.rglob("*") if file.is_file()])  # if it is a run's folder
    return [path, *(folder / name for name in names)]


def _write_image(folder: Path, address: str, levels: list[Level]) -> dict[str, Any]:
    height, width = levels[0].size
    wholes = []
    for number, level in enumerate(levels):
        scale = 2**number
        for region in level.whole.tiles(TILE):
            left, top = region.left * scale, region.top * scale
            right, bottom = min(width, left + TILE * scale), min(height, top + TILE * scale)
            is_whole = (right - left, bottom - top) == (width, height)
            part = "full" if is_whole else f"{left},{top},{right - left},{bottom - top}"
            size = f"{region.width},{region.height}"
            _write_jpeg(folder / part / size / "0" / "default.jpg", level.read(region))
        if max(level.size) <= LARGEST_WHOLE:
            whole = level.read(level.whole)
            wholes.append({"width": level.size[1], "height": level.size[0]})
            _write_jpeg(folder / "full" / f"{level.size[1]},{level.size[0]}" / "0" / "default.jpg", whole)
            if len(wholes) == 1:
                _write_jpeg(folder / "full" / "max" / "0" / "default.jpg", whole)
    info = {
        "@context": "http://iiif.io/api/image/3/context.json",
        "id": address,
        "type": "ImageService3",
        "protocol": "http://iiif.io/api/image",
        "profile": "level0",
        "width": width,
        "height": height,
        "sizes": wholes[::-1],
        "tiles": [{"width": TILE, "height": TILE, "scaleFactors": [2**number for number in range(len(levels))]}],
    }
    largest = wholes[0]
    if largest["width"] < width:
        info |= {"maxWidth": largest["width"], "maxHeight": largest["height"]}
    return info


def manifest_of(base: str, names: list[str], size: tuple[int, int], title: str) -> dict[str, Any]:
    """Return a manifest that presents pictures of the same ``size`` (H, W) as alternative layers of one canvas."""
    height, width = size
    canvas, shape = f"{base}/canvas", {"height": height, "width": width}
    bodies = [
        {
            "id": f"{base}/{name}/full/max/0/default.jpg",
            "type": "Image",
            "label": {"en": [name]},
            "format": "image/jpeg",
            **shape,
            "service": [{"id": f"{base}/{name}", "type": "ImageService3", "profile": "level0"}],
        }
        for name in names
    ]
    body = bodies[0] if len(bodies) == 1 else {"type": "Choice", "items": bodies}
    painting = {
        "id": f"{canvas}/painting",
        "type": "Annotation",
        "motivation": "painting",
        "body": body,
        "target": canvas,
    }
    page = {"id": f"{canvas}/page", "type": "AnnotationPage", "items": [painting]}
    return {
        "@context": "http://iiif.io/api/presentation/3/context.json",
        "id": f"{base}/manifest.json",
        "type": "Manifest",
        "label": {"en": [title]},
        "items": [{"id": canvas, "type": "Canvas", **shape, "items": [page]}],
    }


def _write_jpeg(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.ascontiguousarray(pixels.transpose(1, 2, 0))).save(path, "JPEG", quality=QUALITY, subsampling=0)
