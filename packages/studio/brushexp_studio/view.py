"""``task=view``: show the page of a painting, a run or a sweep in the browser."""

import logging
from pathlib import Path

from omegaconf import DictConfig

from brushexp.contracts import UserError, build
from brushexp.contracts.families import ExportJob
from brushexp.contracts.files import METRICS_FILE, as_shown, write_text
from brushexp.contracts.pages import LARGEST_SIDE, PAGE_NAME, page_in, run_page, write_sweep_page
from brushexp.contracts.painting import Finished, export_job, with_renderer
from brushexp.contracts.results import gather, read_painting
from brushexp.contracts.strokes import load_catalogue
from brushexp_studio.serving import serve, show_until_interrupted

log = logging.getLogger(__name__)
SHOWN = ("catalogue.h5", "report.html")  # files in a run's folder that can be viewed


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Serve the page of a painting, run or sweep until Ctrl-C; a missing page is written into this run's folder."""
    source = newest_run() if cfg.catalogue is None else Path(cfg.catalogue)
    pages = pages_of(cfg, source, folder)
    with serve(pages, cfg.port) as address:
        log.info("%s is served at %s until Ctrl-C", as_shown(source), address)
        show_until_interrupted(address, in_browser=cfg.open)
    log.info("the page is no longer served")
    return {}


def pages_of(cfg: DictConfig, source: Path, folder: Path) -> dict[str, Path]:
    """Map URL paths to the files that are served for a catalogue, a run or a sweep.

    A missing ``report.html`` is written into ``folder``. The pages of a sweep's runs are included. Raises UserError if
    ``source`` is a folder without a run or a sweep.
    """
    page = folder / PAGE_NAME
    if (source / PAGE_NAME).is_file() and cfg.get("renderer") is None:
        jobs = (path.relative_to(source).as_posix() for path in source.glob(f"*/{PAGE_NAME}"))
        return {"/": source / PAGE_NAME} | {f"/{name}": source / name for name in jobs}
    if not source.is_dir():
        path = source.resolve()
        name = path.parent.name if path.stem == "catalogue" else path.stem
        write_text(page, run_page(_draw(_reopen(cfg, source)), name=name or path.stem))
    elif (source / "catalogue.h5").is_file():
        painting = read_painting(source, _reopen(cfg, source / "catalogue.h5"))
        write_text(page, page_in(source, painting))  # the run's folder is not changed
    elif any(source.glob(f"*/{METRICS_FILE}")):
        runs = gather([source], folder)
        write_sweep_page(folder, runs)
        links = [Path(name, PAGE_NAME) for name in runs.index]  # browsers resolve ../../sweep/3 at / to /sweep/3
        return {"/": page} | {"/" + "/".join(p for p in link.parts if p != ".."): folder / link for link in links}
    else:
        raise UserError(
            f"catalogue={source}: neither a run nor a sweep is in this folder; give a catalogue.h5, or the folder "
            "of a finished run or sweep"
        )
    return {"/": page}


def _reopen(cfg: DictConfig, path: Path) -> ExportJob:
    """Open a catalogue with the configured renderer or, if none is configured, with its own."""
    saved, renderer = with_renderer(load_catalogue(path), cfg.get("renderer"), str(path))
    return export_job(saved, renderer, build(cfg.blend), source=str(path))


def _draw(job: ExportJob) -> Finished:
    small = job.at_most(LARGEST_SIDE)  # a larger picture would not fit on the page
    pictures = {"painting": small.picture()}
    if not job.is_bare:
        pictures["flat"] = small.bare().picture()
    return Finished(job, pictures, dict)


def newest_run(folder: Path = Path("outputs")) -> Path:
    """Return the folder of the run or sweep with the newest page or catalogue; raise UserError if there is none."""
    places = {path.parent: path.stat().st_mtime for name in SHOWN for path in sorted(folder.glob(f"*/{name}"))}
    if not places:
        raise UserError(f"there is no run in {folder}/; name one to view: brushexp view FOLDER")
    return max(places, key=lambda place: places[place])
