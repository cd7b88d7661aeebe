"""``task=measure``: recover the strokes of a photograph, and measure them with intervals."""

import logging
import time
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.pictures.load import load_picture
from brushexp.system.files import to_bytes
from brushexp.system.progress import showing
from brushexp.system.terminal import as_shown
from brushexp_recovery.finding import Progress
from brushexp_recovery.measure import KINDS, Sighting, compare, draws_of, intervals_of, is_apart, sight
from brushexp_recovery.measure_files import MEANING, difference_rows, digits, figure_rows, write_measures
from brushexp_recovery.measure_scale import regions_of, scale_of
from brushexp_recovery.measure_views import views_of
from brushexp_recovery.model import load_model
from brushexp_recovery.page import write_page
from brushexp_recovery.recover import COPIES, Recovered, read_recovered, recover_with, write_recovered
from brushexp_recovery.stroke_rows import remark_on, rows_of

log = logging.getLogger(__name__)

Array = NDArray[Any]


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Measure ``cfg.image``, and ``cfg.against`` if there is one, into the run's folder."""
    image = photograph(cfg.image)
    size = image.shape[:2]
    mm, regions = scale_of(size, cfg.width_cm, cfg.size_cm), regions_of(cfg.region, size)
    name = Path(cfg.image).name
    found = found_in(cfg, image, name) if cfg.recovered is None else recovered_of(Path(cfg.recovered), size)
    write_recovered(folder / "catalogue.h5", found)
    draws = draws_of(sightings(cfg, image, name, found), regions, cfg.draws, cfg.seed)
    figures = {name: intervals_of(values, mm) for name, values in draws.items()}
    tables = {f"Measures: {name}": without_name(figure_rows({name: one}, mm)) for name, one in figures.items()}
    differences = both_mm = None
    if cfg.against is not None:
        other = photograph(cfg.against, "against")
        other_mm = scale_of(other.shape[:2], cfg.against_width_cm, cfg.against_size_cm, "against_")
        other_name = Path(cfg.against).name
        seen = sightings(cfg, other, other_name, found_in(cfg, other, other_name))
        whole = draws_of(seen, regions_of(None, other.shape[:2]), cfg.draws, cfg.seed)["whole"]
        differences, both_mm = compare(draws["whole"], whole, (mm, other_mm), cfg.seed), mm if other_mm else None
        tables[f"{name} less {other_name}"] = difference_rows(differences, both_mm)
        log.info("apart: %s", ", ".join(name for name, one in differences.items() if is_apart(one)) or "nothing")
    rows = rows_of(found, mm)
    paths = write_measures(folder, rows, figures, differences, both_mm)
    pixels = to_bytes(torch.from_numpy(image).permute(2, 0, 1))
    paths.append(write_page(folder, pixels, rows, name, tables=tables, threshold=cfg.threshold))
    log.info("%s: %s", as_shown(folder), ", ".join(path.name for path in paths))
    for measure in ("strokes", "length", "width", "direction"):
        one, unit = figures["whole"][measure], KINDS[measure].unit_in(mm)
        value, low, high = map(digits, (one.value, one.low, one.high))
        log.info(
            "%s %s", measure, "none" if value is None else f"{value}, 95 % between {low} and {high} {unit}".rstrip()
        )
    log.info(MEANING)
    if (remark := remark_on(rows)) is not None:
        log.warning(remark)
    return {"n_strokes": len(rows), **{f"measured_{name}": one.value for name, one in figures["whole"].items()}}


def photograph(path: str, key: str = "image") -> Array:
    """Read a photograph (H, W, 3) in [0, 1] at its full size."""
    picture: Array = load_picture(path, None, key).permute(1, 2, 0).numpy()
    return picture


def recovered_of(path: Path, size: tuple[int, int]) -> Recovered:
    """Read what was recovered before; a UserError if it is of another picture's size."""
    found = read_recovered(path)
    if found.saved.size != size:
        raise UserError(
            f"recovered={path} is of a picture of {found.saved.size[1]} x {found.saved.size[0]} pixels, and image= has "
            f"{size[1]} x {size[0]}; give the photograph from which it was recovered"
        )
    return found


def found_in(cfg: DictConfig, image: Array, name: str) -> Recovered:
    """Recover the strokes of a photograph, and say how long its views will take."""
    begin = time.monotonic()
    with showing(f"finding strokes in {name}") as show:
        found = find(image, show)
    took = time.monotonic() - begin
    log.info("%s: %d strokes, found in %s", name, len(found.confidence), timedelta(seconds=round(took)))
    if cfg.views > 1:
        rest = timedelta(seconds=round(took * (cfg.views - 1)))
        log.info("intervals come from %d small changes of the photograph, in about %s", cfg.views - 1, rest)
    return found


def find(image: Array, show: Progress) -> Recovered:
    """Recover the strokes of a picture (H, W, 3) as ``task=recover`` does."""
    return recover_with(load_model(), image, None, COPIES, show)


def sightings(cfg: DictConfig, image: Array, name: str, found: Recovered) -> Iterator[Sighting]:
    """Recover the strokes of all views one after the other; those of the photograph itself are ``found``."""
    views = views_of(cfg.views, cfg.seed)
    yield sight(image, views[0], lambda _: found)
    if len(views) == 1:
        return
    with showing(f"measuring {name}") as show:
        for number, view in enumerate(views[1:]):

            def part(share: float, state: str, done: int = number) -> None:
                show((done + share) / (len(views) - 1), f"change {done + 1} of {len(views) - 1}, {state}")

            yield sight(image, view, lambda picture, part=part: find(picture, part))  # type: ignore[misc]


def without_name(table: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Leave out the column that names what a table is of."""
    return [{key: value for key, value in row.items() if key != "of"} for row in table]
