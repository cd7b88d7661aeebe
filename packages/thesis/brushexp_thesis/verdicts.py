"""``task=verdicts``: write a page of claims with verdicts, tables and plots from finished studies."""

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
from brushexp.contracts.results import csv_table, escape_markdown, markdown_table, quantities, words_of
from brushexp_thesis.claims import CANNOT, NOT_RUN, SHIPPED_CLAIMS, Claim, read_claims
from brushexp_thesis.evidence import POWER, RARE
from brushexp_thesis.judgements import Judgement, evidence_row, format_p, judge
from brushexp_thesis.study_records import EXPERIMENT, Study, studies_in

log = logging.getLogger(__name__)
SHIPPED_PAINTINGS = Path(__file__).with_name("paintings.yaml")
SECONDS = ("cpu_seconds", "seconds")
NOISE_OF_SECONDS = 1.3  # ratio; on a busy machine, the same work took 0.79 and 1.12 times the CPU seconds
WHERE_NUMBERS_ARE = (
    "[verdicts.csv]({folder}/verdicts.csv) adds to each claim the median, counts, ranks, and results for photographs "
    "and for paintings; [settings.csv]({folder}/settings.csv) has the mean and change of every metric for every "
    "setting."
)
EXPLANATION = Path(__file__).with_name("templates") / "verdicts.md"


def run(cfg: DictConfig, folder: Path, start: float) -> dict[str, object]:
    """Write a page about the studies in ``cfg.runs`` to ``cfg.page``, or by default into this run's folder."""
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
    """Read an experiment's question, which is the first sentence in its file below the ``@package`` line."""
    lines = [line for line in experiment.read_text(encoding="utf-8").splitlines() if not line.startswith("# @package")]
    return lines[0].lstrip("# ").partition(" Run:")[0]


def write_verdicts(
    page: Path, studies: Mapping[str, Study], claims: Mapping[str, list[Claim]], questions: Mapping[str, str],
    command: str, paintings: Collection[str],
) -> dict[str, int]:  # fmt: skip
    """Write the page of verdicts, and return the number of claims with each verdict.

    Tables, plots and records are written into a folder with the same name as the page.
    """
    judgements = judge((claim for listed in claims.values() for claim in listed), studies)
    measured = [one for one in judgements if one.difference is not None]
    verdicts = Counter(one.verdict for one in judgements)
    counts = ", ".join(f"{verdict} {count}" for verdict, count in verdicts.most_common())
    files = page.with_suffix("")
    files.mkdir(parents=True, exist_ok=True)
    intro, *rules = _explanation(claims)
    lines = ["# Ablations", "", intro, "", f"Verdicts on {len(judgements)} claims: {counts}.", ""]
    lines += _table([verdict_row(one) for one in measured])
    lines += [_prose(WHERE_NUMBERS_ARE.format(folder=files.name)), "", f"Command: `{command}`", ""]
    lines += ["## How to read this page", "", *(line for rule in rules for line in (rule, ""))]
    settings: list[dict[str, str]] = []
    for name in [*claims, *sorted(set(studies) - set(claims))]:
        if name in studies:
            study = studies[name]
            differences = paired.paired_differences(study.table)
            judged = [one for one in measured if one.claim.study == name]
            lines += _section(files, study, questions.get(name) or study.question, differences, judged, paintings)
            settings += numbers_of_settings(study, differences)
    for title, verdict in (("Cannot be answered here", CANNOT), ("Not run", NOT_RUN)):
        rows = [_open_row(one) for one in judgements if one.verdict == verdict and one.difference is None]
        lines += [f"## {title}", "", *_table(rows)] if rows else []
    write_text(files / "verdicts.csv", csv_table([verdict_numbers(one, paintings) for one in measured]))
    write_text(files / "settings.csv", csv_table(settings))
    write_text(page, "\n".join(lines))
    return dict(verdicts)


def verdict_row(one: Judgement) -> dict[str, str]:
    """Return a claim's row in the page's table of verdicts."""
    assert one.difference is not None
    section = f" ({one.claim.section})" * bool(one.claim.section)
    return {
        "claim": f"[{one.claim.says}](#{one.claim.study}){section}",
        "verdict": one.verdict + f"; {one.note}" * bool(one.note),
        "effect": f"{one.difference.quantity.name} {one.effect}",
        "power": one.power,
        "p": "" if one.p is None else format_p(one.p),
    }


def verdict_numbers(one: Judgement, paintings: Collection[str]) -> dict[str, str]:
    """Return a claim's row in verdicts.csv, which also lists the measurements behind the claim."""
    words = {"study": one.claim.study, "section": one.claim.section, "verdict": one.verdict, "note": one.note}
    p = "" if one.p is None else format_p(one.p)
    return words | evidence_row(one, paintings) | {"power": one.power, "p": p}


def _open_row(one: Judgement) -> dict[str, str]:
    told = {"claim": one.claim.says, "thesis": one.claim.section}
    if one.verdict == CANNOT:
        return told | {"why, and what it would need": one.claim.cannot}
    return told | {"command, or what it needs": one.claim.needs or f"brushexp {EXPERIMENT}{one.claim.study}"}


def _explanation(claims: Mapping[str, list[Claim]]) -> list[str]:
    """Return the paragraphs that explain the page and the rules behind its verdicts, filled in from a template."""
    named = [claim.metric for listed in claims.values() for claim in listed if claim.metric]
    metrics = [quantities()[key] for key in dict.fromkeys([*paired.PANELS, *named])]
    matters = "; ".join(f"{metric.name}: {metric.matters:g}" for metric in metrics if metric.matters)
    numbers = {"confidence": paired.CONFIDENCE, "level": 1 - paired.CONFIDENCE, "matters": matters, "rare": RARE}
    numbers |= {"noise": NOISE_OF_SECONDS, "power": POWER}
    text = EXPLANATION.read_text(encoding="utf-8").format(rule=paired.rule_for(paired.PICTURE), **numbers)
    return [_prose(paragraph) for paragraph in text.split("\n\n")]


def _prose(text: str) -> str:
    return fill(text, 120, break_long_words=False, break_on_hyphens=False)


def _table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    keys = dict.fromkeys(key for row in rows for key in row)
    plain = [{key: str(row.get(key, "")).replace("|", "\\|").replace("_", "\\_") for key in keys} for row in rows]
    return [markdown_table(plain, escape=False), ""] if rows else []


def _section(
    folder: Path, study: Study, question: str, differences: Sequence[paired.Difference],
    judged: Sequence[Judgement], paintings: Collection[str],
) -> list[str]:  # fmt: skip
    """Return a study's section of the page, and write its plot and record."""
    name = study.name
    lines = [f"## {name}", "", _prose(question), "", f"`{study.command}`", ""]
    if not differences:
        return [*lines, _prose(f"{_extent(study, paintings)}."), ""]
    paired.write_paired_plot(folder / f"{name}.png", differences, name)
    study.record(folder / f"{name}.csv")
    lines += [_prose(f"{_extent(study, paintings)}: [{name}.csv]({folder.name}/{name}.csv)."), ""]
    notes = dict.fromkeys(one.remark for one in judged if one.remark)
    remarks = " ".join(filter(None, [*notes, escape_markdown(study.provenance)]))
    lines += [_prose(remarks), ""] if remarks else []
    return [*lines, f"![Differences of {name}]({folder.name}/{name}.png)", ""]


def _extent(study: Study, paintings: Collection[str]) -> str:
    kind = study.table.index.names[1]
    of_all = f" of {study.n_jobs}" * (study.n_finished < study.n_jobs)
    failures = f", {study.n_runs - study.n_finished} not finished" * (study.n_runs > study.n_finished)
    painted = len({*study.units} & {*paintings})
    kinds = f" ({painted} paintings or prints)" * (painted > 0)
    others = study.table.index.get_level_values(1).nunique() - len(study.units)
    more = f", {others} more with some of the settings" * (others > 0)
    return f"{len(study.units)} {kind}s{kinds}{more}; {study.n_finished}{of_all} runs{failures}; {study.cost}"


def numbers_of_settings(study: Study, differences: Sequence[paired.Difference]) -> list[dict[str, str]]:
    """Return a row for each metric and setting: the mean, the change from the reference, and how many units improved.

    Means are taken over the pictures or seeds for which every setting was run. A change is a difference or, for metrics
    that are compared by ratio, a ratio.
    """
    by_cell = {(one.metric, one.option): one for one in differences}
    rows: list[dict[str, str]] = []
    for metric in dict.fromkeys(one.metric for one in differences):
        quantity = quantities()[metric]
        means = study.table.loc[(slice(None), study.units), metric].groupby(level=0, sort=False).mean()
        for option, mean in means.items():
            row = {
                "study": study.name,
                "setting": str(option),
                "metric": quantity.name,
                "mean": f"{mean:.{quantity.digits}f}",
            }
            one = by_cell.get((metric, str(option)))
            rows.append(row | ({"change": "reference"} if one is None else _change(one)))
    return rows


def _change(one: paired.Difference) -> dict[str, str]:
    """Format a mean change with its bounds; ratios of seconds near 1 have no bounds (see `NOISE_OF_SECONDS`)."""
    quantity = one.quantity
    is_higher_better = quantity.better == "higher"
    mean = one.mean if is_higher_better else -one.mean
    ends = (one.low, one.high) if is_higher_better else (-one.high, -one.low)
    change, low, high = (f"{math.exp(end) if quantity.ratio else end:.4g}" for end in (mean, *ends))
    is_noise = one.metric in SECONDS and abs(one.mean) < math.log(NOISE_OF_SECONDS)
    bounds = {"low": "", "high": ""} if is_noise else {"low": low, "high": high}
    better_on = sum(gain > 0 for gain in one.gains.values())
    return {"change": change} | bounds | {"better on": str(better_on), "of": str(len(one.gains))}
