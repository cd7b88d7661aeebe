"""Store a canvas on disk, with its target, painting and strokes, as Zarr arrays with one chunk per tile."""

import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from brushexp.contracts import UserError
from brushexp.contracts.pictures import Region
from brushexp.contracts.strokes import FIELDS, Strokes
from brushexp_canvases.grid import Grid, Tile
from brushexp_canvases.pyramid import slices_of

PROGRAMS, FORMAT = "brushexp canvas ", "brushexp canvas 1"  # prefix of all formats, and the current one
NUMBERS = sum(field.size or 1 for field in FIELDS.values()) + 2  # numbers per stroke: fields, brush and depth
UNPAINTED = -1  # count of an unpainted tile
PICTURES = ("target", "painting")
HEIGHT = "height"  # a third picture, if the paint has relief: its height in grey, with black for bare canvas
SQUARES = ("seam", "seam_pixels", "all", "all_pixels")  # a tile's squared errors near its borders and in total


class CanvasStore:
    """Arrays of a canvas on disk; a tile counts as painted once its number of strokes (written last) is stored.

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     store = CanvasStore.create(Path(folder, "a.zarr"), Grid((30, 40), side=16, margin=4), 9, {"seed": 0})
    ...     store.write("target", Region(3, 5, 2, 2), np.full((3, 2, 2), 7, np.uint8))
    ...     store.grid.shape, int(store.read("target", Region(0, 0, 16, 16)).sum()), store.is_painted(Tile(0, 0))
    ((2, 3), 84, False)
    """

    def __init__(self, path: Path) -> None:
        self.path, self.root = path, _open(path, "r+")
        kind = str(self.root.attrs.get("format"))
        if kind != FORMAT and kind.startswith(PROGRAMS):
            raise UserError(f"canvas={path} is a {kind}, and this brushexp reads {FORMAT}; update brushexp")
        if kind != FORMAT:
            raise UserError(f"canvas={path} is not a canvas of brushexp; give another path")
        self.record: dict[str, Any] = dict(self.root.attrs["record"])
        size, side, margin = (self.root.attrs[name] for name in ("size", "side", "margin"))
        self.grid = Grid((size[0], size[1]), side, margin)

    @staticmethod
    def create(
        path: Path, grid: Grid, capacity: int, record: dict[str, Any], pictures: Iterable[str] = PICTURES
    ) -> "CanvasStore":
        """Create an empty canvas for at most ``capacity`` strokes per tile, and store its description ``record``."""
        root = _open(path, "w")
        chunk = (3, grid.side, grid.side)
        for name in pictures:
            levels = root.create_group(name)
            _array(levels, "0", (3, *grid.size), chunk, "uint8", 255 if name == "painting" else 0)
        rows, columns = grid.shape
        _array(root, "strokes", (rows, columns, capacity, NUMBERS), (1, 1, capacity, NUMBERS), "float32", 0)
        _array(root, "count", grid.shape, (1, 1), "int32", UNPAINTED)
        _array(root, "squares", (*grid.shape, len(SQUARES)), (1, 1, len(SQUARES)), "float64", np.nan)
        shape = {"size": list(grid.size), "side": grid.side, "margin": grid.margin}
        root.attrs.update({"format": FORMAT, "record": record, **shape})
        return CanvasStore(path)

    def read(self, name: str, region: Region) -> np.ndarray:
        """Read a region (3, h, w), uint8, of the ``target``, the ``painting`` or the `HEIGHT`."""
        part: np.ndarray = self.root[f"{name}/0"][slices_of(region)]
        return part

    def write(self, name: str, region: Region, pixels: np.ndarray) -> None:
        """Write a region (3, h, w), uint8; two processes must not write to the same tile."""
        self.root[f"{name}/0"][slices_of(region)] = pixels

    def is_painted(self, tile: Tile) -> bool:
        return self.count_of(tile) != UNPAINTED

    def is_drawn(self, tile: Tile) -> bool:
        return bool(np.isfinite(self.root["squares"][tile.row, tile.column]).all())

    def count_of(self, tile: Tile) -> int:
        return int(self.root["count"][tile.row, tile.column])

    def strokes_of(self, tiles: Iterable[Tile]) -> tuple[Strokes, Tensor]:
        """Read the N strokes of painted tiles, in canvas pixels, and their depths (N,); larger depths are on top."""
        rows = [self.root["strokes"][tile.row, tile.column, : self.count_of(tile)] for tile in tiles]
        return rows_to_strokes(np.concatenate([np.empty((0, NUMBERS), np.float32), *rows]))

    def put_strokes(self, tile: Tile, strokes: Strokes, depth: Tensor) -> None:
        """Store a tile's strokes with their depths (N,), and mark the tile as painted."""
        self.root["strokes"][tile.row, tile.column, : len(strokes)] = strokes_to_rows(strokes, depth)
        self.root["count"][tile.row, tile.column] = len(strokes)

    def put_squares(self, tile: Tile, squares: Sequence[float]) -> None:
        """Store a tile's errors, in the order of `SQUARES`, and mark the tile as drawn."""
        self.root["squares"][tile.row, tile.column] = squares

    def errors(self) -> dict[str, float]:
        """Compute the mean squared error ``mse``, in [0, 1], and ``seams``, the error at seams relative to the rest."""
        squares = dict(zip(SQUARES, np.nansum(self.root["squares"][:], axis=(0, 1)), strict=True))
        inside, pixels = squares["all"] - squares["seam"], squares["all_pixels"] - squares["seam_pixels"]
        has_both = squares["seam_pixels"] and inside
        ratio = squares["seam"] / squares["seam_pixels"] / (inside / pixels) if has_both else np.nan
        return {"mse": float(squares["all"] / max(1, squares["all_pixels"])), "seams": float(ratio)}

    @property
    def counts(self) -> np.ndarray:
        """Numbers of strokes per tile (rows, columns); `UNPAINTED` in tiles that are not painted yet."""
        counts: np.ndarray = self.root["count"][:]
        return counts


def strokes_to_rows(strokes: Strokes, depth: Tensor) -> np.ndarray:
    """Pack strokes and their depths (N,) into rows (N, `NUMBERS`) of float32."""
    columns = [value.detach().reshape(len(strokes), FIELDS[name].size or 1) for name, value in strokes.items()]
    columns += [column[:, None].to(columns[0]) for column in (strokes.brush, depth)]
    return torch.cat(columns, dim=1).to("cpu", torch.float32).numpy()


def rows_to_strokes(rows: np.ndarray) -> tuple[Strokes, Tensor]:
    """Unpack strokes (with their brushes) and depths from rows (N, `NUMBERS`)."""
    sizes = [field.size or 1 for field in FIELDS.values()]
    *columns, brush, depth = torch.from_numpy(np.ascontiguousarray(rows)).split([*sizes, 1, 1], 1)
    values = {
        name: column if field.size else column[:, 0]
        for (name, field), column in zip(FIELDS.items(), columns, strict=True)
    }
    return Strokes(**values, brush=brush[:, 0].long()), depth[:, 0]


def _open(path: Path, mode: Literal["r+", "w"]) -> Any:
    import zarr  # noqa: PLC0415  (the extra ``canvas``)

    try:
        return zarr.open_group(str(path), mode=mode)
    except (OSError, ValueError, KeyError) as error:
        raise UserError(f"canvas={path} cannot be opened ({error}); give another path") from error


def _array(group: Any, name: str, shape: tuple[int, ...], chunks: tuple[int, ...], dtype: str, fill: float) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Zarr warns about features that other languages may not support
        group.create_array(name, shape=shape, chunks=chunks, dtype=dtype, fill_value=fill)
