"""``task=measure``: recover the strokes of a photograph, and measure them with intervals."""

import logging
from pathlib import Path
from typing import Any

from numpy.typing import NDArray
from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.pictures.load import load_picture
from brushexp_recovery.measure import Recover, Sighting, compare, draws_of, intervals_of, is_apart, sight
from brushexp_recovery.measure_files import MEANING, difference_rows, digits, figure_rows, write_measures
from brushexp_recovery.measure_scale import regions_of, scale_of
from brushexp_recovery.measure_views import View, views_of
from brushexp_recovery.page import write_page
from brushexp_recovery.recover import Recovered, read_recovered, recover, write_recovered
from brushexp_recovery.stroke_rows import remark_on, rows_of

log = logging.getLogger(__name__)

Array = NDArray[Any]


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Measure ``cfg.image``, and ``cfg.against`` if there is one, into the run's folder."""
    image = photograph(cfg.image)
    size = image.shape[:2]
    mm, regions = scale_of(size, cfg.width_cm, cfg.size_cm), regions_of(cfg.region, size)
    found = recover(image) if cfg.recovered is None else recovered_of(Path(cfg.recovered), size)
    write_recovered(folder / "catalogue.h5", found)
    draws = draws_of(sightings(cfg, image, found, recover), regions, cfg.draws, cfg.seed)
    figures = {name: intervals_of(values, mm) for name, values in draws.items()}
    tables = {f"Measures: {name}": without_name(figure_rows({name: one}, mm)) for name, one in figures.items()}
    differences = both_mm = None
    if cfg.against is not None:
        other = photograph(cfg.against, "against")
        other_mm = scale_of(other.shape[:2], cfg.against_width_cm, cfg.against_size_cm, "against_")
        seen = sightings(cfg, other, recover(other), recover)
        whole = draws_of(seen, regions_of(None, other.shape[:2]), cfg.draws, cfg.seed)["whole"]
        differences, both_mm = compare(draws["whole"], whole, (mm, other_mm), cfg.seed), mm if other_mm else None
        tables[f"{Path(cfg.image).name} less {Path(cfg.against).name}"] = difference_rows(differences, both_mm)
        log.info("apart: %s", ", ".join(name for name, one in differences.items() if is_apart(one)) or "nothing")
    rows = rows_of(found, mm)
    paths = write_measures(folder, rows, figures, differences, both_mm)
    paths.append(write_page(folder, image, rows, Path(cfg.image).name, tables=tables, threshold=cfg.threshold))
    log.info("%s: %s", folder, ", ".join(path.name for path in paths))
    for name in ("strokes", "length", "width", "direction"):
        one, unit = figures["whole"][name], "mm" if mm and name in ("length", "width") else ""
        log.info("%s %s, 95 %% between %s and %s %s", name, *map(digits, (one.value, one.low, one.high)), unit)
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


def sightings(cfg: DictConfig, image: Array, found: Recovered, find: Recover) -> list[Sighting]:
    """Recover the strokes of all views; those of the photograph itself are known."""
    seen = []
    for number, view in enumerate(views_of(cfg.views, cfg.seed), start=1):
        seen.append(sight(image, view, (lambda _: found) if view == View() else find))
        log.info("view %d of %d: %d strokes", number, cfg.views, len(seen[-1].confidence))
    return seen


def without_name(table: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Leave out the column that names what a table is of."""
    return [{key: value for key, value in row.items() if key != "of"} for row in table]
