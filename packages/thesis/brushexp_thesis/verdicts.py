"""``task=verdicts``: what finished studies say of the thesis's claims, as one page."""

import logging
import shlex
from pathlib import Path

from omegaconf import DictConfig

from brushexp.config.compose import SHIPPED
from brushexp.results.runs import words_of
from brushexp_thesis.claims import SHIPPED_CLAIMS, read_claims
from brushexp_thesis.studies_page import write_verdicts
from brushexp_thesis.study_records import studies_in

log = logging.getLogger(__name__)


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write the page of the studies in ``cfg.runs`` to ``cfg.page``, or into this run's folder."""
    claims = read_claims(Path(cfg.claims) if cfg.claims else SHIPPED_CLAIMS)
    studies = studies_in([Path(path) for path in cfg.runs], folder)
    questions = {path.stem: question_of(path) for path in (SHIPPED / "experiment").glob("*.yaml")}
    page = Path(cfg.page) if cfg.page else folder / "ablations.md"
    typed = [word for word in words_of(folder) or ["task=verdicts"] if not word.startswith(("output=", "overwrite="))]
    counts = write_verdicts(page, studies, claims, questions, shlex.join(["brushexp", *typed]))
    log.info("%s: %s", page, ", ".join(f"{count} {verdict}" for verdict, count in counts.items()))
    return {"studies": len(studies), **{verdict.replace(" ", "_"): count for verdict, count in counts.items()}}


def question_of(experiment: Path) -> str:
    """What an experiment asks: the first sentence of its file, below the line that Hydra reads."""
    lines = [line for line in experiment.read_text(encoding="utf-8").splitlines() if not line.startswith("# @package")]
    return lines[0].lstrip("# ").partition(" Run:")[0]
