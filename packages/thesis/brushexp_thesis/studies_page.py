"""A page of studies in Markdown: claims with verdicts, tables and plots, each number from finished runs."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from brushexp.reporting.tables import markdown_table
from brushexp.results.paired import PANELS, PICTURE, Difference, paired_differences, rule_for, write_paired_plot
from brushexp.results.quantities import quantities
from brushexp.system.files import write_text
from brushexp_thesis.claims import NOT_RUN, Claim
from brushexp_thesis.study_records import EXPERIMENT, Study

SHOWN = 4  # metrics in a table


def write_verdicts(
    page: Path,
    studies: Mapping[str, Study],
    claims: Mapping[str, list[Claim]],
    questions: Mapping[str, str],
    command: str,
) -> dict[str, int]:
    """Write the page, with plots and records in a folder of its name beside it; how many claims have each verdict."""
    judged = [(claim, studies[claim.study].difference(claim) if claim.study in studies else None)
              for listed in claims.values() for claim in listed]  # fmt: skip
    rows = [
        {
            "claim": claim.says,
            "thesis": claim.section,
            "study": f"[{claim.study}](#{claim.study})",
            "compared": f"{claim.setting} against {claim.against}",
            "metric": quantities()[claim.metric].name,
            "verdict": claim.judged(found),
            "measured": "" if found is None else found.sentence,
        }
        for claim, found in judged
    ]
    verdicts = Counter(row["verdict"] for row in rows)
    counts = ", ".join(f"{verdict} {count}" for verdict, count in verdicts.most_common())
    metrics = dict.fromkeys([*PANELS, *(claim.metric for claim, _ in judged)])
    compared = [quantities()[key] for key in metrics]
    matters = ", ".join(f"{quantity.name} {quantity.matters:g}" for quantity in compared if quantity.matters)
    head = [
        "# Ablations",
        "",
        f"Written by `{command}`, and no number in it by hand.",
        "What the thesis (Heimbrecht, master thesis, Heidelberg, 2020) claims, or chose by trying, and what comes of "
        f"it here; 6.3 and the like are its sections. {rule_for(PICTURE)}",
        "Where seeds and not pictures are paired, the same holds of seeds, but no answer depends on one.",
        "The reference is the first setting of a study's table; where a claim compares two others, its interval is one "
        "for all pairs of settings together.",
        "A claim of *no worse* holds if the interval allows no loss that matters, however large a gain it allows, and "
        "the answer does not depend on the picture; what was measured is told by the rule above all the same.",
        f"What matters: {matters} (of ratios: of their natural logarithm).",
        "",
        f"Verdicts on {len(rows)} claims: {counts}.",
        "",
        *_table([row for row in rows if row["verdict"] != NOT_RUN]),
    ]
    page.parent.mkdir(parents=True, exist_ok=True)
    names = [name for name in [*claims, *sorted(set(studies) - set(claims))] if name in studies]
    parts = [_section(page, studies[name], questions.get(name, "")) for name in names]
    left = [
        {"claim": row["claim"], "thesis": row["thesis"], "command": f"brushexp {EXPERIMENT}{claim.study}"}
        for row, (claim, _) in zip(rows, judged, strict=True)
        if row["verdict"] == NOT_RUN
    ]
    if left:
        parts.append(["## Not run", "", *_table(left)])
    write_text(page, "\n".join([*head, *(line for part in parts for line in part)]))
    return dict(verdicts)


def _table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    return [markdown_table(_quoted(rows), escape=False), ""] if rows else []


def _quoted(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    return [{key: str(value).replace("|", "\\|").replace("_", "\\_") for key, value in row.items()} for row in rows]


def _section(page: Path, study: Study, question: str) -> list[str]:
    """Question, command, table, plot and cost of one study."""
    name = study.name
    lines = [
        f"## {name}",
        "",
        question,
        "",
        f"`{shlex.join(['brushexp', *study.words])}`",
        "",
        f"{_told(study)}",
        "",
    ]
    found = paired_differences(study.table)
    if found:
        picture = page.with_suffix("") / f"{name}.png"
        picture.parent.mkdir(parents=True, exist_ok=True)
        write_paired_plot(picture, found, name)
        study.record(picture.with_suffix(".csv"))
        lines += [_study_table(study, found), "", f"![Differences of {name}]({picture.parent.name}/{name}.png)", ""]
        lines += [f"All numbers: [{name}.csv]({picture.parent.name}/{name}.csv).", ""]
    return lines


def _told(study: Study) -> str:
    """Units, sizes, failures and cost, in words."""
    kind = "" if study.table is None else str(study.table.index.names[1])
    of_all = f" of {study.n_jobs}" * (study.n_finished < study.n_jobs)
    left_out = f", {study.n_runs - study.n_finished} not finished" * (study.n_runs > study.n_finished)
    units = f"{len(study.units)} {kind}s ({', '.join(study.units)})"
    return f"{units}, {study.n_finished}{of_all} runs{left_out}; {study.cost}."


def _study_table(study: Study, found: Sequence[Difference]) -> str:
    """A row per setting: the mean of the first metric where all were run, and differences to the first setting."""
    metrics = [key for key in PANELS if any(one.metric == key for one in found)][: SHOWN - 1]
    metrics += [key for key in ("cpu_seconds",) if key not in metrics and any(one.metric == key for one in found)]
    metrics = metrics or [found[0].metric]
    assert study.table is not None
    means = study.table.loc[(slice(None), study.units), :].groupby(level=0, sort=False).mean()
    known = {(one.option, one.metric): one for one in found}
    shown = quantities()
    first_shown, rows = shown[metrics[0]], []
    for option in means.index:
        row = {"setting": option, first_shown.name: f"{means.loc[option, metrics[0]]:.{first_shown.digits}f}"}
        for key in metrics:
            one = known.get((option, key))
            row[f"{shown[key].name}, change"] = "reference" if one is None else f"{one.shown(one.mean)} {one.bounds}"
        first = known.get((option, metrics[0]))
        row["better on"] = "" if first is None else f"{sum(g > 0 for g in first.gains.values())} of {len(first.gains)}"
        rows.append(row)
    return markdown_table(_quoted(rows), escape=False)
