"""Render a saved painting at any size, as the levels of a pyramid on disk, and archive exported files."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import ZipFile, ZipInfo

import numpy as np

from brushexp.contracts.families import ExportJob
from brushexp.contracts.files import replacing, to_bytes
from brushexp_canvases.pyramid import Level, grey_of, halve

EARLIEST = (1980, 1, 1, 0, 0, 0)  # date of all files in an archive, so that equal paintings give equal archives


@contextmanager
def levels_of(job: ExportJob) -> Iterator[dict[str, list[Level]]]:
    """Yield the levels of the ``painting`` and, if the painting is lit, of its ``height``.

    The levels are kept on disk within the ``with`` block. Heights are grey; the thickest paint is white.
    """
    with TemporaryDirectory(prefix="brushexp-") as folder:

        def levels(name: str, parts: Iterable[tuple[int, np.ndarray]]) -> list[Level]:
            def make(number: int, shape: tuple[int, int, int]) -> Any:
                return np.memmap(Path(folder, f"{name}{number}"), np.uint8, "w+", shape=shape)

            whole = make(0, (3, *job.size))
            for top, part in parts:
                whole[:, top : top + part.shape[1]] = part
            return halve(whole, make)

        pictures = {
            "painting": levels("painting", ((top, to_bytes(band).transpose(2, 0, 1)) for top, band in job.bands()))
        }
        if job.light.depth:
            height = job.height()
            pictures["height"] = levels("height", [(0, grey_of(height / max(float(height.max()), 1e-6)))])
        yield pictures


@contextmanager
def archive(path: Path) -> Iterator[Path]:
    """Yield a temporary folder, then pack its files atomically into a zip file at ``path``."""
    with TemporaryDirectory(prefix="brushexp-") as folder:
        yield Path(folder)
        with replacing(path) as temporary, ZipFile(temporary, "w") as packed:
            for file in sorted(Path(folder).rglob("*")):
                if file.is_file():
                    packed.writestr(ZipInfo(str(file.relative_to(folder)), EARLIEST), file.read_bytes())
