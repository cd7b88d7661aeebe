"""Finished studies, sweeps of a named experiment, from their folders or from the records that were kept of them.

A record is a CSV file: a first line of JSON behind ``# `` (command, numbers of runs, cost), then a row for each setting
and picture (or seed) with the metrics. Folders of runs are large and go; a page is written anew from records.
"""

import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from brushexp.errors import UserError
from brushexp.results.paired import Difference, paired_differences, paired_table
from brushexp.results.quantities import quantities
from brushexp.results.runs import JOBS, UNFINISHED, gather
from brushexp.system.files import write_text
from brushexp.system.reading import json_of, read_text
from brushexp_thesis.claims import Claim

EXPERIMENT = "experiment="
RECORD = "# {"  # how a record begins
DIGITS = 7  # of a recorded number
HOUR = 3600
# Words that say where and by how many processes, not what.
UNTOLD = ("hydra.sweeper.lenient=", "hydra.searchpath=", "hydra/launcher=", "hydra.launcher.")


@dataclass(frozen=True)
class Study:
    """A finished sweep of a named experiment; ``words`` are its command line without the folders of a machine.

    ``table`` is the `paired_table` of its runs. It has ``n_jobs`` when it is whole; of ``n_runs`` that were begun
    ``n_finished`` have come to their ends, at a ``cost`` in words.
    """

    name: str
    words: tuple[str, ...]
    table: pd.DataFrame | None
    n_jobs: int
    n_runs: int
    n_finished: int
    cost: str

    @property
    def units(self) -> list[str]:
        """Names of the pictures or seeds that have every setting."""
        if self.table is None:
            return []
        whole = self.table.groupby(level=1, sort=False).size() == len(self.table.groupby(level=0))
        return [str(unit) for unit in whole.index[whole]]

    @property
    def extent(self) -> tuple[int, bool]:
        """What tells the larger of two studies of one experiment: its units, and whether no job is missing."""
        return len(self.units), self.n_finished >= self.n_jobs

    def difference(self, claim: Claim) -> Difference | None:
        """What decides a claim; None if a setting of it was not run.

        Its interval is one of all comparisons with the study's reference together or, where it compares two others,
        of all pairs of settings.
        """
        options = [] if self.table is None else list(dict.fromkeys(self.table.index.get_level_values(0)))
        if self.table is None or not {claim.setting, claim.against} <= set(options):
            return None
        with_reference = options[0] in (claim.setting, claim.against)
        comparisons = len(options) - 1 if with_reference else math.comb(len(options), 2)
        found = paired_differences(self.table, claim.against, [claim.metric], comparisons)
        return next((one for one in found if one.option == claim.setting), None)

    def record(self, path: Path) -> None:
        """Keep it as a file from which `studies_in` reads it again."""
        assert self.table is not None
        known = self.table[[key for key in quantities() if key in self.table and self.table[key].notna().any()]]
        told = {name: getattr(self, name) for name in ("name", "words", "n_jobs", "n_runs", "n_finished", "cost")}
        write_text(path, f"# {json.dumps(told)}\n{known.to_csv(float_format=f'%.{DIGITS}g', lineterminator=chr(10))}")


def studies_in(folders: Sequence[Path], into: Path) -> dict[str, Study]:
    """The studies in some folders, records first; of two of one experiment, the larger, or the later."""
    found: dict[str, Study] = {}
    for one in (*_recorded(folders), *_swept(folders, into)):
        if one.units and (one.name not in found or one.extent >= found[one.name].extent):
            found[one.name] = one
    if not found:
        raise UserError(f"runs={','.join(map(str, folders))}: there is no sweep of an experiment=; run one first")
    return found


def _recorded(folders: Sequence[Path]) -> Iterator[Study]:
    """Those of which a folder holds records."""
    for path in sorted(path for folder in folders for path in folder.glob("*.csv")):
        with path.open(encoding="utf-8", errors="replace") as file:
            first = file.readline()
            if not first.startswith(RECORD):
                continue
            try:
                told = json_of(first[1:])
                table = pd.read_csv(file, index_col=[0, 1], dtype={0: str, 1: str})
                yield Study(**told | {"words": tuple(told["words"]), "table": table})
            except (ValueError, TypeError, KeyError, UserError) as error:
                raise UserError(f"{path} is no record of a study ({error}); write it anew or move it away") from error


def _swept(folders: Sequence[Path], into: Path) -> Iterator[Study]:
    """Those whose sweeps are at or below a folder."""
    for path in sorted({path.parents[1] for folder in folders for path in folder.rglob(JOBS)}):
        noted = json_of(read_text(path / JOBS, ""))
        words = [str(word) for word in noted.get("typed", [])]
        name = next((word.removeprefix(EXPERIMENT) for word in words if word.startswith(EXPERIMENT)), None)
        if name is not None and any(path.glob("*/result.json")):
            frame = gather([path], into)
            finished = int((~frame["run", "status"].isin(UNFINISHED)).sum())
            sizes = (len(noted.get("jobs", [])), len(frame), finished)
            yield Study(name, tuple(_short(words)), paired_table(frame), *sizes, _cost(frame))


def _cost(frame: pd.DataFrame) -> str:
    """What the finished runs took, in words."""
    metrics = frame["metric"][~frame["run", "status"].isin(UNFINISHED)]
    wall = "hours, CPU time not noted"
    for key, told in (("cpu_seconds", "CPU hours"), ("seconds_total", wall), ("seconds", wall)):
        noted = metrics[key].dropna().astype(float) if key in metrics else []
        if len(noted):
            of_some = "" if len(noted) == len(metrics) else f" for {len(noted)} of them"
            return f"{sum(noted) / HOUR:.2f} {told}{of_some}"
    return "cost not noted"


def _short(words: Sequence[str]) -> list[str]:
    """A command line as it was typed, without the folders of this machine; a part with a comma keeps its quotes.

    Paths below the current folder are told from there on, as a repetition has them, others by their names.
    """
    plain = [re.sub(r'"([^",]*)"', r"\1", word) for word in words if not word.startswith(UNTOLD)]
    plain = [re.sub(r'^hydra\.sweeper\.pictures=\[([^"]*)\]$', r"pictures=\1", word) for word in plain]
    parts = [word.partition("=") for word in sorted(plain, key=lambda word: not word.startswith(EXPERIMENT))]
    here = f"{Path.cwd().as_posix()}/"

    def told(path: re.Match[str]) -> str:
        below = path[0].removeprefix(here)
        return path[1] if below.startswith(("/", "~", "..")) else below

    return [key + equals + re.sub(r"""[^,\["'={:]*/([^/,]+)""", told, value) for key, equals, value in parts]
