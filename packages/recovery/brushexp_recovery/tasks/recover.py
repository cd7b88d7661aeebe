"""``task=recover``: recover the strokes of a painting from a photograph."""

import logging
import time
from pathlib import Path
from typing import Any

from numpy.typing import NDArray
from omegaconf import DictConfig

from brushexp.contracts.files import as_shown, find_path, showing, to_bytes, write_json, write_picture, write_text
from brushexp.contracts.machine import peak_memory
from brushexp.contracts.pictures import load_picture
from brushexp.contracts.results import csv_table
from brushexp.contracts.runs import Status, render
from brushexp_recovery.marks.corrections import correct
from brushexp_recovery.marks.marks_file import read_marks
from brushexp_recovery.measure.order_graph import write_order_graph
from brushexp_recovery.measure.scale import millimetres_per_pixel
from brushexp_recovery.measure.stroke_table import StrokeTable, columns_with_units, remark_on, tabulate_strokes
from brushexp_recovery.model.recovery_model import load_model
from brushexp_recovery.page.stroke_page import write_page
from brushexp_recovery.raster.labels import color_labels
from brushexp_recovery.raster.threads import Progress, return_freed_memory
from brushexp_recovery.recover.pipeline import recover_with
from brushexp_recovery.recover.storage import Recovered, write_recovered
from brushexp_recovery.train.marked_painting import FEWEST_MARKS, choose_scale, fit_judges, marks_by_hand

Array = NDArray[Any]
log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Recover strokes, write a catalogue, pictures, a table and a page into the run's folder, and return metrics."""
    picture = load_picture(cfg.image, None)
    model = load_model(cfg.weights)
    image = picture.permute(1, 2, 0).numpy()
    marks = None if cfg.marks is None else read_marks(find_path(cfg.marks))
    scale = cfg.scale
    if marks is not None and len(marks_by_hand(marks)) >= FEWEST_MARKS:
        scale = choose_scale(model, image, marks) if scale is None else scale
        fitted = fit_judges(model, image, marks, scale, cfg.seed)
        words = (
            "do not learn from the marks, which would not improve them" if fitted is model else "learn from the marks"
        )
        log.info("finding strokes at %.2f times the size of the photograph; the judges %s", scale, words)
        model = fitted
    with showing("finding strokes") as show:
        recovered = recover_with(model, image, scale, cfg.copies, show)
    if marks is not None:
        before = len(recovered.confidence)
        recovered = correct(recovered, marks, image)
        log.info("%d strokes were found; the corrections leave %d", before, len(recovered.confidence))
    pixels = to_bytes(picture)
    del picture, image  # frees copies that are four times as large
    with showing("writing files") as show:
        strokes = write_files(cfg, folder, pixels, recovered, show)
    covered = float((recovered.labels >= 0).mean())
    metrics: dict[str, object] = {
        "n_strokes": len(strokes),
        "covered": covered,
        "ground": None if recovered.ground is None else float(recovered.ground.mean()),
        "confidence": float(recovered.confidence.mean()) if len(strokes) else None,
        "seconds_total": time.monotonic() - start,
        "peak_memory_mb": peak_memory(),
        "picture": "painting.png",
        "status": Status.COMPLETED,
    }
    write_json(folder / "metrics.json", metrics)
    log.info("%s: %d strokes on %.0f %% of the picture", as_shown(folder), len(strokes), 100 * covered)
    if (remark := remark_on(strokes)) is not None:
        log.warning(remark)
    return metrics


@return_freed_memory()
def write_files(cfg: DictConfig, folder: Path, pixels: Array, recovered: Recovered, show: Progress) -> StrokeTable:
    """Write the files of strokes recovered from a photograph (H, W, 3) uint8, and return the table of strokes."""
    saved = recovered.saved
    show(0.0, "catalogue.h5")
    write_recovered(folder / "catalogue.h5", recovered)
    write_picture(folder / "target.png", pixels)
    show(0.2, "painting.png")
    painting = render(saved.strokes, saved.size, depth=saved.depth, background=saved.background)
    write_picture(folder / "painting.png", painting)
    del painting
    show(0.5, "strokes.csv")
    write_picture(folder / "regions.png", color_labels(recovered.labels))
    strokes = tabulate_strokes(recovered, millimetres_per_pixel(saved.size, cfg.width_cm, None))
    write_text(folder / "strokes.csv", csv_table(columns_with_units(strokes), significant=6))
    write_order_graph(folder / "order.graphml", strokes, recovered)
    show(0.7, "strokes.html")
    write_page(folder, pixels, strokes, Path(cfg.image).name)
    return strokes
