"""``task=measure``: recover the strokes of a photograph, and compute their measures with 90 % intervals."""

import logging
import time
from collections.abc import Iterator, Mapping, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any, NamedTuple

import torch
from numpy.typing import NDArray
from omegaconf import DictConfig

from brushexp.contracts import UserError
from brushexp.contracts.files import as_shown, find_path, showing, to_bytes
from brushexp.contracts.pictures import load_picture
from brushexp_recovery.measure.areas import WHOLE, areas_of
from brushexp_recovery.measure.draws import Draws, Sighting, draw_figures, sight
from brushexp_recovery.measure.figure_tables import MEANING, difference_rows, format_number, interval_rows
from brushexp_recovery.measure.files import write_measures
from brushexp_recovery.measure.intervals import Interval, difference_of, intervals_of, is_apart
from brushexp_recovery.measure.measures import MEASURES
from brushexp_recovery.measure.recovery_error import read_errors
from brushexp_recovery.measure.scale import millimetres_per_pixel, width_in_table
from brushexp_recovery.measure.stroke_table import remark_on, tabulate_strokes
from brushexp_recovery.measure.views import View, choose_views
from brushexp_recovery.model.recovery_model import load_model
from brushexp_recovery.page.stroke_page import write_page
from brushexp_recovery.raster.threads import Progress
from brushexp_recovery.recover.pipeline import COPIES, recover_with
from brushexp_recovery.recover.storage import Recovered, read_recovered, write_recovered

log = logging.getLogger(__name__)

Array = NDArray[Any]
LOGGED = ("strokes", "length", "width", "direction")  # logged measures


class Comparison(NamedTuple):
    """The differences between two paintings in all measures."""

    title: str
    differences: Mapping[str, Interval]
    mm: float | None  # millimetres per pixel of the first, if the scales of both are known


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Measure ``cfg.image`` and, if given, ``cfg.against``; write the results into the run's folder."""
    image, name = read_photograph(cfg.image), Path(cfg.image).name
    size = image.shape[:2]
    width_cm = cfg.width_cm if cfg.sizes is None else width_in_table(find_path(cfg.sizes), cfg.image)
    mm, areas = millimetres_per_pixel(size, width_cm, cfg.size_cm), areas_of(cfg.region, size)
    recovered = recover_photograph(cfg, image, name) if cfg.recovered is None else read_for(Path(cfg.recovered), size)
    write_recovered(folder / "catalogue.h5", recovered)
    draws = draw_figures(sight_views(cfg, image, name, recovered), areas, cfg.draws, cfg.seed)
    corrected = {area: correct_draws(cfg, values, recovered) for area, values in draws.items()}
    figures = {area: intervals_of(values, mm, corrected[area]) for area, values in draws.items()}
    tables = {f"Measures: {area}": interval_rows(intervals, mm) for area, intervals in figures.items()}
    comparison = None if cfg.against is None else compare(cfg, corrected[WHOLE], mm, name)
    if comparison is not None:
        tables[comparison.title] = difference_rows(comparison.differences, comparison.mm)
    strokes = tabulate_strokes(recovered, mm)
    differences, both_mm = (None, None) if comparison is None else (comparison.differences, comparison.mm)
    paths = write_measures(folder, strokes, figures, differences, both_mm)
    pixels = to_bytes(torch.from_numpy(image).permute(2, 0, 1))
    paths.append(write_page(folder, pixels, strokes, name, tables=tables, threshold=cfg.threshold))
    log_figures(folder, paths, figures[WHOLE], mm)
    if (remark := remark_on(strokes)) is not None:
        log.warning(remark)
    return {"n_strokes": len(strokes), **{f"measured_{name}": one.value for name, one in figures[WHOLE].items()}}


def read_photograph(path: str, key: str = "image") -> Array:
    """Read a photograph at full size as a picture (H, W, 3) in [0, 1]."""
    picture: Array = load_picture(path, None, key).permute(1, 2, 0).numpy()
    return picture


def read_for(path: Path, size: tuple[int, int]) -> Recovered:
    """Read recovered strokes; raise UserError if they belong to a picture of another size."""
    recovered = read_recovered(path)
    if recovered.saved.size != size:
        raise UserError(
            f"recovered={path} belongs to a picture of {recovered.saved.size[1]} x {recovered.saved.size[0]} pixels, "
            f"but image= has {size[1]} x {size[0]}; give the photograph of that run"
        )
    return recovered


def recover_photograph(cfg: DictConfig, image: Array, name: str) -> Recovered:
    """Recover the strokes of a photograph, and log an estimate of the time that its other views will take."""
    begin = time.monotonic()
    with showing(f"finding strokes in {name}") as show:
        recovered = recover_picture(image, show)
    took = time.monotonic() - begin
    log.info("%s: %d strokes, found in %s", name, len(recovered.confidence), timedelta(seconds=round(took)))
    if cfg.views > 1:
        rest = timedelta(seconds=round(took * (cfg.views - 1)))
        log.info("intervals come from %d small changes of the photograph, in about %s", cfg.views - 1, rest)
    return recovered


def recover_picture(image: Array, show: Progress) -> Recovered:
    """Recover the strokes of a picture (H, W, 3), as ``task=recover`` does by default."""
    return recover_with(load_model(), image, None, COPIES, show)


def sight_views(cfg: DictConfig, image: Array, name: str, recovered: Recovered) -> Iterator[Sighting]:
    """Recover and yield the strokes of each view; those of the photograph itself are already in ``recovered``."""
    original, *changes = choose_views(cfg.views, cfg.seed)
    yield sight(image, original, lambda _: recovered)
    if not changes:
        return
    with showing(f"measuring {name}") as show:
        for number, view in enumerate(changes):
            yield sight_change(image, view, number, len(changes), show)


def sight_change(image: Array, view: View, number: int, count: int, show: Progress) -> Sighting:
    """Recover the strokes of view ``number`` of ``count`` altered views of a photograph."""

    def show_part(share: float, state: str) -> None:
        show((number + share) / count, f"change {number + 1} of {count}, {state}")

    return sight(image, view, lambda picture: recover_picture(picture, show_part))


def correct_draws(cfg: DictConfig, draws: Draws, recovered: Recovered) -> Draws:
    """Correct the samples of a photograph for the errors of recovery, unless ``cfg.correct`` is false."""
    return read_errors().correct(draws, recovered.confidence) if cfg.correct else draws


def compare(cfg: DictConfig, draws: Draws, mm: float | None, name: str) -> Comparison:
    """Measure the photograph ``cfg.against``, and subtract its samples from those of the first painting."""
    image, other_name = read_photograph(cfg.against, "against"), Path(cfg.against).name
    size = image.shape[:2]
    other_mm = millimetres_per_pixel(size, cfg.against_width_cm, cfg.against_size_cm, "against_")
    recovered = recover_photograph(cfg, image, other_name)
    sightings = sight_views(cfg, image, other_name, recovered)
    found = draw_figures(sightings, areas_of(None, size), cfg.draws, cfg.seed)[WHOLE]
    other = correct_draws(cfg, found, recovered)
    differences = difference_of(draws, other, (mm, other_mm), cfg.seed)
    log.info("apart: %s", ", ".join(name for name, one in differences.items() if is_apart(one)) or "nothing")
    return Comparison(f"{name} minus {other_name}", differences, mm if other_mm else None)


def log_figures(folder: Path, paths: Sequence[Path], figures: Mapping[str, Interval], mm: float | None) -> None:
    """Log the names of the files written, and the most informative measures."""
    log.info("%s: %s", as_shown(folder), ", ".join(path.name for path in paths))
    for measure in LOGGED:
        value, low, high = map(format_number, (figures[measure].value, figures[measure].low, figures[measure].high))
        text = f"{value}, 90 % between {low} and {high} {MEASURES[measure].unit_in(mm)}".rstrip()
        log.info("%s %s", measure, "none" if value is None else text)
    log.info(MEANING)
