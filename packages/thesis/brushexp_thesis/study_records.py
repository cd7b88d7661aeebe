"""Read finished studies, which are sweeps of a named experiment, from their folders or their records.

A record is a CSV file. Its first line is ``# `` followed by JSON (command, numbers of runs, cost); each of the other
lines holds the metrics for one setting and one picture (or seed). With records, a page can be rewritten after the large
run folders have been deleted. Other programs can also write records, which contain the program's command and question.
"""

import json
import math
import re
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from brushexp_studies.paired import Difference, paired_differences, paired_table

from brushexp.contracts import UserError
from brushexp.contracts.files import METRICS_FILE, json_of, read_text, write_text
from brushexp.contracts.results import JOBS, gather, quantities, remark_on_provenance
from brushexp.contracts.runs import UNFINISHED
from brushexp_thesis.claims import Claim

EXPERIMENT, PICTURE_WORD = "experiment=", "image="
# Keys in the first line of a record.
HEAD = ("name", "words", "n_jobs", "n_runs", "n_finished", "cost", "question", "provenance")
# Words that say where and by how many processes a study runs, not what it does.
OMITTED = ("hydra.sweeper.lenient=", "hydra.searchpath=", "hydra/launcher=", "hydra.launcher.")


@dataclass(frozen=True)
class Study:
    """A sweep of a named experiment, with the results of its runs.

    ``words`` is the study's command line without machine-specific folders. If its record was written by another
    program, the command line begins with ``python``, and the record contains the ``question``.

    ``table`` is the `paired_table` of the runs. A complete study has ``n_jobs`` runs; of the ``n_runs`` that were
    started, ``n_finished`` have finished. ``cost`` states the total cost of the finished runs in words.
    """

    name: str
    words: tuple[str, ...]
    table: pd.DataFrame
    n_jobs: int
    n_runs: int
    n_finished: int
    cost: str
    question: str = ""
    provenance: str = ""  # sentence about versions, machines and plugin files in which its runs differ

    @property
    def command(self) -> str:
        """The command that repeats the study."""
        return shlex.join(self.words if self.words[:1] == ("python",) else ["brushexp", *self.words])

    @property
    def units(self) -> list[str]:
        """The names of the pictures or seeds for which every setting was run."""
        whole = self.table.groupby(level=1, sort=False).size() == len(self.table.groupby(level=0))
        return [str(unit) for unit in whole.index[whole]]

    @property
    def extent(self) -> tuple[int, bool]:
        """The sort key for studies of the same experiment: the number of units, and whether all jobs have finished."""
        return len(self.units), self.n_finished >= self.n_jobs

    def difference(self, claim: Claim) -> Difference | None:
        """Compute the difference that decides a claim; return None if one of the claim's settings was not run.

        The interval is corrected for the number of comparisons with the study's reference setting or, if the claim
        compares two other settings, for the number of pairs of settings.
        """
        options = list(dict.fromkeys(self.table.index.get_level_values(0)))
        if not {claim.setting, claim.against} <= set(options):
            return None
        with_reference = options[0] in (claim.setting, claim.against)
        comparisons = len(options) - 1 if with_reference else math.comb(len(options), 2)
        differences = paired_differences(self.table, claim.against, [claim.metric], comparisons)
        return next((one for one in differences if one.option == claim.setting), None)

    def record(self, path: Path) -> None:
        """Write the study to a file that `studies_in` can read back."""
        metrics = self.table[[key for key in quantities() if key in self.table and self.table[key].notna().any()]]
        head = {name: getattr(self, name) for name in HEAD if getattr(self, name)}
        write_text(path, f"# {json.dumps(head)}\n{metrics.to_csv(float_format='%.7g', lineterminator=chr(10))}")


def studies_in(folders: Sequence[Path], into: Path) -> dict[str, Study]:
    """Read the studies in folders, and return them by name.

    Of several studies of one experiment, the largest is kept or, among equally large ones, the last one read. Records
    are read before sweeps. Raises UserError if there is no study.
    """
    studies: dict[str, Study] = {}
    for one in (*_read_records(folders), *_read_sweeps(folders, into)):
        if one.units and (one.name not in studies or one.extent >= studies[one.name].extent):
            studies[one.name] = one
    if not studies:
        raise UserError(f"runs={','.join(map(str, folders))}: no sweep of an experiment= found; run one first")
    return studies


def _read_records(folders: Sequence[Path]) -> Iterator[Study]:
    for path in sorted(path for folder in folders for path in folder.glob("*.csv")):
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            head = file.readline()
            if not head.startswith("# {"):
                continue
            try:
                fields = json_of(head[1:])
                table = pd.read_csv(file, index_col=[0, 1], dtype={0: str, 1: str})
                yield Study(**fields | {"words": tuple(fields["words"]), "table": table})
            except (ValueError, TypeError, KeyError, UserError) as error:
                raise UserError(f"{path} is not a record of a study ({error}); rewrite it or move it away") from error


def _read_sweeps(folders: Sequence[Path], into: Path) -> Iterator[Study]:
    for path in sorted({path.parents[1] for folder in folders for path in folder.rglob(JOBS)}):
        record = json_of(read_text(path / JOBS, ""))
        words = [str(word) for word in record.get("typed", [])]
        name = next((word.removeprefix(EXPERIMENT) for word in words if word.startswith(EXPERIMENT)), None)
        if name is None or not any(path.glob(f"*/{METRICS_FILE}")):
            continue
        frame = gather([path], into)
        if (table := paired_table(frame)) is not None:
            table = rename_options(table, record.get("jobs", []))
            finished = frame[~frame["run", "status"].isin(UNFINISHED)]
            sizes = (len(record.get("jobs", [])), len(frame), len(finished))
            remark = remark_on_provenance(finished)
            yield Study(name, tuple(_short(words)), table, *sizes, _cost(finished["metric"]), provenance=remark)


def rename_options(table: pd.DataFrame, jobs: Sequence[Sequence[str]]) -> pd.DataFrame:
    """Rename the options of a `paired_table` to the study's settings.

    A setting consists of the arguments of a job that follow the picture. The options in the table, by contrast, leave
    out the arguments that all jobs share, and list the others in a different order.
    """
    places = [next((k for k, word in enumerate(job) if word.startswith(PICTURE_WORD)), len(job)) for job in jobs]
    listed = list(dict.fromkeys(tuple(job[place + 1 :]) for job, place in zip(jobs, places, strict=True)))
    if not listed:
        return table
    shared = frozenset.intersection(*map(frozenset, listed))
    names = {frozenset(words) - shared: " ".join(words) for words in listed}
    return table.rename(index=lambda option: names.get(frozenset(option.split()), option), level=0)


def _cost(metrics: pd.DataFrame) -> str:
    wall = "hours, CPU time not recorded"
    for key, unit in (("cpu_seconds", "CPU hours"), ("seconds_total", wall), ("seconds", wall)):
        seconds = metrics[key].dropna().astype(float) if key in metrics else []
        if len(seconds):
            of_some = "" if len(seconds) == len(metrics) else f" for {len(seconds)} of them"
            return f"{sum(seconds) / 3600:.2f} {unit}{of_some}"
    return "cost not recorded"


def _short(words: Sequence[str]) -> list[str]:
    """Shorten the paths on a command line.

    Paths below the current folder become relative, and all others are reduced to their file names. Quotes are kept only
    around text that contains a comma.
    """
    plain = [re.sub(r'"([^",]*)"', r"\1", word) for word in words if not word.startswith(OMITTED)]
    plain = [re.sub(r'^hydra\.sweeper\.pictures=\[([^"]*)\]$', r"pictures=\1", word) for word in plain]
    parts = [word.partition("=") for word in sorted(plain, key=lambda word: not word.startswith(EXPERIMENT))]
    here = f"{Path.cwd().as_posix()}/"

    def short(path: re.Match[str]) -> str:
        below = path[0].removeprefix(here)
        return path[1] if below.startswith(("/", "~", "..")) else below

    return [key + equals + re.sub(r"""[^,\["'={:]*/([^/,]+)""", short, value) for key, equals, value in parts]
