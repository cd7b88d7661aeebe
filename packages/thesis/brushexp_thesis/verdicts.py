"""``task=verdicts``: write claims with verdicts, tables and plots of studies as a page, from finished runs."""

import logging
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from omegaconf import DictConfig

from brushexp.config.compose import SHIPPED
from brushexp.reporting.tables import markdown_table
from brushexp.results.paired import PANELS, PICTURE, Difference, paired_differences, rule_for, write_paired_plot
from brushexp.results.quantities import quantities
from brushexp.results.runs import words_of
from brushexp.system.files import write_text
from brushexp_thesis.claims import SHIPPED_CLAIMS, Claim, read_claims
from brushexp_thesis.study_records import EXPERIMENT, Study, studies_in

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
    """Read what an experiment asks: the first sentence of its file, below the line that Hydra reads."""
    lines = [line for line in experiment.read_text(encoding="utf-8").splitlines() if not line.startswith("# @package")]
    return lines[0].lstrip("# ").partition(" Run:")[0]


def write_verdicts(
    page: Path, studies: Mapping[str, Study], claims: Mapping[str, list[Claim]], questions: Mapping[str, str],
    command: str,
) -> dict[str, int]:  # fmt: skip
    """Write the page, with plots and records in a folder of its name beside it; count the claims by verdict."""
    judged, not_run = [], []
    for claim in (claim for listed in claims.values() for claim in listed):
        difference = studies[claim.study].difference(claim) if claim.study in studies else None
        words = {"claim": claim.says, "verdict": claim.verdict(difference)}
        if difference is None:
            not_run.append(words | {"thesis": claim.section, "command": f"brushexp {EXPERIMENT}{claim.study}"})
        else:
            words |= {"measured": difference.sentence, "compared": f"{claim.setting} against {claim.against}"}
            study = f"[{claim.study}](#{claim.study})"
            judged.append(words | {"metric": quantities()[claim.metric].name, "study": study, "thesis": claim.section})
    verdicts = Counter(row["verdict"] for row in judged + not_run)
    counts = ", ".join(f"{verdict} {count}" for verdict, count in verdicts.most_common())
    lines = ["# Ablations", "", f"Written by `{command}`, and no number in it by hand.", ""]
    lines += [_prose(text) for text in _explanation(claims)]
    lines += ["", f"Verdicts on {len(judged + not_run)} claims: {counts}.", "", *_table(judged)]
    page.parent.mkdir(parents=True, exist_ok=True)
    for name in [*claims, *sorted(set(studies) - set(claims))]:
        if name in studies:
            lines += _section(page, studies[name], questions.get(name, ""))
    lines += ["## Not run", "", *_table(not_run)] if not_run else []
    write_text(page, "\n".join(lines))
    return dict(verdicts)


def _explanation(claims: Mapping[str, list[Claim]]) -> Iterator[str]:
    yield (
        "What the thesis (Heimbrecht, master thesis, Heidelberg, 2020) claims, or chose by trying, and what comes of "
        f"it here; 6.3 and the like are its sections. {rule_for(PICTURE)}"
    )
    yield "Where seeds and not pictures are paired, the same holds of seeds, but no answer depends on one."
    yield (
        "The reference is the first setting of a study's table; where a claim compares two others, its interval is one "
        "for all pairs of settings together."
    )
    yield (
        "A claim of *no worse* holds if the interval allows no loss that matters, however large a gain it allows, and "
        "the answer does not depend on the picture; what was measured is told by the rule above all the same."
    )
    metrics = dict.fromkeys([*PANELS, *(claim.metric for listed in claims.values() for claim in listed)])
    matters = ", ".join(
        f"{quantities()[key].name} {quantities()[key].matters:g}" for key in metrics if quantities()[key].matters
    )
    yield f"What matters: {matters} (of ratios: of their natural logarithm)."


def _prose(text: str) -> str:
    return fill(text, 120, break_long_words=False, break_on_hyphens=False)


def _table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    plain = [{key: str(value).replace("|", "\\|").replace("_", "\\_") for key, value in row.items()} for row in rows]
    return [markdown_table(plain, escape=False), ""] if rows else []


def _section(page: Path, study: Study, question: str) -> list[str]:
    name, command = study.name, shlex.join(["brushexp", *study.words])
    lines = [f"## {name}", "", _prose(question), "", f"`{command}`", "", _prose(_extent(study)), ""]
    differences = paired_differences(study.table)
    if differences:
        picture = page.with_suffix("") / f"{name}.png"
        picture.parent.mkdir(parents=True, exist_ok=True)
        write_paired_plot(picture, differences, name)
        study.record(picture.with_suffix(".csv"))
        files = f"{picture.parent.name}/{name}"
        lines += [*_table(study_rows(study, differences)), f"![Differences of {name}]({files}.png)", ""]
        lines += [f"All numbers: [{name}.csv]({files}.csv).", ""]
    return lines


def _extent(study: Study) -> str:
    kind = study.table.index.names[1]
    of_all = f" of {study.n_jobs}" * (study.n_finished < study.n_jobs)
    failures = f", {study.n_runs - study.n_finished} not finished" * (study.n_runs > study.n_finished)
    units = f"{len(study.units)} {kind}s ({', '.join(study.units)})"
    return f"{units}, {study.n_finished}{of_all} runs{failures}; {study.cost}."


def study_rows(study: Study, differences: Sequence[Difference]) -> list[dict[str, str]]:
    """Make a row per setting: the mean of the first metric where all were run, and differences to the first setting."""
    of_metric = dict.fromkeys(one.metric for one in differences)
    metrics = [key for key in PANELS if key in of_metric][:3]
    metrics += [key for key in ("cpu_seconds",) if key in of_metric and key not in metrics]
    metrics = metrics or [differences[0].metric]
    first = quantities()[metrics[0]]
    means = study.table.loc[(slice(None), study.units), metrics[0]].groupby(level=0, sort=False).mean()
    by_cell = {(one.option, one.metric): one for one in differences}
    rows = []
    for option, mean in means.items():
        row = {"setting": str(option), first.name: f"{mean:.{first.digits}f}"}
        for key in metrics:
            one = by_cell.get((option, key))
            change = "reference" if one is None else f"{one.format_gain(one.mean)} {one.bounds}"
            row[f"{quantities()[key].name}, change"] = change
        gains = [] if (one := by_cell.get((option, metrics[0]))) is None else list(one.gains.values())
        rows.append(row | {"better on": f"{sum(gain > 0 for gain in gains)} of {len(gains)}" if gains else ""})
    return rows
