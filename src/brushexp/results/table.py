"""One table over all runs of a sweep, or over any runs.

Every function takes the folder of any sweep and may be called by hand.
"""

import csv
import hashlib
import io
import json
import re
from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from statistics import mean, stdev
from typing import Any

from brushexp.errors import UserError
from brushexp.system.files import write_text

Result = dict[str, Any]
DIGITS = {  # table.md: main metrics, of which those are shown that some run has
    **{"psnr": 2, "ssim": 4, "l1": 4, "edges": 4, "perceptual": 4},
    **{"lpips_alexnet": 4, "lpips_squeeze": 4, "lpips_vgg16": 4},
    **{"style_poly": 4, "style_linear": 4, "style_gaussian": 4, "style_meanstd": 4},
    **{"accuracy": 4, "auc": 4},
    **{"l2": 6, "psnr_alpha": 2, "psnr_color": 2, "fid_effl0": 2, "kid_effl0": 2, "fid_inception": 2},
    **{"strokes_per_second": 0, "strokes_per_second_backward": 0, "parameters": 0, "file_mb": 2},
    **{"seconds": 1, "n_strokes": 0},
}
LEAD = ("run", "status", "error")  # first columns of table.csv
UNFINISHED = ("failed", "interrupted")  # states of runs that are not compared
LONGEST = 200  # letters of an error message in table.md
LONGEST_VALUE = 40  # letters of a value in a picture; of a longer one the end is shown
NOTHING = "–"


def collect(folder: Path) -> list[Result]:
    """Read every run's ``result.json``, in the order of the job numbers; an unreadable one counts as failed.

    Raises:
        UserError: if there is none.
    """
    results = [read_result(path) for path in folder.glob("*/result.json")]
    if not results:
        raise UserError(f"there is no result.json below {folder}; give the folder of a sweep")
    return sorted(results, key=lambda result: run_number(result["run"]))


def settings(result: Result) -> dict[str, str]:
    """What the command line of a run said; ``loss`` as the names of its losses."""
    loss = {"loss": result["loss"]} if result.get("loss") else {}
    return {**result.get("overrides", {}), **loss}


def varying(results: Iterable[Result]) -> dict[str, list[str]]:
    """The settings in which the runs differ, and the values of each, in order of first appearance."""
    runs = [settings(result) for result in results]
    keys = dict.fromkeys(key for run in runs for key in run)
    values = {key: list(dict.fromkeys(run.get(key, "") for run in runs)) for key in keys}
    return {key: found for key, found in values.items() if len(found) > 1}


def finished(results: Iterable[Result]) -> list[Result]:
    """The runs that came to their end, also those that stopped early because a goal was reached."""
    return [result for result in results if result["status"] not in UNFINISHED]


def groups(results: Iterable[Result], keys: Sequence[str]) -> dict[tuple[str, ...], list[Result]]:
    """The finished runs by their values of these settings, in order of first appearance."""
    found: dict[tuple[str, ...], list[Result]] = {}
    for result in finished(results):
        chosen = settings(result)
        found.setdefault(tuple(chosen.get(key, "") for key in keys), []).append(result)
    return found


def numbers(runs: Iterable[Result], metric: str) -> list[float]:
    """This metric of the runs that have it."""
    return [run[metric] for run in runs if isinstance(run.get(metric), int | float)]


def shortened(values: Sequence[str], longest: int = LONGEST_VALUE) -> dict[str, str]:
    """How each value of a setting is shown: paths without the folders that tell nothing, and not too long."""
    names = values
    for depth in range(1, 1 + max(value.count("/") for value in values)):
        tails = ["/".join(value.split("/")[-depth:]) for value in values]
        if len(set(tails)) == len(tails):
            names = tails
            break
    short = [name if len(name) <= longest else "..." + name[-longest:] for name in names]
    return dict(zip(values, short, strict=True))


def summary(results: list[Result]) -> str:
    """How many runs, and how many of them failed."""
    failed = sum(result["status"] == "failed" for result in results)
    return f"{len(results)} run{'s' * (len(results) != 1)}, {failed} failed"


def formatted(result: Result, metric: str) -> str:
    """A metric with as many digits as tell something."""
    value = result.get(metric)
    if metric == "psnr" and value is None and result.get("l1") == 0:
        return "inf"  # which JSON does not know
    return f"{value:.{DIGITS[metric]}f}" if isinstance(value, int | float) else NOTHING


def write_table(folder: Path, results: list[Result] | None = None) -> tuple[Path, Path]:
    """Write ``table.csv`` (every column, full precision) and ``table.md`` (what varies, and the main metrics).

    Args:
        folder: where to.
        results: of which runs; None means those of the sweep in this folder.

    Returns:
        Their paths.
    """
    results = collect(folder) if results is None else results
    paths = folder / "table.csv", folder / "table.md"
    write_text(paths[0], as_csv(results))
    write_text(paths[1], as_markdown(results))
    return paths


def as_csv(results: list[Result]) -> str:
    """A column per setting and number; a setting that bears the name of a number is called ``override.<name>``.

    What holds many numbers, a curve for instance, is none.
    """
    fixed = {*LEAD, "overrides", "loss", "picture"}
    fixed |= {key for result in results for key, value in result.items() if isinstance(value, list | dict)}
    numbers = list(dict.fromkeys(key for result in results for key in result if key not in fixed))
    keys = list(dict.fromkeys(key for result in results for key in settings(result)))
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow([*LEAD, *(f"override.{key}" if key in {*LEAD, *numbers} else key for key in keys), *numbers])
    for result in results:
        chosen = settings(result)
        row = [*map(result.get, LEAD), *map(chosen.get, keys), *map(result.get, numbers)]
        writer.writerow(row)
    return file.getvalue()


def as_markdown(results: list[Result]) -> str:
    """A table with a caption, after one of means if seeds vary; numbers stand on the right."""
    keys = list(varying(results))
    shown = [metric for metric in DIGITS if any(metric in result for result in results)]
    means = ["Mean ± standard deviation over seeds.", "", *_means(results), ""] if "seed" in keys else []
    head = ["run", *keys, "status", *shown]
    rules = ["---:", *("---" for _ in keys), "---", *("---:" for _ in shown)]
    lines = [head, rules]
    for result in results:
        chosen = settings(result)
        metrics = [formatted(result, metric) for metric in shown]
        lines.append([result["run"], *(chosen.get(key, "") for key in keys), _status(result), *metrics])
    return "\n".join([*means, f"{summary(results)}.", "", *markdown(lines), ""])


def _means(results: list[Result]) -> list[str]:
    """A table with one row for all finished runs that differ in the seed alone."""
    keys = [key for key in varying(results) if key != "seed"]
    grouped = groups(results, keys)
    shown = [metric for metric in DIGITS if any(numbers(runs, metric) for runs in grouped.values())]
    lines = [[*keys, "runs", *shown], [*("---" for _ in keys), "---:", *("---:" for _ in shown)]]
    for chosen, runs in grouped.items():
        lines.append([*chosen, str(len(runs)), *(_mean_and_spread(runs, metric) for metric in shown)])
    return markdown(lines)


def _mean_and_spread(runs: list[Result], metric: str) -> str:
    found, digits = numbers(runs, metric), DIGITS[metric]
    if not found:
        return NOTHING
    spread = f" ± {stdev(found):.{digits}f}" if len(found) > 1 else ""
    return f"{mean(found):.{digits}f}{spread}"


def markdown(lines: list[list[str]]) -> list[str]:
    """Markdown of a head, its rules, and rows."""
    head, rules, *rows = lines
    return [f"| {' | '.join(line)} |" for line in (map(_escaped, head), rules, *(map(_escaped, row) for row in rows))]


def _status(result: Result) -> str:
    if result["status"] != "failed":
        return str(result["status"])
    error = str(result.get("error", ""))
    return f"failed: {error[:LONGEST]}{'…' * (len(error) > LONGEST)}"


def _escaped(text: str) -> str:
    r"""Markdown that shows exactly this text: ``a|b_c`` becomes ``a\|b\_c``."""
    return re.sub(r"([\\`*_\[\]<>|~$&])", r"\\\1", " ".join(str(text).split()))


def read_result(path: Path) -> Result:
    """What a file says of the run in whose folder it is; an unreadable one counts as failed."""
    run = path.parent.name
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
        return {"status": "completed", "overrides": {}, **result, "run": run}
    except (OSError, ValueError, TypeError) as error:
        return {"run": run, "status": "failed", "error": f"its {path.name} cannot be read: {error}", "overrides": {}}


def picture_of(folder: Path, result: Result) -> Path:
    """The picture that a run of the sweep in ``folder`` is shown by."""
    return folder / result["run"] / Path(str(result.get("picture", "painting.png"))).name


def fingerprint(path: Path) -> str:
    """Of a file: equal for the same bytes. A file is read again only when it has changed."""
    state = path.stat()
    return _fingerprint(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=10_000)
def _fingerprint(path: Path, changed: int, size: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def run_number(run: str) -> tuple[bool, int, str]:
    """Puts runs in the order of their numbers, and those without one behind."""
    return (not run.isdecimal(), int(run) if run.isdecimal() else 0, run)
