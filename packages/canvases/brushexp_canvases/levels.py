"""Paint a saved painting, of any size, into the levels of a pyramid on disk."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from brushexp.plugins.export.base import ExportJob
from brushexp.system.files import to_bytes
from brushexp_canvases.pyramid import Level, halve


@contextmanager
def levels_of(job: ExportJob) -> Iterator[list[Level]]:
    """Paint the levels of a painting, which are on disk as long as ``with`` lasts."""
    with TemporaryDirectory(prefix="brushexp-") as folder:

        def make(number: int, shape: tuple[int, int, int]) -> Any:
            return np.memmap(Path(folder, str(number)), np.uint8, "w+", shape=shape)

        whole = make(0, (3, *job.size))
        for top, band in job.bands():
            whole[:, top : top + band.shape[1]] = to_bytes(band).transpose(2, 0, 1)
        yield halve(whole, make)
