"""Read the pictures and metrics of a painting from its run folder."""

import logging
from pathlib import Path
from typing import Any

import numpy as np

from brushexp.errors import UserError
from brushexp.painting.finished import Finished
from brushexp.pictures.decode import open_picture
from brushexp.pictures.shape import resample
from brushexp.plugins.export.base import ExportJob
from brushexp.results.runs import read_result
from brushexp.system.run_files import METRICS_FILE

PICTURES = ("target", "painting", "flat", "style", "focus")  # optional pictures of a run, as named by `Finished`

log = logging.getLogger(__name__)


def read_painting(folder: Path, job: ExportJob) -> Finished:
    """Read the pictures and metrics of a run, and skip damaged pictures with a warning.

    If the painting is larger than the picture on which its strokes were optimised, it is shrunk to that size.
    """
    pictures = dict[str, np.ndarray]()
    for name in PICTURES:
        if (path := folder / f"{name}.png").exists():
            try:
                with open_picture(path) as image:
                    pictures[name] = np.asarray(image.convert("RGB"))
            except UserError as error:
                log.warning("%s is left out: %s", path, error)
    whole = pictures.get("painting")
    small = pictures.get("target", pictures.get("flat"))
    if whole is not None and small is not None:
        pictures["painting"] = resample(whole, small.shape[:2])

    def figures() -> dict[str, Any]:
        return read_result(folder) if (folder / METRICS_FILE).is_file() else {}

    return Finished(job, pictures, figures, whole=whole)
