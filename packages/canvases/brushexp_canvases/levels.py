"""Paint a saved painting, of any size, into the levels of a pyramid."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from brushexp.errors import UserError
from brushexp.plugins.export.base import ExportJob
from brushexp.system.files import to_bytes
from brushexp_canvases.pyramid import Level, add_levels

CHUNK = 1024  # pixels of a side of a chunk


def write_levels(path: Path, job: ExportJob) -> list[Level]:
    """Write an OME-Zarr image of a painting, whose levels are then read from it."""
    try:
        import zarr  # noqa: PLC0415  (the extra ``canvas``)
    except ImportError as error:
        raise UserError("pyramids need zarr; install it with: pip install 'brushexp[canvas]'") from error
    height, width = job.size
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Zarr warns of what other languages may not read
        group = zarr.open_group(str(path), mode="w")
        chunks = (3, min(CHUNK, height), min(CHUNK, width))
        whole = group.create_array("0", shape=(3, height, width), chunks=chunks, dtype="uint8")
        for top, band in job.bands():
            whole[:, top : top + band.shape[1]] = to_bytes(band).transpose(2, 0, 1)
        return add_levels(group, "painting")


@contextmanager
def levels_of(job: ExportJob) -> Iterator[list[Level]]:
    """Paint the levels of a painting, which are on disk as long as ``with`` lasts."""
    with TemporaryDirectory(prefix="brushexp-") as folder:
        yield write_levels(Path(folder, "painting.zarr"), job)
