"""A page of studies in Markdown: claims with verdicts, tables and plots, each number from finished runs."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from brushexp.errors import UserError
from brushexp.results.claims import NOT_RUN, Claim
from brushexp.results.paired import Difference, paired_differences, paired_table, rule_for
from brushexp.results.paired_plot import PANELS, write_paired_plot
from brushexp.results.runs import UNFINISHED, gather
from brushexp.results.tables import METRICS, markdown_table
from brushexp.system.files import write_text
from brushexp.system.reading import json_of, read_text

if TYPE_CHECKING:
    from pandas import DataFrame

JOBS_FILE = ".hydra/jobs.json"  # of a sweep: the words that were typed
EXPERIMENT = "experiment="
SHOWN = 4  # metrics in a table
HOUR = 3600


@dataclass(frozen=True)
class Study:
    """A finished sweep of a named experiment; ``words`` are its command line without the folder."""

    name: str
    words: tuple[str, ...]
    frame: DataFrame
    table: DataFrame | None
    n_jobs: int = 0  # that it has when it is whole

    @property
    def units(self) -> list[str]:
        """Names of the pictures or seeds that have every setting."""
        if self.table is None:
            return []
        whole = self.table.groupby(level=1, sort=False).size() == len(self.table.groupby(level=0))
        return [str(unit) for unit in whole.index[whole]]

    def difference(self, claim: Claim) -> Difference | None:
        """What decides a claim; None if a setting of it was not run."""
        options = set() if self.table is None else set(self.table.index.get_level_values(0))
        if self.table is None or not {claim.setting, claim.against} <= options:
            return None
        found = paired_differences(self.table, claim.against, [claim.metric])
        return next((one for one in found if one.option == claim.setting), None)


def studies_in(folders: Sequence[Path], into: Path) -> dict[str, Study]:
    """The sweeps of named experiments at or below some folders; of two of one experiment, that with most pictures."""
    found: dict[str, Study] = {}
    paths = sorted({path.parents[1] for folder in folders for path in folder.rglob(JOBS_FILE)})
    for path in paths:
        noted = json_of(read_text(path / JOBS_FILE, ""))
        words = [str(word) for word in noted.get("typed", [])]
        name = next((word.removeprefix(EXPERIMENT) for word in words if word.startswith(EXPERIMENT)), None)
        if name is None or not any(path.glob("*/result.json")):
            continue
        frame = gather([path], into)
        one = Study(name, tuple(words), frame, paired_table(frame), len(noted.get("jobs", [])))
        if one.units and (name not in found or len(one.units) >= len(found[name].units)):
            found[name] = one
    if not found:
        raise UserError(f"runs={','.join(map(str, folders))}: there is no sweep of an experiment=; run one first")
    return found


def write_verdicts(
    page: Path,
    studies: Mapping[str, Study],
    claims: Mapping[str, list[Claim]],
    questions: Mapping[str, str],
    command: str,
) -> dict[str, int]:
    """Write the page, with plots in a folder of its name beside it; how many claims have each verdict."""
    judged = [(claim, studies[claim.study].difference(claim) if claim.study in studies else None)
              for listed in claims.values() for claim in listed]  # fmt: skip
    rows = [
        {
            "claim": claim.says,
            "thesis": claim.section,
            "study": f"[{claim.study}](#{claim.study})",
            "compared": f"{claim.setting} against {claim.against}",
            "metric": METRICS[claim.metric].name,
            "verdict": claim.judged(found),
            "measured": "" if found is None else found.sentence,
        }
        for claim, found in judged
    ]
    verdicts = Counter(row["verdict"] for row in rows)
    counts = ", ".join(f"{verdict} {count}" for verdict, count in verdicts.most_common())
    matters = ", ".join(f"{METRICS[key].name} {METRICS[key].matters:g}" for key in PANELS)
    head = [
        "# Ablations",
        "",
        f"Written by `{command}`, and no number in it by hand.",
        f"What the thesis claims, or chose by trying, and what comes of it here. {rule_for('picture')}",
        "Where seeds and not pictures are paired, the same holds of seeds.",
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
        f"`{shlex.join(['brushexp', *_short(study.words)])}`",
        "",
        f"{_told(study)}",
        "",
    ]
    found = paired_differences(study.table)
    if found:
        picture = page.with_suffix("") / f"{name}.png"
        picture.parent.mkdir(parents=True, exist_ok=True)
        write_paired_plot(picture, found, name)
        lines += [_study_table(study, found), "", f"![Differences of {name}]({picture.parent.name}/{picture.name})", ""]
    return lines


def _short(words: Sequence[str]) -> list[str]:
    """A command line as it was typed, without the folders of this machine."""
    plain = [re.sub(r"^hydra\.sweeper\.pictures=\[(.*)\]$", r"pictures=\1", word).replace('"', "") for word in words]
    plain = [word for word in plain if word != "hydra.sweeper.lenient=true"]
    return [
        re.sub(r"[^=,]*/([^/,]+)", r"\1", word) for word in sorted(plain, key=lambda w: not w.startswith(EXPERIMENT))
    ]


def _told(study: Study) -> str:
    """Units, sizes, failures and cost, in words."""
    run, metrics = study.frame["run"], study.frame["metric"]
    finished = ~run["status"].isin(UNFINISHED)
    kind = "" if study.table is None else str(study.table.index.names[1])
    spent = metrics["cpu_seconds"][finished].astype(float) if "cpu_seconds" in metrics else None
    wall = metrics["seconds_total"][finished].astype(float) if "seconds_total" in metrics else None
    cost = f"{spent.sum() / HOUR:.2f} CPU hours" if spent is not None and spent.notna().all() else None
    cost = cost or (f"{wall.sum() / HOUR:.2f} hours, CPU time not noted" if wall is not None else "cost not noted")
    left_out = f", {len(run) - int(finished.sum())} not finished" * (not finished.all())
    count = int(finished.sum())
    runs = f"{count} of {study.n_jobs} runs" if count < study.n_jobs else f"{count} runs"
    return f"{len(study.units)} {kind}s ({', '.join(study.units)}), {runs}{left_out}; {cost}."


def _study_table(study: Study, found: Sequence[Difference]) -> str:
    """A row per setting: the mean of the first metric where all were run, and differences to the first setting."""
    metrics = [key for key in PANELS if any(one.metric == key for one in found)][: SHOWN - 1]
    metrics += [key for key in ("cpu_seconds",) if key not in metrics and any(one.metric == key for one in found)]
    assert study.table is not None
    means = study.table.loc[(slice(None), study.units), :].groupby(level=0, sort=False).mean()
    rows = []
    for option in means.index:
        row = {
            "setting": option,
            METRICS[metrics[0]].name: f"{means.loc[option, metrics[0]]:.{METRICS[metrics[0]].digits}f}",
        }
        for key in metrics:
            one = next((d for d in found if d.option == option and d.metric == key), None)
            row[f"{METRICS[key].name}, change"] = "reference" if one is None else f"{one.shown(one.mean)} {one.bounds}"
        first = next((d for d in found if d.option == option and d.metric == metrics[0]), None)
        row["better on"] = "" if first is None else f"{sum(g > 0 for g in first.gains.values())} of {len(first.gains)}"
        rows.append(row)
    return markdown_table(_quoted(rows), escape=False)
