"""``task=verdicts``: write claims with verdicts, tables and plots of studies as a page, from finished runs."""

import logging
import math
import shlex
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from brushexp_studies import paired
from omegaconf import DictConfig

from brushexp.contracts.files import as_shown, conf_folders, read_text, write_text, yaml_of
from brushexp.contracts.results import escape_markdown, markdown_table, quantities, words_of
from brushexp_thesis.claims import CANNOT, NOT_RUN, SHIPPED_CLAIMS, Claim, read_claims
from brushexp_thesis.evidence import RARE
from brushexp_thesis.judgements import Judgement, evidence_row, format_p, judge
from brushexp_thesis.study_records import EXPERIMENT, Study, studies_in

log = logging.getLogger(__name__)
SHIPPED_PAINTINGS = Path(__file__).with_name("paintings.yaml")
SECONDS = ("cpu_seconds", "seconds")
NOISE_OF_SECONDS = 1.3  # ratio: on a busy machine the same work took 0.79 and 1.12 times the CPU seconds
EXPLANATION = Path(__file__).with_name("templates") / "verdicts.md"


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write the page of the studies in ``cfg.runs`` to ``cfg.page``, or into this run's folder."""
    claims = read_claims(Path(cfg.claims) if cfg.claims else SHIPPED_CLAIMS)
    paintings = yaml_of(read_text(Path(cfg.paintings or SHIPPED_PAINTINGS), "give a list of pictures"), list)
    studies = studies_in([Path(path) for path in cfg.runs], folder)
    experiments = [path for conf in conf_folders() for path in conf.glob("experiment/*.yaml")]
    questions = {path.stem: question_of(path) for path in experiments}
    page = Path(cfg.page) if cfg.page else folder / "ablations.md"
    typed = [word for word in words_of(folder) or ["task=verdicts"] if not word.startswith(("output=", "overwrite="))]
    command = shlex.join(["brushexp", *typed])
    counts = write_verdicts(page, studies, claims, questions, command, set(map(str, paintings)))
    log.info("%s: %s", as_shown(page), ", ".join(f"{count} {verdict}" for verdict, count in counts.items()))
    return {"studies": len(studies), **{verdict.replace(" ", "_"): count for verdict, count in counts.items()}}


def question_of(experiment: Path) -> str:
    """Read what an experiment asks: the first sentence of its file, below the line that Hydra reads."""
    lines = [line for line in experiment.read_text(encoding="utf-8").splitlines() if not line.startswith("# @package")]
    return lines[0].lstrip("# ").partition(" Run:")[0]


def write_verdicts(
    page: Path, studies: Mapping[str, Study], claims: Mapping[str, list[Claim]], questions: Mapping[str, str],
    command: str, paintings: Collection[str],
) -> dict[str, int]:  # fmt: skip
    """Write the page, with plots and records in a folder of its name beside it; count the claims by verdict."""
    judgements = judge((claim for listed in claims.values() for claim in listed), studies)
    verdicts = Counter(one.verdict for one in judgements)
    counts = ", ".join(f"{verdict} {count}" for verdict, count in verdicts.most_common())
    lines = ["# Ablations", "", f"Written by `{command}`, and no number in it by hand.", ""]
    lines += [*_explanation(claims), "", f"Verdicts on {len(judgements)} claims: {counts}.", ""]
    lines += _table([_verdict_row(one) for one in judgements if one.difference is not None])
    page.parent.mkdir(parents=True, exist_ok=True)
    for name in [*claims, *sorted(set(studies) - set(claims))]:
        if name in studies:
            judged = [one for one in judgements if one.claim.study == name and one.difference is not None]
            rows = [evidence_row(one, paintings) for one in judged]
            lines += _section(page, studies[name], questions.get(name) or studies[name].question, rows)
    for title, verdict in (("Cannot be answered here", CANNOT), ("Not run", NOT_RUN)):
        rows = [_open_row(one) for one in judgements if one.verdict == verdict and one.difference is None]
        lines += [f"## {title}", "", *_table(rows)] if rows else []
    write_text(page, "\n".join(lines))
    return dict(verdicts)


def _verdict_row(one: Judgement) -> dict[str, str]:
    assert one.difference is not None
    return {
        "claim": one.claim.says,
        "verdict": one.verdict,
        "measured": one.difference.sentence,
        "metric": one.difference.quantity.name,
        "p of all": "" if one.p is None else format_p(one.p),
        "study": f"[{one.claim.study}](#{one.claim.study})",
        "thesis": one.claim.section,
        "remarks": one.remarks,
    }


def _open_row(one: Judgement) -> dict[str, str]:
    told = {"claim": one.claim.says, "thesis": one.claim.section}
    if one.verdict == CANNOT:
        return told | {"why, and what it would need": one.remarks}
    return told | {"command, or what it needs": one.claim.needs or f"brushexp {EXPERIMENT}{one.claim.study}"}


def _explanation(claims: Mapping[str, list[Claim]]) -> list[str]:
    """Fill in what the page says of its rules, a paragraph each."""
    named = [claim.metric for listed in claims.values() for claim in listed if claim.metric]
    metrics = [quantities()[key] for key in dict.fromkeys([*paired.PANELS, *named])]
    matters = ", ".join(f"{metric.name} {metric.matters:g}" for metric in metrics if metric.matters)
    numbers = {"confidence": paired.CONFIDENCE, "level": 1 - paired.CONFIDENCE, "matters": matters, "rare": RARE}
    numbers["noise"] = NOISE_OF_SECONDS
    text = EXPLANATION.read_text(encoding="utf-8").format(rule=paired.rule_for(paired.PICTURE), **numbers)
    return [_prose(paragraph) for paragraph in text.split("\n\n")]


def _prose(text: str) -> str:
    return fill(text, 120, break_long_words=False, break_on_hyphens=False)


def _table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    keys = dict.fromkeys(key for row in rows for key in row)
    plain = [{key: str(row.get(key, "")).replace("|", "\\|").replace("_", "\\_") for key in keys} for row in rows]
    return [markdown_table(plain, escape=False), ""] if rows else []


def _section(page: Path, study: Study, question: str, claims: Sequence[Mapping[str, str]]) -> list[str]:
    name = study.name
    lines = [f"## {name}", "", _prose(question), "", f"`{study.command}`", "", _prose(_extent(study)), ""]
    lines += [_prose(escape_markdown(study.provenance)), ""] if study.provenance else []
    differences = paired.paired_differences(study.table)
    if differences:
        picture = page.with_suffix("") / f"{name}.png"
        picture.parent.mkdir(parents=True, exist_ok=True)
        paired.write_paired_plot(picture, differences, name)
        study.record(picture.with_suffix(".csv"))
        files = f"{picture.parent.name}/{name}"
        lines += [*_table(study_rows(study, differences)), *_table(claims)]
        lines += [f"![Differences of {name}]({files}.png)", "", f"All numbers: [{name}.csv]({files}.csv).", ""]
    return lines


def _extent(study: Study) -> str:
    kind = study.table.index.names[1]
    of_all = f" of {study.n_jobs}" * (study.n_finished < study.n_jobs)
    failures = f", {study.n_runs - study.n_finished} not finished" * (study.n_runs > study.n_finished)
    others = study.table.index.get_level_values(1).nunique() - len(study.units)
    more = f", {others} more with some of the settings" * (others > 0)
    units = f"{len(study.units)} {kind}s ({', '.join(study.units)}){more}"
    return f"{units}, {study.n_finished}{of_all} runs{failures}; {study.cost}."


def _change(one: paired.Difference) -> str:
    """Write a mean change with its interval, which ratios of seconds near 1 do not get: see `NOISE_OF_SECONDS`."""
    is_noise = one.metric in SECONDS and abs(one.mean) < math.log(NOISE_OF_SECONDS)
    return one.format_gain(one.mean) + (f" {one.bounds}" if not is_noise else "")


def study_rows(study: Study, differences: Sequence[paired.Difference]) -> list[dict[str, str]]:
    """Make a row per setting: the mean of the first metric where all were run, and differences to the first setting."""
    of_metric = dict.fromkeys(one.metric for one in differences)
    metrics = [key for key in paired.PANELS if key in of_metric][:3]
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
            row[f"{quantities()[key].name}, change"] = "reference" if one is None else _change(one)
        gains = [] if (one := by_cell.get((option, metrics[0]))) is None else list(one.gains.values())
        rows.append(row | {"better on": f"{sum(gain > 0 for gain in gains)} of {len(gains)}" if gains else ""})
    return rows
