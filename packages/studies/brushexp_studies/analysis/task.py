"""``task=analyse``: measure the brushwork of a saved painting, alone or in comparison with another."""

import logging
from collections.abc import Sequence
from pathlib import Path

from omegaconf import DictConfig

from brushexp.contracts.files import as_shown
from brushexp.contracts.results import MEASURES, shorten
from brushexp.contracts.strokes import load_catalogue
from brushexp_studies.analysis.figures import write_figure
from brushexp_studies.analysis.summary import analysis_of, statistics_of
from brushexp_studies.analysis.summary_text import write_summary

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Measure ``cfg.catalogue`` and, if given, ``cfg.against``; write the results into the run's folder."""
    options = [option for option in ("catalogue", "against") if cfg[option] is not None]
    analyses = []
    for option, name in zip(options, names_of([cfg[option] for option in options]), strict=True):
        saved = load_catalogue(Path(cfg[option]), option)
        analyses.append(analysis_of(saved, name, cfg[option], cfg.radius, cfg.visible, option))
        left_out = analyses[-1].total - len(analyses[-1].number)
        log.info("%s: %d strokes measured, %d left out", cfg[option], len(analyses[-1].number), left_out)
        if setter := analyses[-1].sizes_by:
            log.warning("%s: lengths, widths and areas are set by %s, not by the picture", cfg[option], setter)
    paths = [write_figure(folder / "brushwork.png", analyses), *write_summary(folder, analyses)]
    log.info("%s: %s", as_shown(folder), ", ".join(path.name for path in paths))
    first = analyses[0]
    means = {f"brushwork_{key}": statistics_of(first.values(key), one.axial)["mean"] for key, one in MEASURES.items()}
    return {"n_strokes": len(first.number), **means}


def names_of(paths: Sequence[str]) -> list[str]:
    """Name each catalogue by the shortest suffix of its path that distinguishes it from the others."""
    plain = [str(Path(path).resolve()).removesuffix("/catalogue.h5").removesuffix(".h5") for path in paths]
    if len(set(plain)) < len(plain):  # a painting compared with itself
        return [f"{Path(path).name} ({k + 1})" for k, path in enumerate(plain)]
    return list(shorten(plain).values())
