"""Write the painting as an OME-Zarr image."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZipFile

from brushexp.contracts import UserError, register
from brushexp.contracts.families import Exporter, ExportJob
from brushexp_canvases.levels import archive, levels_of
from brushexp_canvases.pyramid import Level, describe, slices_of

CHUNK = 1024  # side of a chunk in pixels


@register("to", "zarr")
@dataclass(kw_only=True)
class Zarr(Exporter):
    """Writes ``painting.ome.zarr.zip``: levels of halved size in chunks (OME-Zarr 0.5), sharp at any resolution."""

    def write(self, job: ExportJob, folder: Path) -> list[Path]:
        with TemporaryDirectory(prefix="brushexp-") as temporary, levels_of(job) as levels:
            write_image(packed := Path(temporary, "painting.zip"), levels["painting"])
            with archive(path := folder / "painting.ome.zarr.zip") as into, ZipFile(packed) as whole:
                whole.extractall(into)
        return [path]


def write_image(path: Path, levels: list[Level]) -> None:
    """Write the levels of an OME-Zarr image into a zip file, one chunk at a time."""
    try:
        import zarr  # noqa: PLC0415  (the extra ``canvas``)
        from zarr.storage import ZipStore  # noqa: PLC0415
    except ImportError as error:
        raise UserError("to=zarr needs Zarr; install it with: pip install 'brushexp[canvas]'") from error
    with warnings.catch_warnings(), ZipStore(path, mode="w") as store:
        warnings.simplefilter("ignore")  # Zarr warns about features that other languages may not support
        group = zarr.create_group(store, attributes={"ome": describe("painting", len(levels))})
        for number, level in enumerate(levels):
            chunks = (3, min(CHUNK, level.size[0]), min(CHUNK, level.size[1]))
            array = group.create_array(str(number), shape=(3, *level.size), chunks=chunks, dtype="uint8")
            for part in level.whole.tiles(CHUNK):
                array[slices_of(part)] = level.read(part)
