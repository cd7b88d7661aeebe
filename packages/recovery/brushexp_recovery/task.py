"""``task=recover``: the strokes of a painting, from a photograph of it."""

import logging
import time
from pathlib import Path
from typing import Any

from numpy.typing import NDArray
from omegaconf import DictConfig

from brushexp.api.parts import render
from brushexp.pictures.load import load_picture
from brushexp.reporting.tables import csv_table
from brushexp.system.files import to_bytes, write_json, write_picture, write_text
from brushexp.system.progress import showing
from brushexp.system.runtime import peak_memory
from brushexp.system.terminal import as_shown
from brushexp_recovery.measure_scale import scale_of
from brushexp_recovery.model import load_model
from brushexp_recovery.page import write_page
from brushexp_recovery.raster.labels import color_labels
from brushexp_recovery.raster.threads import return_freed_memory
from brushexp_recovery.recover import recover_with
from brushexp_recovery.storage import Recovered, write_recovered
from brushexp_recovery.stroke_rows import Rows, remark_on, rows_of, table_with_units

Array = NDArray[Any]
log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write catalogue.h5, the recovered painting, its regions, table and page into the run's folder, and figures."""
    picture = load_picture(cfg.image, None)
    model = load_model(cfg.weights)
    with showing("finding strokes") as show:
        recovered = recover_with(model, picture.permute(1, 2, 0).numpy(), cfg.scale, cfg.copies, show)
    pixels = to_bytes(picture)
    del picture  # which is four times as large
    rows = write_files(cfg, folder, pixels, recovered)
    metrics = figures_of(recovered) | {"seconds_total": time.monotonic() - start, "peak_memory_mb": peak_memory()}
    metrics |= {"picture": "painting.png", "status": "completed"}
    write_json(folder / "metrics.json", metrics)
    log.info("%s: %d strokes on %.0f %% of the picture", as_shown(folder), len(rows), 100 * metrics["covered"])  # type: ignore[operator]
    if (remark := remark_on(rows)) is not None:
        log.warning(remark)
    return metrics


@return_freed_memory()
def write_files(cfg: DictConfig, folder: Path, pixels: Array, recovered: Recovered) -> Rows:
    """Write what was recovered from a photograph (H, W, 3) uint8, and return its rows."""
    saved = recovered.saved
    write_recovered(folder / "catalogue.h5", recovered)
    write_picture(folder / "target.png", pixels)
    painting = render(saved.strokes, saved.size, depth=saved.depth, background=saved.background)
    write_picture(folder / "painting.png", painting)
    del painting
    write_picture(folder / "regions.png", color_labels(recovered.labels))
    rows = rows_of(recovered, scale_of(saved.size, cfg.width_cm, None))
    write_text(folder / "strokes.csv", csv_table(table_with_units(rows), significant=6))
    write_page(folder, pixels, rows, Path(cfg.image).name)
    return rows


def figures_of(recovered: Recovered) -> dict[str, object]:
    """Count what was recovered."""
    n = len(recovered.saved.strokes)
    return {
        "n_strokes": n,
        "covered": float((recovered.labels >= 0).mean()),
        "confidence": float(recovered.confidence.mean()) if n else None,
    }
