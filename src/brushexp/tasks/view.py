"""``task=view``: the page of a saved painting, of a run or of a sweep, in the browser."""

import logging
from dataclasses import replace
from pathlib import Path

from omegaconf import DictConfig

from brushexp.errors import UserError
from brushexp.pages.run_page import LARGEST_SIDE, PAGE_NAME, page_of_run, run_page
from brushexp.pages.serving import served, show_until_interrupted
from brushexp.pages.sweep_page import write_sweep_page
from brushexp.painting.outputs import export_job, with_renderer
from brushexp.plugins.export.png import pixels
from brushexp.registry import build
from brushexp.results.runs import gather
from brushexp.shading.light import UNLIT
from brushexp.strokes.storage import load_catalogue
from brushexp.system.files import write_text
from brushexp.system.run_files import METRICS_FILE

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write the page into this run's folder, and serve it until Ctrl-C."""
    pages = pages_of(cfg, folder)
    with served(pages, cfg.port) as address:
        log.info("%s is at %s until Ctrl-C; it is also in %s", cfg.catalogue, address, folder / PAGE_NAME)
        show_until_interrupted(address, in_browser=cfg.open)
    log.info("the page is no longer served; it stays in %s", folder / PAGE_NAME)
    return {}


def pages_of(cfg: DictConfig, folder: Path) -> dict[str, Path]:
    """Write ``report.html`` into a folder, and tell what is to be served: path of the address -> file.

    With a sweep these are the pages of its runs too. What has no page is refused (UserError).
    """
    source = Path(cfg.catalogue)
    page = folder / PAGE_NAME
    if not source.is_dir():
        write_text(page, page_of_catalogue(cfg))
    elif (source / "catalogue.h5").is_file():
        write_text(page, page_of_run(source))  # the run's own folder stays as it is
    elif any(source.glob(f"*/{METRICS_FILE}")):
        runs = gather([source], folder)
        write_sweep_page(folder, runs)
        links = [Path(name, PAGE_NAME) for name in runs.index]  # a browser goes from / by ../../sweep/3 to /sweep/3
        return {"/": page} | {"/" + "/".join(p for p in link.parts if p != ".."): folder / link for link in links}
    else:
        raise UserError(
            f"catalogue={source}: neither a run nor a sweep is in this folder; give a catalogue.h5, or the folder "
            "of a finished run or sweep"
        )
    return {"/": page}


def page_of_catalogue(cfg: DictConfig) -> str:
    """The page of strokes alone, drawn by the renderer that painted them unless another one is chosen."""
    saved = load_catalogue(Path(cfg.catalogue))
    chosen = cfg.get("renderer")
    try:
        saved, renderer = with_renderer(saved, chosen, cfg.catalogue)
    except UserError as error:
        if chosen is not None:
            raise
        raise UserError(
            f"{cfg.catalogue} was painted with renderer={saved.renderer}, which cannot be built here: {error}; "
            "or draw it with another one: renderer=analytic"
        ) from error
    resolution = min(LARGEST_SIDE, max(saved.size))  # more would not fit into the page
    job = export_job(saved, renderer, build(cfg.blend), saved.renderer, resolution, cfg.catalogue)
    path = Path(cfg.catalogue).resolve()
    name = path.parent.name if path.stem == "catalogue" else path.stem
    pictures = {"painting": pixels(job)}
    if job.light.depth:
        pictures["flat"] = pixels(replace(job, light=UNLIT))
    return run_page(saved, name=name or path.stem, pictures=pictures)
